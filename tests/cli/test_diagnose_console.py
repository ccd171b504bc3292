"""What `diagnose` prints of its verdict."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from eha_bench.cli import closing
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, Unknown, Verdict
from eha_bench.plants.model import Model

MODEL = Model("linear_drive")
MASS = {"platen.mass": Estimate(449.85, 449.23, 450.48, "kg")}
NOTHING = Diagnosis(Verdict.NONE, MODEL, MODEL, calibrated=MASS)


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    lines: list[str] = []
    monkeypatch.setattr(closing, "say", lines.append)
    return lines


def test_where_nothing_is_missing_the_calibrated_values_are_shown(said: list[str]) -> None:
    closing._say_verdict(NOTHING)
    assert said == [
        "verdict: none",
        "  calibrated",
        "    platen.mass  449.85 kg  (449.23 … 450.48)",
    ]


def test_without_an_interval_the_reason_stands_there(said: list[str]) -> None:
    ended = SimpleNamespace(has_intervals=False, converged=False)
    bent = {name: item.without_interval for name, item in MASS.items()}
    closing._say_verdict(replace(NOTHING, calibrated=bent, convergence=ended))
    assert said[-1].endswith("(no interval: not converged)")


def test_values_that_something_missing_has_bent_are_not(said: list[str]) -> None:
    unknown = Unknown("force", ("piston_position",), "")
    closing._say_verdict(replace(NOTHING, verdict=Verdict.UNKNOWN, unknown=unknown))
    assert said == [
        "verdict: unknown",
        "  unknown effect in the force equation, depends on piston_position",
    ]


def test_a_speed_that_nobody_logs_is_named_with_its_position(said: list[str]) -> None:
    derived = {"table_speed": "table_angle"}
    unknown = Unknown("torque", ("table_speed",), "", at="table", derived=derived)
    closing._say_verdict(replace(NOTHING, verdict=Verdict.UNKNOWN, unknown=unknown))
    assert said[-1] == (
        "  unknown effect in the torque equation, at table, depends on table_speed (derivative of "
        "table_angle)"
    )
