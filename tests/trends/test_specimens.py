"""Units of one kind side by side."""

import json
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb

sys.path.insert(0, str(Path(__file__).parents[1] / "comparison"))
from results import folder, result

FIRST = datetime(2025, 1, 1, 2, tzinfo=UTC)


def unit(path: Path, name: str, values: list[float], **more: str) -> None:
    for i, value in enumerate(values):
        started = (FIRST + timedelta(days=i)).isoformat()
        made = result([value], target=name, started=started, **more)
        folder(path / f"{abs(hash(name))}-{more.get('metric', '')}-{i:03d}", made)


def worn(level: float, wear: float, seed: int, count: int = 40) -> list[float]:
    noise = 0.005 * np.random.default_rng(seed).normal(size=count)
    return list(level * (1.0 + noise + wear * np.arange(count) / count))


def test_each_unit_is_held_against_its_own_first_nights(tmp_path: Path) -> None:
    levels = {"rig-1": 1.0, "rig-2": 1.6, "rig-3": 0.7, "rig-4": 1.2}
    for seed, (name, level) in enumerate(levels.items()):
        unit(tmp_path, name, worn(level, 0.15 if name == "rig-3" else 0.02, seed))
    found = eb.history(tmp_path)
    (kin,) = found.kin
    assert kin.relative
    changes = {one.trend.target: one.change for one in kin.specimens}
    assert changes["rig-3"] == pytest.approx(0.125, abs=0.02)
    assert changes["rig-2"] == pytest.approx(0.017, abs=0.01)
    assert [one.trend.target for one in kin.specimens if one.odd] == ["rig-3"]
    told = json.loads(found.to_json())["units"][0]["targets"][2]
    assert (told["target"], told["odd"]) == ("rig-3", True)
    page = (tmp_path / "history" / "units.html").read_text(encoding="utf-8")
    assert "rig-3 changed differently from the others" in page
    assert page.count("<polyline") == 4
    assert "units.html" in (tmp_path / "history" / "index.html").read_text(encoding="utf-8")


def test_units_that_wear_alike_are_none_of_them_odd(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    for seed in range(5):
        unit(tmp_path, f"<b>rig {seed}</b>", worn(rng.uniform(0.5, 2.0), 0.1, 10 + seed))
    (kin,) = eb.history(tmp_path).kin
    assert not any(one.odd for one in kin.specimens)
    page = (tmp_path / "history" / "units.html").read_text(encoding="utf-8")
    assert "<b>rig" not in page


def test_a_metric_about_zero_is_not_made_a_share(tmp_path: Path) -> None:
    for seed, name in enumerate(("a", "b")):
        rng = np.random.default_rng(seed)
        unit(tmp_path, name, list(1e4 * rng.normal(size=20)), metric="steady_state_error")
    (kin,) = eb.history(tmp_path).kin
    assert not kin.relative
    assert not any(one.odd for one in kin.specimens)  # of two nobody knows
    page = (tmp_path / "history" / "units.html").read_text(encoding="utf-8")
    assert "3 with more than 8 nights are needed" in page
    assert "Against other units" not in page
    assert "No unit changed" not in page


def test_a_step_of_a_few_nights_ago_is_all_in_the_change(tmp_path: Path) -> None:
    for seed, name in enumerate(("a", "b", "c")):
        values = np.array(worn(1.0, 0.0, seed, 30))
        values[-3:] += 0.4 if name == "c" else 0.0
        unit(tmp_path, name, list(values))
    (kin,) = eb.history(tmp_path).kin
    stepped = kin.specimens[2]
    # what the table says is where the plot ends, and what was asked for
    assert stepped.change == pytest.approx(0.4, abs=0.02)
    assert stepped.change == pytest.approx(float(stepped.moved[-1]), abs=0.01)


def test_one_unit_has_no_such_page(tmp_path: Path) -> None:
    unit(tmp_path, "a", worn(1.0, 0.0, 1, 9))
    unit(tmp_path, "b", worn(1.0, 0.0, 2, 3))
    assert eb.history(tmp_path).kin[0].specimens[1].change != 0.0  # NaN: too few nights
    assert "too few nights" in (tmp_path / "history" / "units.html").read_text(encoding="utf-8")
    alone = tmp_path / "alone"
    unit(alone, "a", worn(1.0, 0.0, 1, 9))
    eb.history(alone)
    assert not (alone / "history" / "units.html").exists()
