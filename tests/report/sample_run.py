"""A made-up run that looks like the paper's suite: trials, scores of every status, recordings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.limit import AcceptanceLimit, Bounds, SafetyLimit
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.core.signal import Edge, Signal, Tone
from eha_bench.core.trial import ControlMode, Piston, Setup, Trial

DEG = math.pi / 180.0
NASTY = "<script>alert(1)</script>"


@dataclass(frozen=True)
class StepSignal(Signal):
    before: float
    after: float
    at: float
    length: float

    @property
    def duration(self) -> float:
        return self.length

    def __call__(self, time: FloatArray) -> FloatArray:
        return np.where(time < self.at, self.before, self.after)

    @property
    def edges(self) -> tuple[Edge, ...]:
        return (Edge(self.at, self.before, self.after, self.length),)


@dataclass(frozen=True)
class SineSignal(Signal):
    tone: Tone

    @property
    def duration(self) -> float:
        return self.tone.stop

    def __call__(self, time: FloatArray) -> FloatArray:
        tone = self.tone
        return tone.offset + tone.amplitude * np.sin(
            2 * math.pi * tone.frequency * time + tone.phase
        )

    @property
    def tones(self) -> tuple[Tone, ...]:
        return (self.tone,)


def limit(
    metric: str, channel: str, low: float, high: float, text: str, unit: str
) -> AcceptanceLimit:
    return AcceptanceLimit(metric, channel, Bounds(low, high), text, unit)


def score(
    metric: str,
    channel: str,
    value: float,
    unit: str,
    status: ScoreStatus = ScoreStatus.PASSED,
    text: str = "",
    reason: str = "",
    spread: float = math.nan,
) -> Score:
    measure = Measure(value, value - spread, value + spread, reason)
    return Score(metric, channel, measure, unit, status, text)


def pressure_step(mega: float, response: float, current: float) -> tuple[Trial, TrialResult]:
    channel = "pressure_difference"
    limits = (
        limit("response_time", channel, response * 0.94, response * 1.06,
              f"{response * 1e3:.0f} ms +- 6 %", "s"),
        limit("holding_current", "current", current * 0.94, current * 1.06,
              f"{current:g} A +- 6 %", "A"),
        limit("overshoot", channel, 0.0, 0.35, "<= 35 %", ""),
    )  # fmt: skip
    if mega == 30:
        limits += (limit("peak", channel, 38e6, 41e6, "38 .. 41 MPa", "Pa"),)
    trial = Trial(
        id=f"pressure_step-{mega:g}MPa",
        signal=StepSignal(0.0, mega * 1e6, 0.001, 0.6),
        mode=ControlMode.PRESSURE,
        setup=Setup(piston=Piston.LOCKED),
        duration=0.6,
        settle=0.05,
        limits=limits,
        repeats=3 if mega == 20 else 1,
        safety=(SafetyLimit(channel, Bounds(-45e6, 45e6), "<= 45 MPa"),),
    )
    late = mega == 20
    held = mega == 30
    scores = (
        score("response_time", channel, response * (1.12 if late else 1.01), "s",
              ScoreStatus.FAILED if late else ScoreStatus.PASSED, limits[0].text, spread=2.3e-4),
        score("rise_time", channel, response * 0.62, "s", spread=2e-4),
        score("settling_time", channel, 0.1421, "s", spread=1.1e-3),
        score("holding_current", "current", current * (1.063 if held else 0.99), "A",
              ScoreStatus.FAILED if held else ScoreStatus.PASSED, limits[1].text, spread=0.05),
        score("overshoot", channel, 0.313, "", ScoreStatus.WARNED, limits[2].text, spread=0.004),
        score("peak_time", channel, 0.0541, "s"),
        score("peak", channel, mega * 1.313e6, "Pa", ScoreStatus.PASSED,
              limits[3].text if mega == 30 else "", spread=6e4),
        score("steady_state_error", channel, -21.4e3, "Pa", spread=9e3),
    )  # fmt: skip
    status = Status.FAILED if late or held else Status.PASSED
    return trial, TrialResult(
        trial.id, 0, status, f"recordings/{trial.id}-0.mcap", "ab" * 32, scores
    )


def pressure_recording(trial: Trial, seed: int, bend: float = 1.0) -> Recording:
    rng = np.random.default_rng(seed)
    time = trial.clock()
    reference = trial.reference(time)
    step = trial.signal.edges[0].after
    since = np.maximum(time - 0.001, 0.0)
    wn, zeta = 62.0 / bend, 0.35
    wd = wn * math.sqrt(1 - zeta**2)
    shape = 1 - np.exp(-zeta * wn * since) * (
        np.cos(wd * since) + zeta * wn / wd * np.sin(wd * since)
    )
    dp = step * shape
    speed = np.gradient(dp, time) * 6.6e-9 * 10
    current = np.clip(dp / 1.25e6 * 1.0 + speed * 0.05, -46, 46) * np.where(time > 0.001, 1, 0)
    return Recording(
        time,
        {
            "reference": reference,
            "current_command": current,
            "current": current + rng.normal(0, 0.15, time.size),
            "motor_speed": speed + rng.normal(0, 0.8, time.size),
            "pressure_a": 1e6 + np.maximum(dp, 0) + rng.normal(0, 6e4, time.size),
            "pressure_b": 1e6 - 0.02 * dp + rng.normal(0, 6e4, time.size),
        },
        units={"reference": "Pa"},
        metadata={"signal_start": "0.0"},
        notes=("resampled onto 1 kHz: 0 samples were made up",),
    )


def sine_recording(trial: Trial, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    time = trial.clock()
    tone = trial.signal.tones[0]
    angle = tone.offset + 0.97 * tone.amplitude * np.sin(
        2 * math.pi * tone.frequency * (time - 0.018) + tone.phase
    ) * (1 - np.exp(-np.maximum(time, 0) / 0.05))
    return Recording(
        time,
        {
            "reference": trial.reference(time),
            "joint_angle": angle + rng.normal(0, 2e-4, time.size),
            "current": 6.0 * np.cos(2 * math.pi * tone.frequency * time)
            + rng.normal(0, 0.2, time.size),
            "motor_speed": 120.0 * np.cos(2 * math.pi * tone.frequency * time)
            + rng.normal(0, 0.8, time.size),
            "pressure_a": 3e6 + 2e6 * np.sin(2 * math.pi * tone.frequency * time),
            "pressure_b": 3e6 - 2e6 * np.sin(2 * math.pi * tone.frequency * time),
            "piston_position": 0.02 * np.sin(2 * math.pi * tone.frequency * time),
            "oil_temperature": 313.0 + 0.1 * time,
        },
        units={"reference": "rad"},
        metadata={"signal_start": "0.0"},
    )


def knee_sine() -> tuple[Trial, TrialResult]:
    tone = Tone(0.0, 4.0, 1.0, 30 * DEG, 90 * DEG)
    limits = (
        limit("tracking_rms", "joint_angle", -math.inf, 4 * DEG, "<= 4 deg", "rad"),
        limit("phase_lag", "joint_angle", -math.inf, 6 * DEG, "<= 6 deg", "rad"),
        limit("amplitude_ratio", "joint_angle", 0.95, 1.05, "0.95 .. 1.05", ""),
        limit("distortion", "force", -math.inf, 0.05, "<= 5 %", ""),
    )
    trial = Trial(
        id="knee_sine-1Hz",
        signal=SineSignal(tone),
        mode=ControlMode.JOINT_ANGLE,
        setup=Setup(initial={"joint_angle": 90 * DEG}),
        duration=4.0,
        limits=limits,
    )
    scores = (
        score("tracking_rms", "joint_angle", 2.61 * DEG, "rad",
              ScoreStatus.PASSED, limits[0].text, spread=0.02 * DEG),
        score("tracking_max", "joint_angle", 4.9 * DEG, "rad"),
        score("tracking_nrmse", "joint_angle", 0.0434, ""),
        score("phase_lag", "joint_angle", 6.48 * DEG, "rad",
              ScoreStatus.UNDECIDED, limits[1].text, spread=0.6 * DEG,
              reason="the interval reaches over the limit; record more periods"),
        score("amplitude_ratio", "joint_angle", 0.971, "",
              ScoreStatus.PASSED, limits[2].text, spread=0.002),
        score("distortion", "force", math.nan, "",
              ScoreStatus.NOT_SCORED, limits[3].text, reason="no force"),
    )  # fmt: skip
    run = TrialResult(
        trial.id, 0, Status.FAILED, f"recordings/{trial.id}-0.mcap", "cd" * 32, scores,
        notes=("oil temperature rose by 0.4 K during the trial",),
    )  # fmt: skip
    return trial, run


def faulted() -> tuple[Trial, TrialResult]:
    text = "600 ms +- 5 %"
    limits = (limit("response_time", "joint_angle", 0.57, 0.63, text, "s"),)
    trial = Trial(
        id="knee_step-50-120deg",
        signal=StepSignal(50 * DEG, 120 * DEG, 0.1, 1.5),
        mode=ControlMode.JOINT_ANGLE,
        setup=Setup(initial={"joint_angle": 50 * DEG}),
        duration=1.5,
        limits=limits,
    )
    missing = score(
        "response_time", "joint_angle", math.nan, "s", ScoreStatus.NOT_SCORED, text,
        reason="the run stopped before the level was reached",
    )  # fmt: skip
    run = TrialResult(
        trial.id, 0, Status.FAULT, "", "", (missing,),
        reason="safety limit: pressure_a reached 45.2 MPa at 0.213 s (limit <= 45 MPa)",
    )  # fmt: skip
    return trial, run


@dataclass(frozen=True)
class SampleRun:
    result: Result
    recordings: dict[tuple[str, int], Callable[[], Recording]]
    trials: dict[str, Trial]


def sample_run(suite: str = "paper", *, fault: bool = True) -> SampleRun:
    trials: dict[str, Trial] = {}
    runs: list[TrialResult] = []
    recordings: dict[tuple[str, int], Callable[[], Recording]] = {}
    for mega, response, current in ((15, 0.039, 11.0), (20, 0.043, 15.8), (30, 0.050, 24.0)):
        trial, run = pressure_step(mega, response, current)
        trials[trial.id] = trial
        for repeat in range(trial.repeats):
            runs.append(
                TrialResult(
                    run.id, repeat, run.status, f"recordings/{trial.id}-{repeat}.mcap",
                    f"{repeat}f" * 32, run.scores, run.reason, run.notes,
                )
            )  # fmt: skip
            recordings[(trial.id, repeat)] = partial(
                pressure_recording, trial, repeat, 1.0 + 0.1 * repeat
            )
    trial, run = knee_sine()
    trials[trial.id] = trial
    runs.append(run)
    recordings[(trial.id, 0)] = partial(sine_recording, trial, 4)
    if fault:
        trial, run = faulted()
        trials[trial.id] = trial
        runs.append(run)
    result = Result(
        suite=suite,
        target="simulator",
        status=Result.overall(tuple(runs), complete=True),
        trials=tuple(runs),
        provenance={
            "version": "0.1.0",
            "revision": "d81d2b8",
            "host": "bench-2",
            "started": "2026-11-20T09:12:44+00:00",
            "model_sha256": "9c" * 32,
            "controller_sha256": "3e" * 32,
        },
        description="Acceptance of the knee actuator after the paper's Section 6.",
    )
    return SampleRun(result, recordings, trials)
