"""`python -m benchmarks.measured_machines`: what is named on measurements of real machines.

The examples of the seals (`examples/seal_friction`) and of the arm's servos (`examples/so101`) are
diagnosed as they are, on the measurements in the shared data. Nobody knows the truth, but:

* air presses every seal, so friction that grows with pressure has to be among the causes;
* a servo's revised model has to err at most half as much in the angle as the calibrated nominal one
  on motions of other kinds than those that were fitted (the speed is mostly noise there).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.ended import ended
from benchmarks.table import Row, report_rows

ROOT = Path(__file__).parent.parent
DATA = ROOT.parent / "shared/data"
SEALS = ("KDN", "NAPN", "O-ring257")
JOINTS = ("rotation", "elbow", "wrist_pitch")


@dataclass(frozen=True)
class Outcome:
    """What a diagnosis gave.

    Attributes:
        named: causes, and the verdict where there is none. ratio: error of the angle in unseen
            runs, revised over calibrated; None without. seconds: it took.
    """

    named: tuple[str, ...]
    ratio: float | None
    seconds: float

    def __str__(self) -> str:
        return f"{' + '.join(self.named)}; {self.seconds:.0f} s"


def diagnosed(example: Path, folder: Path, until: str = "") -> Outcome:
    """Diagnose an example's dataset, or its recordings up to a time such as "8 s"."""
    import eha_bench

    path = example / "dataset.yaml"
    before = time.perf_counter()
    found = eha_bench.diagnose(ended(path, until) if until else path, folder)
    took = time.perf_counter() - before
    angle = found.unseen.get("angle")
    named = tuple(item.id for item in found.effects) or (found.verdict.value,)
    return Outcome(named, None if angle is None else angle.after / angle.before, took)


def rows_of_seals(seals: Sequence[str], out: Path, until: str = "") -> list[Row]:
    """Diagnose seals; return one row, or none without seals."""
    if not seals:
        return []
    found = {}
    for seal in seals:
        found[seal] = diagnosed(ROOT / "examples/seal_friction" / seal, out / seal, until)
        print(f"{seal}: {found[seal]}", flush=True)
    right = sum("seal_friction" in item.named for item in found.values())
    return [Row("seals whose friction is said to grow with pressure", right, "", ">", len(seals))]


def rows_of_joints(joints: Sequence[str], out: Path) -> list[Row]:
    """Diagnose servos; return a row for each."""
    rows = []
    for joint in joints:
        found = diagnosed(ROOT / "examples/so101" / joint, out / joint)
        print(f"{joint}: {found}", flush=True)
        assert found.ratio is not None
        figure = f"{joint}: error of the angle on unseen motions, after / before"
        rows.append(Row(figure, found.ratio, "", "<", 0.5, note=" + ".join(found.named)))
    return rows


def main() -> int:
    """Diagnose and print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.measured_machines", description=__doc__
    )
    parser.add_argument("--quick", action="store_true", help="a part of one seal's recordings")
    parser.add_argument("--seals", nargs="*", choices=SEALS, default=list(SEALS))
    parser.add_argument("--joints", nargs="*", choices=JOINTS, default=list(JOINTS))
    parser.add_argument("--out", type=Path, help="folder of the diagnoses")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    if not DATA.is_dir():
        print(f"{DATA} is not there: nothing to diagnose")
        return 0
    out = given.out or Path(tempfile.mkdtemp())
    if given.quick:
        rows = rows_of_seals(["NAPN"], out, until="8 s")
    else:
        rows = [*rows_of_seals(given.seals, out), *rows_of_joints(given.joints, out)]
    return report_rows(given.json, rows)


if __name__ == "__main__":
    sys.exit(main())
