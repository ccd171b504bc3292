"""`python -m benchmarks.pool`: does the ranking of recordings that exist say which to look at next?

Of the nine motions of each joint of a real arm (SO-101, in the shared data) three are diagnosed,
`next --from` ranks the other six, and the first two of the ranking are diagnosed with the three;
beside it the last two, and pairs drawn at random. What counts is how the revised model predicts
the motions that no diagnosis saw: the error of the angle after five motions over that after the
first three, as a geometric mean over the four motions that are left.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmarks.table import Row, report_rows, write_rows

ROOT = Path(__file__).parent.parent
LOGS = ROOT.parent / "shared/data/so101"
JOINTS = ("rotation", "elbow", "wrist_pitch")
FIRST = ("multisine", "step_response", "velocity_ramp")
"""Motions that are there at first: fast and slow, small and large."""


@dataclass(frozen=True)
class Pair:
    """Two recordings that were added, and what came of it.

    Attributes:
        how: they were chosen. added: names. named: causes. ratio: of the errors, after over before.
    """

    joint: str
    how: str
    added: tuple[str, ...]
    named: tuple[str, ...]
    ratio: float


class Arm:
    """One joint with its motions; `until` ends every recording, "" for its end."""

    def __init__(self, joint: str, folder: Path, until: str = "") -> None:
        self.joint, self.folder = joint, folder
        self._until = f", to: {until}" if until else ""
        self.motions = sorted(path.stem for path in LOGS.glob("*.csv"))
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("plant.yaml", "channels.yaml"):
            text = (ROOT / "examples/so101" / joint / name).read_text()
            (folder / name).write_text(text)

    def dataset(self, name: str, motions: Sequence[str]) -> Path:
        """Write a dataset of motions that are fitted."""
        path = self.folder / f"{name}.yaml"
        rows = "".join(
            f"  - {{log: {LOGS / motion}.csv, use: train{self._until}}}\n" for motion in motions
        )
        path.write_text(
            f"model: plant.yaml\nchannels: channels.yaml\ninputs: [command]\nruns:\n{rows}"
        )
        return path

    def diagnosed(self, name: str, motions: Sequence[str]) -> tuple[tuple[str, ...], list[float]]:
        """Diagnose; return the causes, and the error of the angle in every motion, rad."""
        import eha_bench

        kept = self.folder / name / "errors.json"
        if not kept.exists():
            found = eha_bench.diagnose(self.dataset(name, motions), self.folder / name)
            causes = tuple(item.id for item in found.effects)
            every = self.dataset("every", self.motions)
            predicted = eha_bench.predict(every, self.folder / name / "revised.yaml")
            # nothing is compared where nothing moves
            errors = [item.errors.get("angle", math.nan) for item in predicted]
            kept.write_text(json.dumps([causes, errors]))
        causes, errors = json.loads(kept.read_text())
        return tuple(causes), errors

    def added(self, how: str, motions: Sequence[str], before: Sequence[float]) -> Pair:
        """Diagnose with two further motions."""
        causes, errors = self.diagnosed("_".join(["with", *sorted(motions)]), [*FIRST, *motions])
        left = [k for k, name in enumerate(self.motions) if name not in (*FIRST, *motions)]
        ratio = np.exp(np.mean([np.log(errors[k] / before[k]) for k in left]))
        return Pair(self.joint, how, tuple(motions), causes, float(ratio))


def ranking(arm: Arm, first: Sequence[str] = FIRST) -> list[str]:
    """Return the motions that are not there at first as `next --from` ranks them."""
    from eha_bench.experiment.pool import rank

    arm.diagnosed("first", first)
    others = [motion for motion in arm.motions if motion not in first]
    found = rank(arm.folder / "first", [arm.dataset("others", others)])
    return [Path(item.name).stem for item in found]


def pairs_of(arm: Arm, count: int, rng: np.random.Generator) -> list[Pair]:
    """Return the pair that is ranked first, the one that is ranked last, and some at random."""
    _, before = arm.diagnosed("first", FIRST)
    ranked = ranking(arm)
    others = sorted(ranked)
    found = [arm.added("ranked first", ranked[:2], before)]
    print(found[-1], flush=True)
    found.append(arm.added("ranked last", ranked[-2:], before))
    print(found[-1], flush=True)
    for _ in range(count):
        drawn = [others[k] for k in rng.choice(len(others), 2, replace=False)]
        found.append(arm.added("at random", drawn, before))
        print(found[-1], flush=True)
    return found


def main() -> int:
    """Rank, diagnose and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pool", description=__doc__)
    parser.add_argument("--joints", nargs="+", choices=JOINTS, default=list(JOINTS))
    parser.add_argument("--quick", action="store_true", help="rank by part of one motion")
    parser.add_argument("--random", type=int, default=3, help="random pairs of each joint")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder of what was done; one given goes on")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if not LOGS.is_dir():
        print(f"{LOGS} is not there: nothing to rank")
        return 0
    out = given.out or Path(tempfile.mkdtemp())
    if given.quick:
        ranked = ranking(Arm(JOINTS[0], out / JOINTS[0], until="2 s"), FIRST[:1])
        write_rows(given.json, [Row("recordings ranked", len(ranked), "")])
        return 0
    rng = np.random.default_rng(given.seed)
    done = [pair for joint in given.joints
            for pair in pairs_of(Arm(joint, out / joint), given.random, rng)]  # fmt: skip
    rows = []
    for joint in given.joints:
        for how in ("ranked first", "at random", "ranked last"):
            own = [pair.ratio for pair in done if (pair.joint, pair.how) == (joint, how)]
            if own:
                rows.append(Row(f"{joint}, two motions {how}: error after over before",
                                float(np.exp(np.mean(np.log(own)))), "", note=f"{len(own)} pairs"
                                ))  # fmt: skip
    report_rows(given.json, rows)
    if given.out:
        (given.out / "pairs.json").write_text(json.dumps([asdict(pair) for pair in done]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
