"""The format of a suite file: what its YAML may hold."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from eha_bench.core.trial import MODES, Bypass, Piston
from eha_bench.core.yaml_file import NUMBER, Real, StrictModel
from eha_bench.suites.acceptance.limits import BoundsFile, LimitFile, ScoreFile
from eha_bench.suites.identifiers import PATTERN
from eha_bench.suites.own_metrics import OwnMetricFile
from eha_bench.suites.signals.signal_model import Hertz, Moment, Seconds

Count = Annotated[int, Field(ge=1, le=10_000), NUMBER]
Seed = Annotated[int, Field(ge=0, lt=2**63), NUMBER]


CHANNEL = r"^[A-Za-z_][A-Za-z0-9_.]*$"
"""What a channel may be called."""


class SetupFile(StrictModel):
    """State of the rig during a trial."""

    piston: Piston = Piston.FREE
    bypass: Bypass = Bypass.CLOSED
    initial: dict[str, Real | str] = Field(
        default={}, description="start value by channel: joint_angle, piston_position ..."
    )


class RunKeys(StrictModel):
    """What a trial says about its run."""

    description: str = ""
    mode: str = Field(
        pattern=CHANNEL,
        description=f"{', '.join(mode.name for mode in MODES)}, the target's command, or any of "
        "its channels",
    )
    setup: SetupFile = SetupFile()
    duration: Seconds | None = Field(default=None, description="scored length, s")
    settle: Moment = Field(default=0.0, description="time before, not scored, s")
    sample_rate: Hertz = Field(default=1000.0, description="ticks per second, Hz")
    repeats: Count = 1
    seed: Seed = Field(default=0, description="of the first repeat; repeat r uses seed + r")


class TrialFile(RunKeys):
    """A trial, or with a matrix several."""

    id: Annotated[str, Field(pattern=PATTERN.replace("A-Z", "${}A-Z"))]
    matrix: dict[str, list[str | float] | dict[str, dict[str, Any] | None]] = Field(
        default={}, description="parameters; each combination is a trial, ${name} its values"
    )
    signal: dict[str, Any]
    accept: dict[str, str | LimitFile | list[str | LimitFile] | None] = Field(
        default={}, description="limit by metric; null for a metric without limit"
    )
    scores: list[str | ScoreFile] = Field(default=[], description="metrics without limit")
    safety: dict[str, str | BoundsFile] = Field(default={}, description="limit by channel")
    matters: dict[str, str | float] = Field(
        default={}, description="smallest difference that matters between results, by metric"
    )


class SuiteFile(StrictModel):
    """A suite."""

    name: Annotated[str, Field(pattern=PATTERN)] | None = None
    description: str = ""
    model: str | None = Field(default=None, description="model file, relative to this one")
    controller: str | None = Field(default=None, description="controller file, relative to this")
    target: str | None = Field(default=None, description="name of a target, or its file")
    baseline: str | None = Field(
        default=None, description="result.json that limits 'of baseline' are relative to"
    )
    metrics: dict[str, str | OwnMetricFile] = Field(
        default={}, description="user-defined metrics: an expression by name"
    )
    defaults: dict[str, Any] = Field(default={}, description="keys for trials that lack them")
    trials: Annotated[list[dict[str, Any]], Field(min_length=1)]
