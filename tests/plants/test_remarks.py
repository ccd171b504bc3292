"""What a model may not be, and what it may be and hardly means."""

from __future__ import annotations

from pathlib import Path

import pytest

from eha_bench.core.errors import InputError
from eha_bench.core.file_kind import kinds
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.remarks import remarks


@pytest.mark.parametrize(("static", "rest"), [("0.2", "rises"), ("0.3", ""), ("0.4", "")])
def test_friction_that_is_less_at_rest_is_noted(static: str, rest: str) -> None:
    model = load_model(
        {"model": "eha_knee", "parameters": {"coulomb_torque": 0.3, "static_torque": float(static)}}
    )
    found = remarks(model)
    assert len(found) == bool(rest)
    assert all("'drag.static' of 0.2 (SI) is below 'drag.coulomb' of 0.3" in one for one in found)


def test_a_parameter_is_calibrated_once() -> None:
    # also under its other name
    for second in ("coulomb_torque", "drag.coulomb"):
        with pytest.raises(InputError, match=r"'calibrate\.1': .* is under calibrate twice; keep"):
            load_model({"model": "eha_knee", "calibrate": ["coulomb_torque", second]})


@pytest.mark.parametrize("mass", ["1e300 kg", 1e41])
def test_a_parameter_beyond_any_machine_is_refused(mass: str | float) -> None:
    with pytest.raises(InputError, match=r"load_mass': .* is beyond any machine: check its unit"):
        load_model({"model": "eha_knee", "parameters": {"load_mass": mass}})


def test_what_a_list_of_the_models_own_leaves_out_is_named(tmp_path: Path) -> None:
    (tmp_path / "below.yaml").write_text(
        "model: eha_knee\ncalibrate: [leakage, rotor_inertia, coulomb_torque]\n"
    )
    above = "model: below.yaml\ncalibrate: [leakage]\nper_run: [rotor_inertia]\n"
    (tmp_path / "above.yaml").write_text(above)
    (remark,) = remarks(load_model(tmp_path / "above.yaml"))
    assert remark.startswith("coulomb_torque stays as declared: the model's own list")
    (tmp_path / "above.yaml").write_text("model: below.yaml\ncalibrate: [leakage]\n")
    (remark,) = remarks(load_model(tmp_path / "above.yaml"))
    assert remark.startswith("rotor_inertia, coulomb_torque stay as declared")
    (tmp_path / "below.yaml").write_text("model: eha_knee\nper_run: [leakage]\n")
    (tmp_path / "above.yaml").write_text("model: below.yaml\nper_run: [rotor_inertia]\n")
    (remark,) = remarks(load_model(tmp_path / "above.yaml"))
    assert remark.startswith("leakage stays as declared")
    assert remarks(load_model(tmp_path / "below.yaml")) == []


@pytest.mark.parametrize("names", [["a"], ["a", "b"], ["a", "b", "c"]])
def test_models_in_a_circle_are_refused(tmp_path: Path, names: list[str]) -> None:
    for name, other in zip(names, [*names[1:], names[0]], strict=True):
        (tmp_path / f"{name}.yaml").write_text(f"model: {other}.yaml\n")
    with pytest.raises(InputError, match=r"a\.yaml:1, key 'model': models stand on .* circle: a"):
        load_model(tmp_path / "a.yaml")
    (tmp_path / "above.yaml").write_text("model: a.yaml\n")
    with pytest.raises(InputError, match="in a circle: a"):
        load_model(tmp_path / "above.yaml")


def test_an_empty_list_of_the_models_own_leaves_all_of_them_out(tmp_path: Path) -> None:
    (tmp_path / "below.yaml").write_text(
        "model: eha_knee\ncalibrate: [leakage]\nper_run: [external_force]\n"
    )

    def above(text: str) -> Model:
        (tmp_path / "above.yaml").write_text(f"model: below.yaml\n{text}")
        return load_model(tmp_path / "above.yaml")

    same, none, one = above(""), above("calibrate: []\nper_run: []\n"), above("per_run: []\n")
    assert (same.calibrate, same.per_run, same.held) == (("leakage",), ("external_force",), ())
    assert (none.calibrate, none.per_run) == ((), ())
    assert none.held == ("leakage", "external_force")
    assert (one.calibrate, one.per_run, one.held) == (("leakage",), (), ("external_force",))
    # one value for all runs in place of one for each
    moved = above("calibrate: [external_force]\n")
    assert (moved.calibrate, moved.per_run) == (("external_force",), ())
    assert moved.held == ("leakage",)


@pytest.mark.parametrize("key", ["calibrate", "per_run"])
def test_the_schema_says_that_a_list_stands_for_the_one_below(key: str) -> None:
    (kind,) = (item for item in kinds() if item.name == "model")
    assert "stands for the whole list" in kind.schema()["properties"][key]["description"]
