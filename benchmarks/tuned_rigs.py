"""`python -m benchmarks.tuned_rigs`: do gains that were tuned for a machine pass on the machine?

A rig with an undeclared effect (`benchmarks.tuned_machines`: equations of their own) makes
recordings. They are diagnosed, and gains are tuned over the posterior of the revised model. Then
the rig itself runs the suite, again and again with other noise. The suite asks for steps; its
limits of response time and overshoot are what the best gains reach on the declared model, found by
a search, times one factor between FACTORS[0] and FACTORS[1].

Counted:

* tuned rigs that pass where any gains pass. A rig passes with gains where at least half of its
  repeats keep all limits. Any gains: the tuned ones, those tuned for the declared model, the
  shipped ones, or else what a search on the rig itself finds.
* the same of the gains that were tuned for the declared model.
* 'infeasible' that is right, of the rigs of which the tuning said it: no gains pass on the rig.
  And rigs on which none pass, of which it was said.
* P(pass) as stated beside the share of repeats that pass, by tenths of what was stated, in two
  kinds. As asked: of each of four gains (tuned; of the declared model; shipped; one drawn from
  their ranges) at the suite's limits. Most of these are 0 or 1, so that they fill few tenths.
  Drawn: of the same gains at limits that one more draw of the posterior just keeps: of the
  response, of the overshoot, of both. These lie within what is not known of the machine, by design
  as often in one tenth as in another, and any error of the model that the posterior does not hold
  shows in them. Rigs, not pairs, are drawn again for the intervals: pairs of a rig are alike.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.rig_loop import RigSimulator
from benchmarks.table import Row, report_rows
from benchmarks.tuned_machines import KNEE, SERVO, VALVE, VARY, recorded

from eha_bench.control.controller_file import load_controllers
from eha_bench.core.arrays import BoolArray, FloatArray
from eha_bench.core.errors import InputError
from eha_bench.core.shipped import shipped_file
from eha_bench.core.workers import IN_PROCESS, workers_from
from eha_bench.plants.model import Model, load_model
from eha_bench.posterior.file import read_posterior
from eha_bench.posterior.posterior import Posterior
from eha_bench.suites import Suite, load_suite
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.design import LatinHypercube
from eha_bench.sweeps.evaluation import figures_of_case
from eha_bench.sweeps.extrapolation import Extrapolation
from eha_bench.sweeps.probability import probability
from eha_bench.sweeps.space import Point, Space
from eha_bench.targets.simulator import Simulator
from eha_bench.tuning.tune import SearchEffort, Tuned, gains_space, tune
from eha_bench.tuning.vary_file import VaryFile, load_vary

REPEATS = 10
"""Runs of the suite on the rig, each with other noise."""
FIRST_REPEAT = 1000
"""Number of the first one's noise, which no draw has."""
NOISES = 100_000
"""Numbers of noise that a rig has to itself."""
FRONTIER = 32
"""Gains that are tried on the declared model to know what can be asked."""
FACTORS = (0.95, 1.15)
"""Of what the declared model can do at best, the range that limits are drawn from."""
ENOUGH = 0.5
"""Share of the repeats that have to pass for the rig to count as passing."""
GOALS = {"passing where any gains pass": 95.0, "infeasible right": 95.0, "stated off by": 5.0}
RESAMPLED = 1000
"""Draws of rigs for an interval."""


@dataclass(frozen=True)
class Said:
    """P(pass) that was stated, beside the share of repeats that passed on the rig.

    Attributes:
        gains: which ones. limits: 'asked', or what was drawn. stated, passed: from 0 to 1.
    """

    gains: str
    limits: str
    stated: float
    passed: float


@dataclass(frozen=True)
class Outcome:
    """One rig, from its recordings to its run with tuned gains.

    Attributes:
        plant, truth, number: the rig. verdict, named: of its diagnosis. factor: of the limits.
        feasible: what the tuning said. any_passes: what the rig says. searched: whether it took a
            search on the rig to say so. said: stated and passed, of several gains and limits.
        least_margin: of the tuned gains at the model as fitted. beyond: channels that they take
            further than the recordings, or a setup that these do not have.
        seconds: of diagnosis, tuning and all the rest; 0 for a diagnosis made before.
    """

    plant: str
    truth: str
    number: int
    verdict: str
    named: tuple[str, ...]
    factor: float
    feasible: bool
    any_passes: bool
    searched: bool
    least_margin: float
    beyond: tuple[str, ...]
    said: tuple[Said, ...] = field(repr=False)
    seconds: tuple[float, float, float]

    def asked(self, gains: str) -> Said:
        """What was stated and what happened with some gains at the suite's limits."""
        return next(i for i in self.said if i.gains == gains and i.limits == "asked")

    @property
    def works(self) -> bool:
        """Whether the rig passes with the tuned gains."""
        return self.asked("tuned").passed >= ENOUGH

    @staticmethod
    def from_json(content: dict[str, Any]) -> Outcome:
        """Return what was kept of a rig."""
        lists = {key: tuple(content[key]) for key in ("named", "beyond", "seconds")}
        said = tuple(Said(**item) for item in content["said"])
        return Outcome(**{**content, **lists, "said": said})


LOOSE = (1e4, 1e5)
"""Limits of overshoot, %, and response, ms, that say nothing."""


@dataclass(frozen=True)
class Steps:
    """Steps that a plant is asked for: what a trial says, their sizes, and the error allowed."""

    own: dict[str, object]
    zero: str
    sizes: tuple[str, ...]
    at: str
    left: str


STEPS = {
    KNEE: Steps(
        {"mode": "pressure", "setup": {"piston": "locked"}, "settle": "50 ms",
         "duration": "250 ms"}, "0 MPa", ("15 MPa", "8 MPa"), "1 ms", "0.4 MPa",
    ),
    SERVO: Steps(
        {"mode": "angle", "settle": "50 ms", "duration": "2 s", "sample_rate": "200 Hz"},
        "0 deg", ("40 deg",), "20 ms", "0.5 deg",
    ),
    VALVE: Steps(
        {"mode": "piston_position", "settle": "50 ms", "duration": "600 ms"},
        "0 mm", ("20 mm",), "5 ms", "0.2 mm",
    ),
}  # fmt: skip


def suite_of(plant: str, overshoot: float, response: float) -> Suite:
    """Return steps with limits of overshoot, %, and response, ms."""
    steps = STEPS[plant]
    limits = {
        "response_time": f"<= {response:.4f} ms",
        "steady_state_error": f"+- {steps.left}",
        "overshoot": f"<= {overshoot:.4f} %",
    }
    trials = [
        {"id": f"step_{k}", **steps.own, "accept": limits,
         "signal": {"kind": "step", "initial": steps.zero, "final": size, "at": steps.at}}
        for k, size in enumerate(steps.sizes)
    ]  # fmt: skip
    return load_suite({"name": "tuned", "trials": trials})


def reached(suite: Suite, margins: FloatArray) -> FloatArray:
    """Return what was reached of the limits of response, s, and overshoot, (n, 2), by margins.

    The largest of the steps; NaN where one is not scored.
    """
    limits = [limit for trial in suite.trials for limit in trial.limits]
    columns = []
    for metric in ("response_time", "overshoot"):
        own = [
            limit.bounds.high - margins[:, place] * abs(limit.bounds.high)
            for place, limit in enumerate(limits)
            if limit.metric == metric
        ]
        columns.append(np.max(own, axis=0))
    return np.column_stack(columns)


@dataclass(frozen=True)
class Bench:
    """A rig that was diagnosed, and all that suites are run on.

    Attributes:
        plant: its name. declared, revised: the models, as simulators. rig: itself.
        posterior: of the revised model. vary: the gains. draws: of P(pass).
    """

    plant: str
    declared: Simulator
    revised: Simulator
    rig: RigSimulator
    posterior: Posterior
    vary: VaryFile
    draws: int
    candidates: int
    workers: str

    def space(self, suite: Suite, simulator: Simulator) -> Space:
        """The gains, with a suite on a simulator."""
        return gains_space(Case(suite, simulator), self.vary)

    def tuned(
        self, suite: Suite, simulator: Simulator, posterior: Posterior | None, candidates: int
    ) -> Tuned:
        """Tune gains on a simulator, or on a rig in its place."""
        effort = SearchEffort(candidates=candidates, draws=self.draws, seed=1)
        workers = workers_from(self.workers) if self.workers else IN_PROCESS
        case = Case(suite, simulator)
        return tune(case, self.vary, posterior, effort=effort, workers=workers)

    def on_rig(self, suite: Suite, point: Point) -> FloatArray:
        """Return the margins of all repeats on the rig, (repeats, limits)."""
        case = self.space(suite, self.declared).at(point)
        case = replace(case, simulator=self.rig.varied(controllers=case.simulator.controllers))
        repeats = range(FIRST_REPEAT, FIRST_REPEAT + REPEATS)
        return np.array([figures_of_case(case, repeat).margins for repeat in repeats])

    def over_draws(self, suite: Suite, point: Point, draws: int, seed: int) -> FloatArray:
        """Return the margins of all draws, (draws, limits)."""
        case = self.space(suite, self.revised).at(point)
        found = probability(case, self.posterior, draws, seed=seed, bands=False)
        return found.margins


def near_the_best(
    bench: Bench, rng: np.random.Generator
) -> tuple[Suite, float, Point, tuple[Point, ...]]:
    """Return limits about what the best gains reach on the declared model, and their factor.

    Of gains spread over their ranges those are taken that overshoot least for how fast they are;
    a search makes both better by the same share. Also returned: the gains that it ends with, and
    those of the spread ones that settle.
    """
    loose = suite_of(bench.plant, *LOOSE)
    space = bench.space(loose, bench.declared)
    points = LatinHypercube(FRONTIER, int(rng.integers(1 << 30))).points(space)
    margins = np.array([figures_of_case(space.at(point), 0).margins for point in points])
    values = reached(loose, margins)
    settled = np.flatnonzero(np.isfinite(values).all(axis=1))
    at_most = values[settled, 0].min() * float(rng.uniform(1.0, 1.5))
    quick = [place for place in settled if values[place, 0] <= at_most]
    response, overshoot = min((values[place] for place in quick), key=lambda item: float(item[1]))
    wish = suite_of(bench.plant, 100.0 * max(overshoot, 0.01), 1e3 * response)
    best = bench.tuned(wish, bench.declared, None, bench.candidates)
    response, overshoot = reached(wish, np.array([best.margins]))[0]
    factor = float(rng.uniform(*FACTORS))
    suite = suite_of(bench.plant, 100.0 * factor * max(overshoot, 0.01), 1e3 * factor * response)
    return suite, factor, best.point, tuple(points[place] for place in settled)


def with_noise(suite: Suite, seed: int) -> Suite:
    """Return a suite whose runs have other noise."""
    return replace(suite, trials=tuple(replace(trial, seed=seed) for trial in suite.trials))


def kept(margins: FloatArray) -> BoolArray:
    """Return which runs keep all limits, (n,)."""
    return np.asarray((margins >= 0.0).all(axis=1))


def said_of(
    bench: Bench, suite: Suite, gains: str, point: Point, stated: FloatArray, number: int
) -> list[Said]:
    """Return what is stated of gains beside what the rig does, at several limits.

    Args:
        bench: the rig. suite: as asked. gains: their name. point: they. stated: margins over draws.
        number: of the rig, that limits are drawn by.
    """
    happened = bench.on_rig(suite, point)
    found = [Said(gains, "asked", float(kept(stated).mean()), float(kept(happened).mean()))]
    of_draws, of_rig = reached(suite, stated), reached(suite, happened)
    chosen: dict[str, list[int]] = {"response": [0], "overshoot": [1], "both": [0, 1]}
    # draws that state nothing, of another seed than those that do
    noisy = with_noise(suite, NOISES * number + NOISES // 2)
    others = reached(suite, bench.over_draws(noisy, point, len(chosen), 1_000_000 + number))
    for (limits, columns), most in zip(chosen.items(), others, strict=True):
        most_of_these = most[columns]
        if np.isfinite(most_of_these).all():
            shares = [
                float((own[:, columns] <= most_of_these).all(axis=1).mean())
                for own in (of_draws, of_rig)
            ]
            found.append(Said(gains, limits, *shares))
    return found


def run_case(plant: str, number: int, folder: Path, given: Any) -> Outcome:
    """Record, diagnose, tune, and run on the rig; what was done is kept."""
    import eha_bench

    file = folder / "outcome.json"
    if file.exists():
        return Outcome.from_json(json.loads(file.read_text()))
    began = time.perf_counter()
    machine = recorded(plant, number, folder, given.seconds)
    diagnosed = 0.0
    if not (folder / "found" / "diagnosis.json").exists():
        start = time.perf_counter()
        eha_bench.diagnose(machine.dataset, folder / "found")
        diagnosed = time.perf_counter() - start
    found = json.loads((folder / "found" / "diagnosis.json").read_text())
    vary = load_vary({"vary": VARY[plant]})
    controllers = load_controllers(
        shipped_file("controllers/physical.yaml" if plant == KNEE else f"controllers/{plant}.yaml")
    )
    declared, revised = load_model(machine.model), load_model(folder / "found" / "revised.yaml")
    rig = machine.rig

    def simulator(model: Model) -> Simulator:
        return Simulator(model, controllers, sensors=rig.sensors)

    bench = Bench(
        plant, simulator(declared), simulator(revised), RigSimulator(rig, declared, controllers),
        read_posterior(folder / "found", revised), vary,
        given.draws, given.candidates, given.workers,
    )  # fmt: skip
    rng = np.random.default_rng([number, 5])
    suite, factor, of_declared, spread = near_the_best(bench, rng)
    # rigs that shared their noise would all be off to one side
    suite = with_noise(suite, NOISES * number)
    start = time.perf_counter()
    best = bench.tuned(suite, bench.revised, bench.posterior, given.candidates)
    tuning = time.perf_counter() - start
    assert best.after is not None
    assert best.declared is not None

    def state(point: Point) -> FloatArray:
        return bench.over_draws(suite, point, given.draws, 1)

    drawn = spread[int(rng.integers(len(spread)))]
    said = [
        *said_of(bench, suite, "tuned", best.point, best.after.margins, number),
        *said_of(bench, suite, "shipped", best.before, best.declared.margins, number),
        *said_of(bench, suite, "of the declared model", of_declared, state(of_declared), number),
        *said_of(bench, suite, "drawn", drawn, state(drawn), number),
    ]
    passes = any(item.passed >= ENOUGH for item in said if item.limits == "asked")
    searched = not passes
    if searched:
        # nothing that settles on the rig is an answer, too
        with suppress(InputError):
            on_rig = bench.tuned(suite, bench.rig, None, given.searched)
            passes = float(kept(bench.on_rig(suite, on_rig.point)).mean()) >= ENOUGH
    done = Outcome(
        plant, machine.truth, number, found["verdict"],
        tuple(item["id"] for item in found["effects"]), factor, best.feasible, passes, searched,
        float(min(best.margins)),
        tuple(item.beyond.channel if isinstance(item, Extrapolation) else "setup"
              for item in best.after.beyond),
        tuple(said),
        (diagnosed, tuning, time.perf_counter() - began - tuning - diagnosed),
    )  # fmt: skip
    file.write_text(json.dumps(asdict(done)))
    return done


def line(item: Outcome) -> str:
    """Return one rig as a line."""
    tuned, declared = item.asked("tuned"), item.asked("of the declared model")
    return (
        f"{item.plant} {item.truth} ({item.number}): {item.verdict} "
        f"{'+'.join(item.named) or '-'}; limits {item.factor:.2f}; "
        f"stated {tuned.stated:.2f}, passed {tuned.passed:.2f} "
        f"(gains of the declared model {declared.stated:.2f}, {declared.passed:.2f}); "
        f"beyond the recordings in {', '.join(item.beyond) or 'nothing'}; "
        f"{'feasible' if item.feasible else 'infeasible'}, on the rig "
        f"{'feasible' if item.any_passes else 'infeasible'}; "
        f"{' + '.join(f'{part:.0f}' for part in item.seconds)} s"
    )


def share(name: str, items: Sequence[bool], goal: float = math.nan) -> Row:
    """Return a share as a row, with its interval."""
    from eha_bench.sweeps.chance import Chance

    chance = Chance(sum(items), len(items))
    note = f"{chance.kept} of {chance.draws}, 95 %: {chance.low:.0%} to {chance.high:.0%}"
    return Row(name, 100.0 * chance.value, "%", ">", goal, note)


def rows_from(done: Sequence[Outcome]) -> list[Row]:
    """Return the figures as rows of the table of all benchmarks."""
    rows = []
    able = [item for item in done if item.any_passes]
    if able:
        works = [item.works for item in able]
        goal = GOALS["passing where any gains pass"]
        rows.append(share("tuned rigs that pass where any gains pass", works, goal))
        works = [item.asked("of the declared model").passed >= ENOUGH for item in able]
        rows.append(share("the same with gains of the declared model", works))
    claimed = [item for item in done if not item.feasible]
    if claimed:
        right = [not item.any_passes for item in claimed]
        rows.append(share("'infeasible' that is right", right, GOALS["infeasible right"]))
    unable = [item for item in done if not item.any_passes]
    if unable:
        called = [not item.feasible for item in unable]
        rows.append(share("rigs without gains that pass, called 'infeasible'", called))
        stated = np.mean([item.asked("tuned").stated for item in unable])
        rows.append(Row("P(pass) stated on these, mean", float(stated)))
    for name, own in (("beyond", [i for i in done if i.beyond]),
                      ("within", [i for i in done if not i.beyond])):  # fmt: skip
        if own:
            off = [i.asked("tuned").stated - i.asked("tuned").passed for i in own]
            rows.append(Row(f"P(pass) less what passed, {name} the recordings", float(np.mean(off)),
                            note=f"mean of {len(own)} rigs"))  # fmt: skip
    return [*rows, *_tenths("asked", done, lambda item: item.limits == "asked"),
            *_tenths("drawn limits", done, lambda item: item.limits != "asked")]  # fmt: skip


def _tenths(name: str, done: Sequence[Outcome], belongs: Callable[[Said], bool]) -> list[Row]:
    """Return what happened where so much was stated, with intervals over rigs."""
    rows = []
    for low in range(10):
        by_rig = [
            [
                (said.stated, said.passed)
                for said in item.said
                if belongs(said) and low <= min(9.99, 10.0 * said.stated) < low + 1
            ]
            for item in done
        ]
        own = [np.array(pairs) for pairs in by_rig if pairs]
        if not own:
            continue
        sums = np.array([[len(pairs), *pairs.sum(axis=0)] for pairs in own])
        generator = np.random.default_rng(low)
        again = sums[generator.integers(len(own), size=(RESAMPLED, len(own)))].sum(axis=1)
        ends = np.quantile(again[:, 2] / again[:, 0], (0.025, 0.975))
        count, stated, passed = sums.sum(axis=0)
        rows.append(
            Row(
                f"{name}: P(pass) stated {low / 10:.1f} to {low / 10 + 0.1:.1f}: off by",
                100.0 * abs(passed - stated) / count, "points", "<", GOALS["stated off by"],
                f"stated {stated / count:.3f}, passed {passed / count:.3f} "
                f"({ends[0]:.2f} to {ends[1]:.2f}), {count:.0f} pairs of {len(own)} rigs",
            )
        )  # fmt: skip
    return rows


def main() -> int:
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tuned_rigs", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one rig")
    parser.add_argument("--cases", type=int, default=50, help="rigs of each plant")
    parser.add_argument("--first", type=int, default=0, help="number of the first rig")
    parser.add_argument("--plants", nargs="+", choices=[*VARY], default=[KNEE, SERVO])
    parser.add_argument("--seconds", type=float, default=0.0, help="of each run, if not as usual")
    parser.add_argument("--candidates", type=int, default=160, help="gains that tuning tries")
    parser.add_argument("--searched", type=int, default=240, help="... and a search on the rig")
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--workers", default="", help="processes, as of the commands")
    parser.add_argument("--out", type=Path, help="folder of cases; one given goes on with it")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    plants, cases = given.plants, given.cases
    if given.quick:
        plants, cases, given.seconds = [KNEE], 1, 1.0
        given.candidates, given.searched, given.draws = 16, 16, 6
    out = given.out or Path(tempfile.mkdtemp())
    done: list[Outcome] = []
    for number in range(given.first, given.first + cases):
        for plant in plants:
            done.append(run_case(plant, number, out / f"{plant}-{number}", given))
            print(line(done[-1]), flush=True)
    rows = rows_from(done)
    report_rows(given.json, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
