"""`python -m benchmarks.tuning`: does tuning keep what it says?

Suites of one pressure step with limits from tight to loose, on the knee with a made-up posterior of
four parameters. Gains are tuned on some draws; then P(pass) that was told is held against the share
of fresh machines, drawn by another seed, that pass with these gains. The gains as they were are
held beside them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from benchmarks.table import Row, write_rows

from eha_bench.api import open_target
from eha_bench.core.workers import workers_from
from eha_bench.plants.model import load_model
from eha_bench.posterior.posterior import Component, Posterior
from eha_bench.suites import load_suite
from eha_bench.sweeps.case import Case, case_of
from eha_bench.sweeps.probability import probability
from eha_bench.tuning.tune import SearchEffort, tune
from eha_bench.tuning.vary_file import load_vary

UNKNOWN = {
    "torque_constant": 0.03,
    "bulk_modulus": 0.1,
    "coulomb_torque": 0.2,
    "viscous_torque": 0.2,
}
"""Relative standard deviations."""
TIGHT = (4.95, 5.0, 5.1, 5.2)
"""Largest tracking error in MPa, from what hardly any gains keep to what many do."""
VARY = {
    "vary": {
        "pressure.k_p": {"from": "3 A/MPa", "to": "12 A/MPa", "scale": "log"},
        "pressure.k_2": {"from": "0.5 A*s/rad", "to": "4 A*s/rad", "scale": "log"},
    }
}


def suite(most: float) -> dict[str, object]:
    """Return a suite of one step."""
    step = {
        "id": "step",
        "mode": "pressure",
        "setup": {"piston": "locked"},
        "duration": "60 ms",
        "signal": {"kind": "step", "initial": "0 MPa", "final": "10 MPa", "at": "1 ms"},
        "accept": {"tracking_rms": f"<= {most} MPa", "peak": "<= 12 MPa"},
    }
    return {"name": "tight", "trials": [step]}


def posterior() -> Posterior:
    """Return a made-up one."""
    model = load_model("physical")
    deviations = [share * model.value(key) for key, share in UNKNOWN.items()]
    component = Component("made up", model, tuple(UNKNOWN), np.diag(np.square(deviations)))
    return Posterior((component,))


def main() -> None:
    """Tune each suite, and hold what was told against fresh machines."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tuning", description=__doc__)
    parser.add_argument("--candidates", type=int, default=240)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--suites", type=int, default=len(TIGHT))
    parser.add_argument("--workers", default="", help="processes, as of the commands")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    known, workers = posterior(), workers_from(given.workers)
    rows: list[Row] = []
    off = []
    for most in TIGHT[-given.suites :]:
        loaded = load_suite(suite(most))
        case: Case = case_of(loaded, open_target("physical", loaded.file))
        effort = SearchEffort(given.candidates, min(given.draws, 10), given.draws, seed=1)
        found = tune(case, load_vary(VARY), known, effort=effort, workers=workers)
        assert found.after is not None
        assert found.declared is not None
        told, before = found.after.suite.value, found.declared.suite.value
        machine = found.space.at(found.point)
        fresh = probability(machine, known, given.draws, seed=99, bands=False, workers=workers)
        off.append(abs(told - fresh.suite.value))
        note = f"told {told:.3f}, as they were {before:.3f}"
        rows.append(
            Row(f"fresh machines that pass, tracking <= {most} MPa", fresh.suite.value, note=note)
        )
        print(rows[-1], flush=True)
    rows.append(Row("told P(pass) off by at most", 100.0 * max(off), "points", "<", 5.0))
    print(rows[-1])
    write_rows(given.json, rows)


if __name__ == "__main__":
    main()
