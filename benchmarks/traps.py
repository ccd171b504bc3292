"""`python -m benchmarks.traps`: what a diagnosis makes of mistakes in what it is told.

Twenty machines without a hidden effect, declared or recorded wrongly (`benchmarks.trap_cases`).
A trap is avoided where nothing is called an effect that the machine does not have, the revised
model replays held-out runs no worse than the re-calibrated one, and something is said: a verdict
that is not none, or a note.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.table import Row, write_rows
from benchmarks.trap_cases import TRAPS, Trap

from eha_bench.core.note import Note
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.convergence import AT_BOUND, MOVED_FAR, MOVED_OUT
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis
from eha_bench.diagnosis.outcome.honest import growth

CAUTIONS = {AT_BOUND, MOVED_FAR, MOVED_OUT}
"""Notes that a parameter has gone far from what was declared."""
WORSE = 1.05
"""Growth of a held-out error of whole runs from which a model is worse."""


@dataclass(frozen=True)
class TrapSeen:
    """What was made of a trap.

    Attributes:
        verdict: with the effects. false: effects that the machine does not have.
        growth: of the error of held-out runs as whole replays by the revised model.
        said: whether there is a verdict or a note of what is wrong. seconds: it took.
    """

    verdict: str
    false: tuple[str, ...]
    growth: float
    said: bool
    seconds: float

    def avoids(self, trap: Trap) -> bool:
        """Return whether the trap was avoided."""
        return not self.false and self.growth <= WORSE and (self.said or not trap.named)


def seen(trap: Trap, found: Diagnosis, seconds: float) -> TrapSeen:
    """Hold a diagnosis against a trap."""
    named = tuple(effect.id.partition("@")[0] for effect in found.effects)
    grown = growth(found.holdout) if found.holdout else 1.0
    said = found.verdict.value != "none" or bool(found.undetermined) or _noted(found)
    false = tuple(name for name in named if name not in trap.may)
    verdict = " ".join([found.verdict.value, *named])
    return TrapSeen(verdict, false, grown, said, seconds)


def _noted(found: Diagnosis) -> bool:
    ended = found.convergence
    return any(isinstance(note, Note) and note.template in CAUTIONS for note in found.notes) or (
        ended is not None and bool(ended.at_bounds)
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line a trap, and how many were avoided."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.traps", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=[trap.name for trap in TRAPS])
    parser.add_argument("--seconds", type=float, default=0.0, help="of each run, if not as usual")
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument("--out", type=Path, help="folder of cases (default: a passing one)")
    parser.add_argument("--json", type=Path, help="write the figures as rows of JSON")
    chosen = parser.parse_args(arguments)
    rows = []
    with tempfile.TemporaryDirectory(prefix="eha-traps-") as name:
        top = chosen.out or Path(name)
        for trap in TRAPS:
            if chosen.only and trap.name not in chosen.only:
                continue
            folder = top / trap.name
            dataset = trap.record(folder, chosen.seed, chosen.seconds)
            start = time.perf_counter()
            found = diagnose(dataset, folder / "diagnosis")
            outcome = seen(trap, found, time.perf_counter() - start)
            note = (
                f"{trap.mistake}: {outcome.verdict}, x{outcome.growth:.3g}, {outcome.seconds:.0f} s"
            )
            rows.append(
                Row(trap.name, float(outcome.avoids(trap)), better=">", target=1.0, note=note)
            )
            print(rows[-1], flush=True)
    avoided = sum(row.value for row in rows)
    rows.append(Row("traps avoided", avoided, better=">", target=float(len(rows)), note=""))
    print(rows[-1])
    write_rows(chosen.json, rows)
    return int(any(row.verdict == "missed" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
