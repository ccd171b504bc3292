"""Close the loop on measured data: what does a linear drive lack that is declared without friction?

    python examples/close_the_loop_on_emps.py [FOLDER]        (default: reports/example_emps)

The measurements are those of EMPS (Janot, Gautier, Brunot, *Data Set and Reference Models of EMPS*,
2019): a carriage on a screw, in closed loop. They are not part of this repository: put them into
`shared/data/emps` beside it, or name the folder `shared` in EHA_BENCH_SHARED. The model is declared
with viscous friction only; the second recording is never fitted, only scored.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

import eha_bench as eb

HERE = Path(__file__).resolve().parent
SHARED = Path(os.environ.get("EHA_BENCH_SHARED") or HERE.parents[1] / "shared")
DATA = SHARED / "data" / "emps"
SKIPPED = 77  # what test runners take for 'skipped'


def main(folder: Path) -> int:
    """Diagnose, and print verdict, causes and the held-out error before and after."""
    if not (DATA / "DATA_EMPS.mat").is_file():
        print(f"skipped: no measurements at {DATA}; see the top of this file", file=sys.stderr)
        return SKIPPED
    dataset = _dataset(folder / "dataset")
    eb.diagnose(dataset, folder)
    found = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    print(f"verdict: {found['verdict']}")
    for effect in found["effects"]:
        values = ", ".join(f"{k} = {v['value']:.4g}" for k, v in effect["parameters"].items())
        print(f"  {effect['id']} in the {effect['equation']} equation: {values}")
    for channel, error in found["error"]["holdout"].items():
        before, after, unit = error["before"], error["after"], error["unit"]
        print(f"  held out, {channel}: {before:.4g} -> {after:.4g} {unit}")
    print(folder / "diagnosis.html")
    return 0


def _dataset(folder: Path) -> Path:
    """Copy the files of examples/emps, with the paths of the measurements that are there."""
    folder.mkdir(parents=True, exist_ok=True)
    for source in (HERE / "emps").glob("*.yaml"):
        shutil.copy(source, folder)
    dataset = folder / "dataset.yaml"
    text = dataset.read_text(encoding="utf-8")
    written = "../../../shared/data/emps"
    dataset.write_text(text.replace(written, str(DATA)), encoding="utf-8")
    return dataset


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports/example_emps").resolve()))
