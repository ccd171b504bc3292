"""What a user sees of uncertainty: budgets, and what is wrong with the samples, by the commands."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .conftest import Cli

SUITE = """\
name: walk
defaults: {sample_rate: 1 kHz, mode: pressure, setup: {piston: locked}}
trials:
  - id: step
    duration: 0.5 s
    signal: {kind: step, initial: 5 MPa, final: 15 MPa, at: 0.1 s}
  - id: sine
    duration: 2 s
    signal: {kind: sine, amplitude: 5 MPa, offset: 10 MPa, frequency: 5 Hz, cycles: 10}
"""
CHANNELS = """\
time: {column: time, unit: s}
channels:
  reference: {column: ref, unit: MPa}
  pressure_difference: {column: dp, unit: MPa%s}
"""
NOISE = 0.02 * np.random.default_rng(0).normal(size=2000)


def second_order(time: np.ndarray) -> np.ndarray:
    """From 0 to 1 with damping 0.6 and 80 rad/s: 9.5 % overshoot."""
    after, root = np.maximum(time, 0.0), math.sqrt(1.0 - 0.36)
    angle = 80.0 * root * after
    return 1.0 - np.exp(-48.0 * after) * (np.cos(angle) + 0.6 / root * np.sin(angle))


def step() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time in s, reference and pressure in MPa."""
    time = np.arange(0.0, 0.6, 1e-3)
    moved = 5.0 + 10.0 * second_order(time - 0.1) + NOISE[: time.size]
    return time, np.where(time >= 0.1 - 1e-9, 15.0, 5.0), moved


@pytest.fixture
def scored(cli: Cli, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Score columns by the command, and return the scores by metric."""

    def run(*columns: np.ndarray, trial: str = "step", sensor: str = "") -> dict[str, Any]:
        (tmp_path / "suite.yaml").write_text(SUITE, encoding="utf-8")
        (tmp_path / "channels.yaml").write_text(CHANNELS % sensor, encoding="utf-8")
        table = np.column_stack(columns)
        rows = (",".join("" if math.isnan(v) else f"{v:.9g}" for v in row) for row in table)
        (tmp_path / "log.csv").write_text("time,ref,dp\n" + "\n".join(rows), encoding="utf-8")
        given = ("--suite", "suite.yaml", "--channels", "channels.yaml", "--trial", trial)
        cli("score", "log.csv", *given, "--out", "out", check=0)
        content = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
        return {score["metric"]: score for score in content["trials"][0]["scores"]}

    return run


def sources(score: dict[str, Any]) -> dict[str, float]:
    """Standard uncertainties by source and type."""
    return {f"{part['source']} {part['type']}": part["standard"] for part in score["budget"]}


def test_a_sensor_of_channels_yaml_is_in_the_budget_and_on_the_page(scored, tmp_path):
    plain = scored(*step())["steady_state_error"]
    known = scored(*step(), sensor=", resolution: 2 bar, uncertainty: 0.5 %")["steady_state_error"]
    budget = sources(known)
    assert budget["resolution B"] == pytest.approx(2e5 / math.sqrt(12.0), rel=1e-3)
    assert budget["sensor B"] == pytest.approx(0.005 * 15e6, rel=0.01)
    assert known["high"] - known["low"] > 10.0 * (plain["high"] - plain["low"])
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Standard uncertainty: " in page
    assert "resolution" in page


def test_clipped_readings_have_an_interval_without_an_end(scored):
    time, reference, values = step()
    overshoot = scored(time, reference, np.minimum(values, 15.4))["overshoot"]
    assert "clipped: " in overshoot["reason"]
    assert overshoot["open"] == "above"
    assert overshoot["high"] is None
    # of 15 MPa, clipped at 15.4: less than it truly is
    assert 0.0 < overshoot["low"] <= scored(time, reference, values)["overshoot"]["value"]


def test_outliers_losses_and_impossible_values_are_said(scored):
    time, reference, values = step()
    spiked = values.copy()
    spiked[[80, 300, 450]] += [5.0, -5.0, 1.5e7]  # one of them 1.5e13 Pa
    found = scored(time, reference, spiked)
    assert "3 outlier(s) replaced by their neighbours" in found["overshoot"]["reason"]
    kept = np.random.default_rng(1).random(time.size) > 0.05
    found = scored(time[kept], reference[kept], values[kept])
    assert "sample(s) lost (" in found["rise_time"]["reason"]
    found = scored(time, reference, 1e6 * values)
    assert "Pa is beyond the range of any such sensor" in found["peak"]["reason"]


def test_few_samples_a_rise_are_said_and_in_the_budget(scored):
    time, reference, values = (column[::8] for column in step())
    found = scored(time, reference, values)["rise_time"]
    assert "few samples: " in found["reason"]
    assert sources(found)["interpolation B"] > 3e-4


def test_one_late_sample_without_a_value_removes_nothing(scored):
    time, reference, values = step()
    values[470] = math.nan
    found = scored(time, reference, values)
    for name in ("overshoot", "rise_time", "settling_time", "steady_state_error"):
        assert found[name]["value"] is not None
        assert "1 sample(s) without a value not used" in found[name]["reason"]


def test_lags_beyond_270_degrees_are_not_wrapped(scored):
    time = np.arange(0.0, 2.0, 1e-3)
    turn = 2.0 * math.pi * 5.0 * time
    for degrees in (200.0, 300.0, 500.0):
        late = np.sin(np.maximum(turn - math.radians(degrees), 0.0))
        found = scored(time, 10.0 + 5.0 * np.sin(turn), 10.0 + 4.0 * late + NOISE, trial="sine")[
            "phase_lag"
        ]
        assert math.degrees(found["value"]) == pytest.approx(degrees, abs=0.5)
        assert ("whole turn(s)" in found["reason"]) == (degrees > 270.0)
