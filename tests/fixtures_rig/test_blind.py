"""The benchmark's own arithmetic, on verdicts made up for it."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from benchmarks import blind


def outcome(tmp_path: Path, truth: dict[str, Any], found: dict[str, Any] | None) -> blind.Outcome:
    took = {"seconds": 2.0, "failure": "" if found is not None else "Traceback\nValueError: x"}
    (tmp_path / "took.json").write_text(json.dumps(took))
    if found is not None:
        (tmp_path / "diagnosis.json").write_text(json.dumps(found))
    return blind.compare({"case": "c", **truth}, tmp_path)


def hidden(name: str, equation: str, also: tuple[str, ...] = (), **size: float) -> dict[str, Any]:
    return {
        "id": name, "equation": equation, "also": list(also), "strength": "middle",
        "parameters": size,
    }  # fmt: skip


AIR = {"kind": "single", "undeclared": [hidden("entrained_air", "flow", air_fraction=0.02)]}


def named(*effects: tuple[str, str]) -> dict[str, Any]:
    return {
        "verdict": "effect",
        "effects": [
            {"id": i, "equation": e, "parameters": {"a": {"low": 0.019, "high": 0.021}}}
            for i, e in effects
        ],
        "unknown": None,
        "equivalent": [],
        "error": {"holdout": {"pressure_a": {"before": 9.0, "after": 2.2, "noise_floor": 2.0}}},
    }  # fmt: skip


def test_right(tmp_path: Path) -> None:
    o = outcome(tmp_path, AIR, named(("entrained_air", "flow")))
    assert o.first_right
    assert o.all_right
    assert o.equations_right
    assert o.covered == (True,)
    assert o.holdout_ratio == pytest.approx(1.1)


def test_a_right_effect_at_the_wrong_place(tmp_path: Path) -> None:
    truth = json.loads(json.dumps(AIR))
    truth["undeclared"][0]["at"] = ["chamber_a", "chamber_b"]
    found = named(("entrained_air", "flow"))
    assert outcome(tmp_path, truth, found).places_right == ()
    found["effects"][0]["at"] = "chamber_b"
    assert outcome(tmp_path, truth, found).places_right == (True,)
    found["effects"][0]["at"] = ["inlet"]
    o = outcome(tmp_path, truth, found)
    assert o.places_right == (False,)
    assert o.all_right
    assert blind.summarise([o])["rates"]["right effect, at its place"]["rate"] == 0.0


def test_wrong_but_in_the_right_equation(tmp_path: Path) -> None:
    found = named(("external_leakage", "flow"))
    found["equivalent"] = [["entrained_air", "external_leakage"]]
    o = outcome(tmp_path, AIR, found)
    assert not o.first_right
    assert o.equations_right
    assert o.equivalent
    assert o.false == ("external_leakage",)


def test_one_too_many(tmp_path: Path) -> None:
    o = outcome(tmp_path, AIR, named(("entrained_air", "flow"), ("gravity_load", "force")))
    assert o.first_right
    assert not o.all_right
    assert o.false == ("gravity_load",)


def test_none_and_a_crash(tmp_path: Path) -> None:
    nothing = {"kind": "none", "undeclared": []}
    o = outcome(tmp_path, nothing, {"verdict": "none", "effects": [], "unknown": None})
    assert o.verdict == "none"
    assert math.isnan(o.holdout_ratio)
    (tmp_path / "crash").mkdir()
    o = outcome(tmp_path / "crash", nothing, None)
    assert o.verdict == "failed"
    summary = blind.summarise([o])
    assert summary["rates"]["crashed"]["rate"] == 1.0
    assert summary["failures"] == {"c": "ValueError: x"}
    assert "crashed: c" in blind.show(summary)


def test_foreign(tmp_path: Path) -> None:
    truth = {"kind": "foreign", "undeclared": [hidden("supply_sag", "actuation", ("torque",))]}
    found = {"verdict": "unknown", "effects": [], "unknown": {"equation": "torque"}}
    o = outcome(tmp_path, truth, found)
    summary = blind.summarise([o])
    assert summary["rates"]["foreign: unknown in the right equation"]["rate"] == 1.0
    found["unknown"] = {"equation": "flow"}
    o = outcome(tmp_path, truth, found)
    summary = blind.summarise([o])
    assert summary["rates"]["foreign: unknown in the right equation"]["rate"] == 0.0
    assert summary["rates"]["foreign: verdict unknown"]["rate"] == 1.0


def test_wilson_interval_against_published_values() -> None:
    # Newcombe, Statist. Med. 17 (1998), Table I, method 3: 81/263 and 0/20.
    r = blind.rate([True] * 81 + [False] * 182)
    assert (r["low"], r["high"]) == (
        pytest.approx(0.2553, abs=5e-5),
        pytest.approx(0.3662, abs=5e-5),
    )
    r = blind.rate([False] * 20)
    assert (r["low"], r["high"]) == (0.0, pytest.approx(0.1611, abs=5e-5))
