"""`python -m benchmarks.lives`: lives of machines that wear, watched night by night.

Every life is a rig of its own (`fixtures/rig`: other equations' code, integrator and sensors than
the models that are fitted), run every night through the same two short trials. Its parameters are
its own, its oil is warmer and colder, friction and stiffness vary a little, nights are missing,
runs fail. In most lives one cause wears from some night on, in a straight line; in the others none
does. Each night after the eighth is looked at as `history --diagnose` would look at it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from benchmarks.table import Row, report_rows
from fixtures.rig import kernel
from fixtures.rig.commands import Run
from fixtures.rig.parameters import CALIBRATED, DECLARED
from fixtures.rig.plant import Plant
from fixtures.rig.sensors import COLUMNS, Bench, measured

from eha_bench.bench.run import run_suite
from eha_bench.causes.follow import causes_behind
from eha_bench.causes.settings import CauseSettings, load_cause_settings
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.metrics import score
from eha_bench.suites import Suite, load_suite
from eha_bench.targets.target import Ending, Identity, Outcome, Stopping, Target, never
from eha_bench.trends.history import History, history_of
from eha_bench.trends.index import Index, update
from eha_bench.trends.wear import MATTERS

SUITE = """\
name: nightly
defaults: {sample_rate: 1 kHz}
metrics:
  travel: {expression: max(piston_position) - min(piston_position), unit: mm}
trials:
  - id: steps
    mode: pressure
    setup: {piston: locked, initial: {piston_position: 0 mm}}
    settle: 0.1 s
    duration: 0.75 s
    signal: {kind: steps, initial: 0 MPa, levels: [20 MPa, 8 MPa], hold: 0.35 s, at: 50 ms}
    accept:
      response_time: <= 49 ms
      overshoot: <= 25 %
      steady_state_error: +- 0.2 MPa
      holding_current: 18.2 A .. 19.9 A
  - id: swing
    mode: current
    setup: {piston: free, initial: {piston_position: 0 mm}}
    duration: 1 s
    signal: {kind: sine, amplitude: 14 A, offset: 1 A, frequency: 2 Hz, cycles: 2}
    accept:
      travel: 10.2 mm .. 12.6 mm
"""
MODEL = """\
model: eha_knee
parameters: {current_limit: 36 A, stribeck_speed: 18 rad/s, external_force: 300 N,
  rotor_inertia: 0.001 kg*m^2, leakage: 1e-13 m^3/(s*Pa), bypass_conductance: 6e-10 m^3/(s*Pa)}
calibrate: [coulomb_torque, static_torque, viscous_torque, leakage, bulk_modulus, rotor_inertia,
  rod_viscous, rod_coulomb, external_force]
effects:
  - {effect: anti_cavitation, charge_pressure: 0.6 MPa, valve_conductance: 6e-10 m^3/(s*Pa)}
"""
CONTROLLER = """\
pressure: {controller: pressure_pi, k_1: 1.0137 A/MPa, k_p: 2 A/MPa, k_i: 30 A/(MPa*s),
  k_2: 0.44 A*s/rad}
"""
TARGET = """\
target: simulator
model: model.yaml
controller: controller.yaml
step: 50 us
"""
NIGHTLY = """\
diagnose:
  model: model.yaml
  suite: suite.yaml
  target: target.yaml
  follow: [command_delay, current_lag, entrained_air, external_leakage, joint_backlash,
    pressure_dependent_friction, pressure_sensor_lag, pressure_sensor_offset, seal_friction,
    turbulent_leakage, asymmetric_friction]
"""
FIRST = datetime(2025, 1, 6, 2, 0, tzinfo=UTC)
REFERENCE = 313.15


@dataclass(frozen=True)
class Kind:
    """A way to wear: what of the rig grows, from where, in which steps, and what it is called."""

    name: str
    parameter: str
    start: float
    step: float
    answers: tuple[str, ...]


KINDS = (
    Kind("leak", "leakage", math.nan, 1e-14, ("leakage",)),
    Kind(
        "pump friction", "coulomb_torque", math.nan, 0.005, ("coulomb_torque", "coulomb_friction")
    ),
    Kind("seal", "seal_friction", 0.0, 0.005, ("seal_friction",)),
    Kind("air", "air_fraction", 0.0, 0.001, ("entrained_air",)),
    Kind("delay", "command_delay", 0.0, 2e-4, ("command_delay",)),
    Kind("backlash", "backlash", 0.0, 5e-5, ("joint_backlash",)),
    Kind("sensor drift", "pressure_offset_a", 0.0, 3e4, ("pressure_sensor_offset at pressure_a",)),
)


class OwnRig(Target):
    """The rig of `fixtures/rig` as a target: pressure in a closed loop, or a current."""

    def __init__(self, settings: Mapping[str, float], seed: Sequence[int], oil: float) -> None:
        self._plant, self._seed, self._oil = Plant(settings), list(seed), oil
        self.failing = ""

    @property
    def identity(self) -> Identity:
        """Its name."""
        return Identity("own_rig")

    def check(self, trial: Trial) -> None:
        """Every trial of the suite can be run."""

    def run(self, trial: Trial, repeat: int, stopping: Stopping = never) -> Outcome:
        """Run a trial from rest."""
        del stopping
        time_, reference = trial.clock(), trial.reference(trial.clock())
        loop = trial.mode.name == "pressure"
        asked = reference * 1e-6 if loop else reference
        run = Run(
            trial.id, trial.setup.piston is Piston.LOCKED, trial.setup.bypass is Bypass.OPEN,
            False, kernel.PRESSURE_LOOP if loop else kernel.OPEN_LOOP, 0, asked,
            np.zeros_like(asked),
        )  # fmt: skip
        readings, command = self._plant.at_mid_stroke(run)
        if self._seed:
            noise = np.random.default_rng([*self._seed, repeat, len(trial.id)])
            readings = measured(readings, Bench(), noise)
        values = {"reference": reference, "current_command": command}
        values |= {name: readings[:, k] for k, name in enumerate(COLUMNS)}
        if math.isfinite(self._oil):
            values["oil_temperature"] = np.full(time_.size, self._oil)
        about = {"signal_start": repr(float(abs(time_[0])))}
        units = {"reference": trial.mode.unit}
        recording = Recording(time_ - time_[0], values, units, metadata=about)
        if trial.id == self.failing:
            return Outcome(recording, Ending.FAULT, "it was made to fail")
        return Outcome(recording)


@dataclass(frozen=True)
class Life:
    """One machine's nights, and what wears.

    Attributes:
        kind: what wears, None for nothing. own: its rig parameters. start: night from which on it
            wears. rate: a night, SI. limit: value at which the first limit is missed, SI.
        oil: (nights,) K. logged: whether it is. seed: of everything.
    """

    kind: Kind | None
    own: Mapping[str, float]
    start: int
    rate: float
    limit: float
    oil: tuple[float, ...]
    logged: bool
    seed: int

    def worn(self, night: int) -> float:
        """Return the value of what wears at a night."""
        assert self.kind is not None
        return _begin(self.kind, self.own) + self.rate * max(0, night - self.start)

    def settings(self, night: int) -> dict[str, float]:
        """Return the rig's parameters at a night."""
        rng = np.random.default_rng([self.seed, 1, night])
        found = dict(self.own)
        for name, spread in (
            ("coulomb_torque", 3e-3),
            ("bulk_modulus", 3e-3),
            ("rod_coulomb", 5e-3),
        ):
            found[name] *= 1.0 + spread * float(rng.standard_normal())
        if self.kind is not None:
            grown = self.worn(night) - _begin(self.kind, self.own)
            found[self.kind.parameter] = found.get(self.kind.parameter, 0.0) + grown
        warmer = self.oil[night] - REFERENCE
        found["leakage"] *= math.exp(0.015 * warmer)
        for name in ("viscous_torque", "rod_viscous"):
            found[name] *= math.exp(-0.015 * warmer)
        return found


def _begin(kind: Kind, own: Mapping[str, float]) -> float:
    return own[kind.parameter] if math.isnan(kind.start) else kind.start


def life_of(seed: int, suite: Suite, nights: int, *, wears: bool) -> Life:
    """Draw a machine and what becomes of it."""
    rng = np.random.default_rng([seed, 0])
    # as machines of one series differ; the limits leave room for that
    own = {name: DECLARED[name] * float(rng.uniform(0.97, 1.03)) for name in CALIBRATED}
    season = 2.5 * np.sin(2.0 * math.pi * (np.arange(nights) / rng.uniform(25, 90) + rng.random()))
    oil = REFERENCE + season + rng.normal(0.0, 1.0, nights)
    logged = bool(rng.random() < 0.75)
    if not wears:
        return Life(None, own, nights, 0.0, math.nan, tuple(oil), logged, seed)
    kind = KINDS[seed % len(KINDS)]
    limit = first_missed(kind, own, suite)
    start = int(rng.integers(12, 22))
    rate = (limit - _begin(kind, own)) / float(rng.uniform(20.0, 45.0))
    return Life(kind, own, start, rate, limit, tuple(oil), logged, seed)


def first_missed(kind: Kind, own: Mapping[str, float], suite: Suite) -> float:
    """Return the value of what wears at which the noiseless rig misses its first limit."""

    def kept(value: float) -> bool:
        rig = OwnRig({**own, kind.parameter: value}, (), math.nan)
        return all(
            limit.bounds.holds(item.value)
            for trial in suite.trials
            for limit in trial.limits
            for item in score(rig.run(trial, 0).recording, trial)
            if item.metric == limit.metric
        )

    low, step = _begin(kind, own), kind.step
    assert kept(low), f"{kind.name}: limits are missed by the healthy machine"
    high = low + step
    while kept(high):
        low, step = high, 1.6 * step
        high = low + step
    for _ in range(9):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(middle) else (low, middle)
    return 0.5 * (low + high)


def record(life: Life, folder: Path, night: int, suite: Suite) -> bool:
    """Record a night; False where it is missing."""
    rng = np.random.default_rng([life.seed, 2, night])
    if rng.random() < 0.08:
        return False
    oil = life.oil[night] + float(rng.normal(0.0, 0.2)) if life.logged else math.nan
    rig = OwnRig(life.settings(night), (life.seed, 3, night), oil)
    rig.failing = "swing" if rng.random() < 0.03 else ""
    place = folder / f"{night:03d}"
    run_suite(suite, rig, place)
    file = place / "result.json"
    result = Result.read(file)
    when = {"recorded": (FIRST + timedelta(days=night)).isoformat()}
    replace(result, provenance={**result.provenance, **when}).write(file)
    return True


@dataclass
class LifeSeen:
    """What was said of a life."""

    seed: int
    kind: str
    logged: bool
    looks: int = 0
    false_alarms: int = 0
    due: int = -1
    found: int = -1
    cause: str = ""
    right: bool = False
    truth_left: float = math.nan
    left: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    seconds_a_night: float = math.nan
    rivals: tuple[str, ...] = ()
    forecasts: tuple[tuple[float, float, float, float], ...] = ()


def cut(index: Index, place: int) -> Index:
    """Return an index as it was after a night."""
    nights = index.nights[: place + 1]
    ids = {night.id for night in nights}
    return Index(nights, tuple(item for item in index.entries if item.run in ids), ())


def lived(life: Life, nights: int, folder: Path, watch: CauseSettings, suite: Suite) -> LifeSeen:
    """Record a life and look at every night of it."""
    name = life.kind.name if life.kind is not None else "none"
    said = LifeSeen(life.seed, name, life.logged)
    if life.kind is not None:
        way = abs(life.limit - life.worn(0))
        said.due = life.start + math.ceil(MATTERS * way / abs(life.rate))
    last = nights if life.kind is None else min(nights, said.due + 10)
    site, forecasts = folder / "site", []
    site.mkdir(parents=True)
    recorded: list[int] = []
    spent = 0.0
    for night in range(last):
        if not record(life, folder / "nights", night, suite):
            continue
        recorded.append(night)
        if len(recorded) < 9 or (life.kind is not None and night < life.start):
            continue
        index = update(site / "index.sqlite", folder / "nights")
        history = History(str(folder), index.nights, ())
        began = time.perf_counter()
        causes = causes_behind(history, folder / "nights", site, watch)
        if causes.wear:  # only where something wears do limits need the metrics
            history = replace(history, trends=history_of(index, str(folder)).trends)
            causes = causes_behind(history, folder / "nights", site, watch)
        spent = time.perf_counter() - began
        said.looks += 1
        if not causes.alarms:
            continue
        wear = causes.alarms[0]
        if life.kind is None or night < life.start:
            said.false_alarms += 1
            continue
        if said.found < 0:
            said.found, said.cause, said.seconds_a_night = night, wear.trend.name, spent
            said.right = wear.trend.name.startswith(life.kind.answers)
            said.rivals = wear.rivals
        if wear.nights_left is not None and night >= said.found:
            truth = (life.limit - life.worn(night)) / life.rate
            number = wear.nights_left
            forecasts.append((truth, number.value, number.low, number.high))
            if math.isnan(said.truth_left):
                said.truth_left, said.left = truth, (number.value, number.low, number.high)
    said.forecasts = tuple(forecasts)
    return said


def main() -> int:
    """Print a line a life, and the sums."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lives", description=__doc__)
    parser.add_argument("--lives", type=int, default=7)
    parser.add_argument("--healthy", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--nights", type=int, default=60)
    parser.add_argument("--json", type=Path, help="write the figures as rows of JSON")
    parser.add_argument("--keep", type=Path, help="folder for the nights (default: a passing one)")
    chosen = parser.parse_args()
    outcomes: list[LifeSeen] = []
    with tempfile.TemporaryDirectory(prefix="eha-lives-") as name:
        top = chosen.keep or Path(name)
        top.mkdir(parents=True, exist_ok=True)
        for file, text in (
            ("suite.yaml", SUITE), ("model.yaml", MODEL), ("controller.yaml", CONTROLLER),
            ("target.yaml", TARGET), ("nightly.yaml", NIGHTLY),
        ):  # fmt: skip
            (top / file).write_text(text, encoding="utf-8")
        suite, watch = load_suite(top / "suite.yaml"), load_cause_settings(top / "nightly.yaml")
        count = chosen.lives + chosen.healthy
        for number in range(count):
            wears = number < chosen.lives
            seed = chosen.first + number
            life = life_of(seed, suite, chosen.nights, wears=wears)
            folder = top / f"life{seed}"
            outcomes.append(lived(life, chosen.nights, folder, watch, suite))
            print(outcomes[-1], flush=True)
            if chosen.keep:
                said = json.dumps([asdict(item) for item in outcomes])
                (chosen.keep / "lives.json").write_text(said, encoding="utf-8")
    rows = rows_from(outcomes)
    return report_rows(chosen.json, rows)


def rows_from(outcomes: Sequence[LifeSeen]) -> list[Row]:
    """Return the figures that the lives come to."""
    worn = [item for item in outcomes if item.kind != "none"]
    looks = sum(item.looks for item in outcomes if item.kind == "none")
    false = sum(item.false_alarms for item in outcomes if item.kind == "none")
    rows = []
    if looks:  # fewer nights than a thousand cannot bear the target out
        target = 1.0 if looks >= 1000 else math.nan
        share = 1000.0 * false / looks
        note = f"{false} in {looks}"
        rows.append(Row("alarms in 1,000 healthy nights", share, "", "<", target, note))
    if worn:
        right = sum(item.right for item in worn)
        soon = sum(0 <= item.found <= item.due + 5 for item in worn)
        many = f"of {len(worn)}"
        rows.append(Row("right cause", 100.0 * right / len(worn), "%", ">", 90.0, many))
        rows.append(Row("found in 5 nights", 100.0 * soon / len(worn), "%", ">", 90.0, many))
    held = [
        item.left[1] <= item.truth_left <= item.left[2]
        for item in worn
        if math.isfinite(item.truth_left)
    ]
    if held:
        share = 100.0 * sum(held) / len(held)
        note = f"of {len(held)}"
        rows.append(Row("interval of nights left", share, "%", ">", 90.0, note))
    known = [item.seconds_a_night for item in worn if math.isfinite(item.seconds_a_night)]
    if known:
        rows.append(Row("a night", max(known), "s", "<", 60.0))
    return rows


if __name__ == "__main__":
    sys.exit(main())
