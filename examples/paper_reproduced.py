"""The paper's experiments on the simulator, beside the figures that it publishes.

    python examples/paper_reproduced.py [FOLDER]      (default: reports/example_paper)

Runs suites/paper.yaml on both models that ship: the one printed in the paper, and the physically
complete one with check valves. Leaves with 1 if a published figure is missed by either.
"""

from __future__ import annotations

import sys
from pathlib import Path

import eha_bench as eb

SUITES = Path(__file__).resolve().parents[1] / "suites"
TARGETS = {"as printed": "paper.yaml", "with check valves": "physical.yaml"}

# trial, metric, what the paper reports, unit, factor from SI
PUBLISHED = (
    ("pressure_step-15MPa", "response_time", 39.0, "ms", 1e3),
    ("pressure_step-20MPa", "response_time", 43.0, "ms", 1e3),
    ("pressure_step-30MPa", "response_time", 50.0, "ms", 1e3),
    ("pressure_step-15MPa", "holding_current", 11.0, "A", 1.0),
    ("pressure_step-20MPa", "holding_current", 15.8, "A", 1.0),
    ("pressure_step-30MPa", "holding_current", 24.0, "A", 1.0),
    ("pressure_step-30MPa", "peak", 40.0, "MPa", 1e-6),
    ("knee_step", "response_time", 0.6, "s", 1.0),
)


def main(folder: Path) -> int:
    """Run both, print the table, and return the exit status."""
    missed = 0
    found = {}
    for name, target in TARGETS.items():
        out = folder / target.removesuffix(".yaml")
        result = eb.run(SUITES / "paper.yaml", SUITES / "targets" / target, out)
        missed += result.status.exit_status != 0
        for trial in result.trials:
            for score in trial.scores:
                found[name, trial.id, score.metric] = score.value
        print(f"{name}: {result.status.value}, {out / 'report.html'}")
    print(f"\n{'':<22}{'':<18}{'published':>12}" + "".join(f"{name:>20}" for name in TARGETS))
    for trial_id, metric, published, unit, factor in PUBLISHED:
        row = f"{trial_id:<22}{metric:<18}{published:>9.4g} {unit:<3}"
        for name in TARGETS:
            value = factor * found[name, trial_id, metric]
            row += f"{value:>11.4g} {unit:<3}{100 * (value / published - 1):>+4.0f} %"
        print(row)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports/example_paper")))
