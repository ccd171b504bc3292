"""`python -m benchmarks.tuned_rigs`: do gains that were tuned for a machine pass on the machine?

A rig with an undeclared effect (`fixtures.rig`, `fixtures.rigs`: equations of their own) makes
recordings. They are diagnosed, and gains are tuned over the posterior of the revised model, for a
suite with limits about what the best gains reach on the declared model. Then the rig itself runs
the suite with these gains, again and again with other noise. Beside it: gains that were tuned for
the declared model, and a search as long on the rig itself, which tells whether any gains pass.
Counted: P(pass) as stated against what happened, by tenths; tuned rigs that pass where any gains
do; and 'infeasible'.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.experiment_rigs import ForeignRig
from benchmarks.rig_loop import Rig, RigSimulator
from benchmarks.table import Row, write_rows
from fixtures.rig.case import Conditions, draw_hidden, draw_true, record_case
from fixtures.rig.parameters import CALIBRATED
from fixtures.rig.plans import make_plans
from fixtures.rigs.catalogue import PLANTS
from fixtures.rigs.logs import channels_files
from fixtures.rigs.sheet import write_plant

from eha_bench.control.controller_file import load_controllers
from eha_bench.core.shipped import shipped
from eha_bench.core.workers import HERE, workers_from
from eha_bench.plants.model import Model, load_model
from eha_bench.posterior.file import read_posterior
from eha_bench.posterior.posterior import Posterior
from eha_bench.suites import Suite, load_suite
from eha_bench.sweeps.case import Case
from eha_bench.sweeps.design import LatinHypercube
from eha_bench.sweeps.evaluation import evaluated
from eha_bench.targets.simulator import Simulator
from eha_bench.tuning.tune import SearchEffort, Tuned, gains_space, tune
from eha_bench.tuning.vary_file import VaryFile, load_vary

KNEE, VALVE = "eha_knee", "valve_cylinder"
REPEATS = 10
"""Runs of the suite on the rig, each with other noise."""
FRONTIER = 48
"""Gains that are tried on the declared model to know what can be asked."""
ENOUGH = 0.5
"""Share of these that have to pass for the rig to count as passing."""
GOALS = {"passing where any gains pass": 95.0, "infeasible right": 95.0, "stated off by": 5.0}
VARY = {
    KNEE: {
        "pressure.k_p": {"from": "2 A/MPa", "to": "14 A/MPa", "scale": "log"},
        "pressure.k_2": {"from": "0.5 A*s/rad", "to": "6 A*s/rad", "scale": "log"},
        "pressure.k_i": {"from": "10 A/(MPa*s)", "to": "200 A/(MPa*s)", "scale": "log"},
    },
    VALVE: {
        "piston_position.k_p": {"from": "100 V/m", "to": "3000 V/m", "scale": "log"},
        "piston_position.k_i": {"from": "1 V/(m*s)", "to": "3000 V/(m*s)", "scale": "log"},
    },
}


@dataclass(frozen=True)
class Outcome:
    """One rig, from its recordings to its run with tuned gains.

    Probabilities are NaN where nothing was stated.
    """

    plant: str
    truth: str
    number: int
    verdict: str
    named: tuple[str, ...]
    stated: float
    feasible: bool
    passed: float
    declared_passed: float
    any_passes: bool
    least_margin: float
    seconds: tuple[float, float]

    @property
    def works(self) -> bool:
        """Whether the rig passes with the tuned gains."""
        return self.passed >= ENOUGH


@dataclass(frozen=True)
class Recorded:
    """A rig that has made its recordings."""

    plant: str
    truth: str
    rig: Rig
    dataset: Path


def knee(number: int, folder: Path, seconds: float) -> Recorded:
    """Draw a knee with an effect, and record its runs."""
    plans = make_plans(4000 + number // 60, 60, strengths=["middle", "strong"])
    plan = replace(plans[number % 60], name="case")
    conditions = Conditions(duration=seconds)
    rng = np.random.default_rng(np.random.SeedSequence(plan.seed))
    undeclared = {name for effect in plan.hidden for name in effect.undeclared}
    calibrate = tuple(name for name in CALIBRATED if name not in undeclared)
    values, _, _ = draw_true(rng, conditions, calibrate)
    hidden, _ = draw_hidden(plan, rng, conditions)
    dataset = record_case(plan, folder, conditions)
    return Recorded(KNEE, plan.hidden[0].id, Rig.knee({**values, **hidden}), dataset)


def valve(number: int, folder: Path, _seconds: float) -> Recorded:
    """Draw a valve-driven cylinder with an effect, and record its runs."""
    plant = PLANTS[VALVE]
    # tick by tick this rig cannot look back on commands, so nothing is late in it
    known = [effect for effect in plant.listed if effect.id != "command_delay"]
    effect = known[number % len(known)]
    rig = ForeignRig(plant, effect, number)
    rows = []
    (folder / "case").mkdir(parents=True, exist_ok=True)
    for drive in plant.drives(np.random.default_rng([number, 17])):
        if not drive.values:
            rig.record(drive, folder / "case" / f"{drive.name}.csv")
            rows.append(f"  - {{log: {drive.name}.csv, use: {drive.use}}}\n")
    (folder / "case/channels.yaml").write_text(channels_files(plant)["channels_csv.yaml"])
    missing = effect.undeclared_in_plant or effect.undeclared
    write_plant(plant.name, folder / "case/plant.yaml", list(missing))
    dataset = folder / "case/dataset.yaml"
    inputs = ", ".join(channel.name for channel in plant.channels[: plant.inputs])
    dataset.write_text(
        f"model: plant.yaml\nchannels: channels.yaml\ninputs: [{inputs}]\nruns:\n{''.join(rows)}"
    )
    return Recorded(VALVE, effect.id, Rig.foreign(plant, rig.machine.settings), dataset)


LOOSE = (60.0, 1000.0)
"""Limits of overshoot, %, and response, ms, that say nothing yet."""


def suite_of(plant: str, overshoot: float, response: float) -> Suite:
    """Return two steps with limits of overshoot, %, and response, ms."""
    if plant == KNEE:
        own = {"mode": "pressure", "setup": {"piston": "locked"}, "settle": "50 ms",
               "duration": "300 ms"}  # fmt: skip
        sizes, at, zero, left = ("15 MPa", "8 MPa"), "1 ms", "0 MPa", "0.4 MPa"
    else:
        own = {"mode": "piston_position", "settle": "100 ms", "duration": "1 s"}
        sizes, at, zero, left = ("20 mm", "5 mm"), "20 ms", "0 mm", "0.2 mm"
    limits = {
        "response_time": f"<= {response:.2f} ms",
        "steady_state_error": f"+- {left}",
        "overshoot": f"<= {overshoot:.2f} %",
    }
    trials = [
        {"id": f"step_{k}", **own, "accept": limits,
         "signal": {"kind": "step", "initial": zero, "final": size, "at": at}}
        for k, size in enumerate(sizes)
    ]  # fmt: skip
    return load_suite({"name": "tuned", "trials": trials})


def near_the_best(
    plant: str, simulator: Simulator, vary: VaryFile, rng: np.random.Generator
) -> Suite:
    """Return limits about what the best gains reach on a simulator, from just out of reach to easy.

    Of gains spread over their ranges those are taken that overshoot least for how fast they are;
    the limits are what one of them reaches, 10 % tighter to 15 % looser.
    """
    space = gains_space(Case(suite_of(plant, *LOOSE), simulator), vary)
    reached = []
    for point in LatinHypercube(FRONTIER, int(rng.integers(1 << 30))).points(space):
        found = evaluated(space.at(point), 0).values
        response, overshoot = (
            max(found.get(f"step_{k}.{name}", math.nan) for k in (0, 1))
            for name in ("response_time", "overshoot")
        )
        if math.isfinite(response) and math.isfinite(overshoot):
            reached.append((1e3 * response, 100.0 * overshoot))
    fastest = min(response for response, _ in reached)
    at_most = fastest * float(rng.uniform(1.0, 1.5))
    response, overshoot = min(
        (item for item in reached if item[0] <= at_most), key=lambda item: item[1]
    )
    factor = float(rng.uniform(0.9, 1.15))
    return suite_of(plant, factor * max(overshoot, 1.0), factor * response)


def tuned(
    suite: Suite, simulator: Simulator, vary: VaryFile, posterior: Posterior | None, given: Any
) -> Tuned:
    """Tune gains on a simulator, or on a rig in its place."""
    effort = SearchEffort(candidates=given.candidates, draws=given.draws, seed=1)
    workers = workers_from(given.workers) if given.workers else HERE
    return tune(Case(suite, simulator), vary, posterior, effort=effort, workers=workers)


def share_passed(found: Tuned, rig: RigSimulator) -> float:
    """Return the share of runs that pass on the rig with the gains that were found."""
    case = found.space.at(found.point)
    on_rig = replace(case, simulator=rig.varied(controllers=case.simulator.controllers))
    return float(np.mean([evaluated(on_rig, draw).passed for draw in range(REPEATS)]))


def run_case(plant: str, number: int, folder: Path, given: Any) -> Outcome:
    """Record, diagnose, tune, and run on the rig; what was done is kept."""
    import eha_bench

    kept = folder / "outcome.json"
    if kept.exists():
        content = json.loads(kept.read_text())
        lists = {key: tuple(content[key]) for key in ("named", "seconds")}
        return Outcome(**{**content, **lists})
    folder.mkdir(parents=True, exist_ok=True)
    machine = (knee if plant == KNEE else valve)(number, folder, given.seconds)
    began = time.perf_counter()
    if not (folder / "found" / "diagnosis.json").exists():
        eha_bench.diagnose(machine.dataset, folder / "found")
    found = json.loads((folder / "found" / "diagnosis.json").read_text())
    diagnosed = time.perf_counter() - began
    vary = load_vary({"vary": VARY[plant]})
    controllers = load_controllers(
        shipped("controllers/physical.yaml" if plant == KNEE else f"controllers/{plant}.yaml")
    )

    def simulator(model: Model) -> Simulator:
        return Simulator(model, controllers, sensors=machine.rig.sensors)

    name = "model.yaml" if plant == KNEE else "plant.yaml"
    declared_model = load_model(machine.dataset.parent / name)
    rng = np.random.default_rng([number, 5])
    suite = near_the_best(plant, simulator(declared_model), vary, rng)
    revised = load_model(folder / "found" / "revised.yaml")
    posterior = read_posterior(folder / "found", revised)
    began = time.perf_counter()
    best = tuned(suite, simulator(revised), vary, posterior, given)
    took = time.perf_counter() - began
    declared = tuned(suite, simulator(declared_model), vary, None, given)
    rig = RigSimulator(machine.rig, declared_model, controllers)
    searched = tuned(suite, rig, vary, None, given)
    named = tuple(item["id"] for item in found["effects"])
    done = Outcome(
        plant, machine.truth, number, found["verdict"], named,
        best.after.suite.value if best.after else float("nan"), best.feasible,
        share_passed(best, rig), share_passed(declared, rig),
        share_passed(searched, rig) >= ENOUGH, float(min(best.margins)), (diagnosed, took),
    )  # fmt: skip
    kept.write_text(json.dumps(asdict(done)))
    return done


def line(item: Outcome) -> str:
    """Return one rig as a line."""
    return (
        f"{item.plant} {item.truth} ({item.number}): {item.verdict} "
        f"{'+'.join(item.named) or '-'}; stated {item.stated:.2f}, passed {item.passed:.2f} "
        f"(gains of the declared model {item.declared_passed:.2f}); "
        f"{'feasible' if item.feasible else 'infeasible'}, on the rig "
        f"{'feasible' if item.any_passes else 'infeasible'}; "
        f"{item.seconds[0]:.0f} + {item.seconds[1]:.0f} s"
    )


def rows_from(done: Sequence[Outcome]) -> list[Row]:
    """Return the figures as rows of the table of all benchmarks."""
    able = [item for item in done if item.any_passes]
    unable = [item for item in done if not item.any_passes]
    rows = []
    if able:
        rows.append(Row("tuned rigs that pass where any gains pass",
                        100.0 * np.mean([item.works for item in able]), "%", ">",
                        GOALS["passing where any gains pass"], f"of {len(able)}"))  # fmt: skip
        rows.append(Row("rigs that pass with gains of the declared model",
                        100.0 * np.mean([item.declared_passed >= ENOUGH for item in able]), "%",
                        note=f"of {len(able)}"))  # fmt: skip
    if done:
        right = [item.feasible == item.any_passes for item in done]
        rows.append(Row("feasible or not: right", 100.0 * np.mean(right), "%", ">",
                        GOALS["infeasible right"],
                        f"of {len(done)}, {len(unable)} of them infeasible"))  # fmt: skip
    for low in range(10):
        own = [i for i in done if low <= min(9.99, 10.0 * i.stated) < low + 1]
        if own:
            off = 100.0 * abs(np.mean([i.stated for i in own]) - np.mean([i.passed for i in own]))
            rows.append(Row(f"P(pass) stated {low / 10:.1f} to {low / 10 + 0.1:.1f}: off by", off,
                            "points", "<", GOALS["stated off by"], f"{len(own)} rigs"))  # fmt: skip
    return rows


def main() -> int:
    """Run the cases and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tuned_rigs", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one rig")
    parser.add_argument("--cases", type=int, default=50, help="rigs of each plant")
    parser.add_argument("--first", type=int, default=0, help="number of the first rig")
    parser.add_argument("--plants", nargs="+", choices=[KNEE, VALVE], default=[KNEE, VALVE])
    parser.add_argument("--seconds", type=float, default=4.0, help="of each of a knee's runs")
    parser.add_argument("--candidates", type=int, default=240)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--workers", default="", help="processes, as of the commands")
    parser.add_argument("--out", type=Path, help="folder of cases; one given goes on with it")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    plants, cases = given.plants, given.cases
    if given.quick:
        plants, cases, given.seconds = [KNEE], 1, 1.0
        given.candidates, given.draws = 32, 10
    out = given.out or Path(tempfile.mkdtemp())
    done: list[Outcome] = []
    for number in range(given.first, given.first + cases):
        for plant in plants:
            done.append(run_case(plant, number, out / f"{plant}-{number}", given))
            print(line(done[-1]), flush=True)
    rows = rows_from(done)
    for row in rows:
        print(row)
    write_rows(given.json, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
