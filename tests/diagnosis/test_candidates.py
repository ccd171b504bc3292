"""What may be missing from a model: nothing that it says already."""

from pathlib import Path

from eha_bench.diagnosis.fit.candidates import all_starts, effect_starts
from eha_bench.plants.network.file import load_plant

CYLINDER = "suites/plants/valve_cylinder.yaml"


def candidates(file: Path) -> set[str]:
    layout = load_plant(file).layout
    return {start.candidate for start in all_starts(layout, layout.defaults(), (), ())}


def test_a_rod_that_is_declared_cannot_be_missing(repository: Path, tmp_path: Path) -> None:
    text = (repository / CYLINDER).read_text(encoding="utf-8")
    both, one = tmp_path / "both.yaml", tmp_path / "one.yaml"
    both.write_text(text, encoding="utf-8")
    assert "area_b: 12 cm^2" in text
    one.write_text(text.replace("area_b: 12 cm^2", "area_b: 9 cm^2"), encoding="utf-8")
    assert "unequal_areas" in candidates(both)
    assert candidates(both) - candidates(one) == {"unequal_areas"}


def test_oil_that_warms_is_no_oil_that_cools(repository: Path) -> None:
    layout = load_plant(repository / CYLINDER).layout
    starts = all_starts(layout, layout.defaults(), (), ())
    own = [start for start in starts if start.candidate == "viscosity_drift"]
    assert own
    assert all(start.low == 0.0 < start.strength for start in own)


def test_refinements_are_left_until_the_effect_is_there(repository: Path) -> None:
    layout = load_plant(repository / "suites/plants/geared_servo.yaml").layout
    for name, refinement in (("current_deadband", "edges"), ("cogging_torque", "harmonics")):
        effect = layout.effect(name)
        at = layout.index[f"{name}.{refinement}"]
        first, refined = (
            {dict(start.settings)[at] for start in effect_starts(layout, effect, refined=asked)}
            for asked in (False, True)
        )
        assert (first, refined) == ({0.0}, {0.0, 1.0})
