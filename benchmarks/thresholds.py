"""`python -m benchmarks.thresholds`: how much a verdict hangs on each of its thresholds.

Recordings with known answers (of the knee's rig, and of three other plants) are diagnosed once,
and every figure that is held against a threshold of `eha_bench.diagnosis.fit.thresholds` is noted.
How close the nearest ones come from below and from above says by what factor a threshold may move
before anything changes at all. Where that is less than two, it is halved and doubled, and the
recordings concerned are diagnosed again: how many verdicts, causes or balances become others.

`--page docs/thresholds.md` writes thresholds, sources and figures between the page's marks.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

from benchmarks.ended import ended
from benchmarks.marked_page import write_between
from benchmarks.table import Row, report_rows

from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.thresholds import DEFAULT, QUESTIONS, Thresholds

ROOT = Path(__file__).parent.parent
DATA = ROOT.parent / "shared/data"
CASES = {
    **{name: DATA / "rig_samples" / name for name in "ABCDEFMN"},
    **{name: ROOT / "examples/foreign_plants" / name for name in "GHIJKL"},
}
"""Recordings with known answers: of the knee's rig, and of three other plants."""
FACTORS = (0.5, 2.0)
FROM_ONE = ("nearly_all", "worse", "windows")
"""Thresholds close to 1, at which nothing is gained or lost: their distance from it is moved."""
MARKS = ("<!-- table by benchmarks.thresholds -->", "<!-- end of the table -->")


class NotedFloat(float):
    """A threshold that notes what it is compared with, over its own value."""

    __array_ufunc__ = None  # so that NumPy's numbers, too, leave a comparison to it
    name: str
    seen: dict[str, list[float]]

    def __new__(cls, value: float, name: str, seen: dict[str, list[float]]) -> Self:
        made = super().__new__(cls, value)
        made.name, made.seen = name, seen
        return made

    def _note(self, other: float) -> float:
        self.seen[self.name].append(max(0.0, float(other) / float(self)))
        return float(self)

    def __lt__(self, other: float) -> bool:
        return self._note(other) < other

    def __gt__(self, other: float) -> bool:
        return self._note(other) > other

    def __le__(self, other: float) -> bool:
        return self._note(other) <= other

    def __ge__(self, other: float) -> bool:
        return self._note(other) >= other

    def _like(self, value: float) -> NotedFloat:
        return NotedFloat(value, self.name, self.seen)

    def __mul__(self, other: float) -> NotedFloat:
        return self._like(float(self) * float(other))

    __rmul__ = __mul__

    def __truediv__(self, other: float) -> NotedFloat:
        return self._like(float(self) / float(other))

    def __neg__(self) -> NotedFloat:
        return self._like(-float(self))


def noted() -> tuple[Thresholds, dict[str, list[float]]]:
    """Return the thresholds, and where they note what they are compared with."""
    seen: dict[str, list[float]] = defaultdict(list)
    values = {item.name: NotedFloat(getattr(DEFAULT, item.name), item.name, seen)
              for item in fields(Thresholds)}  # fmt: skip
    return Thresholds(**values), seen


@dataclass(frozen=True)
class Told:
    """What a diagnosis says: verdict, causes, and the balance of something unknown."""

    verdict: str
    causes: tuple[str, ...]
    balance: str

    @staticmethod
    def read(content: Mapping[str, Any]) -> Told:
        """Read one that was kept."""
        return Told(content["verdict"], tuple(content["causes"]), content["balance"])


@dataclass(frozen=True)
class Nearest:
    """The nearest figures of one recording, over a threshold: below 1 and above, None for none."""

    below: float | None
    above: float | None


def told(case: str, thresholds: Thresholds, folder: Path, until: str = "") -> Told:
    """Diagnose a recording, or its runs up to a time such as "1 s"."""
    path = CASES[case] / "dataset.yaml"
    found = diagnose(ended(path, until) if until else path, folder, thresholds=thresholds)
    balance = (found.unknown.equation if found.unknown else "") or ""
    return Told(found.verdict.value, tuple(sorted(item.id for item in found.effects)), balance)


def first_pass(case: str, out: Path, until: str = "") -> tuple[Told, dict[str, Nearest]]:
    """Diagnose with the thresholds as they are, noting; what was done already is read."""
    kept = out / f"{case}.json"
    if not kept.exists():
        thresholds, seen = noted()
        answer = told(case, thresholds, out / "diagnosis", until)
        nearest = {
            name: Nearest(
                max((ratio for ratio in ratios if ratio < 1.0), default=None),
                min((ratio for ratio in ratios if ratio >= 1.0), default=None),
            )
            for name, ratios in seen.items()
        }
        content = {"told": asdict(answer), "nearest": {k: asdict(v) for k, v in nearest.items()}}
        kept.write_text(json.dumps(content))
    content = json.loads(kept.read_text())
    return Told.read(content["told"]), {
        name: Nearest(**item) for name, item in content["nearest"].items()
    }


def moved(name: str, factor: float) -> float:
    """Return a threshold, or its distance from 1, times a factor."""
    value = float(getattr(DEFAULT, name))
    return 1.0 + factor * (value - 1.0) if name in FROM_ONE else factor * value


def concerned(found: Mapping[str, dict[str, Nearest]], name: str, other: float) -> list[str]:
    """Return the recordings in which a figure lies between a threshold and another value."""
    ratio = other / getattr(DEFAULT, name)
    cases = []
    for case, nearest in found.items():
        item = nearest.get(name, Nearest(None, None))
        if ratio < 1.0 and item.below is not None and item.below >= ratio:
            cases.append(case)
        if ratio > 1.0 and item.above is not None and item.above <= ratio:
            cases.append(case)
    return cases


def is_changed(case: str, name: str, factor: float, before: Told, out: Path) -> bool:
    """Whether something else is told with another threshold; kept as by `first_pass`."""
    kept = out / f"{case}_{name}_{factor:g}.json"
    if not kept.exists():
        other = replace(DEFAULT, **{name: moved(name, factor)})
        kept.write_text(json.dumps(asdict(told(case, other, out / "diagnosis"))))
    after = Told.read(json.loads(kept.read_text()))
    print(f"{name} x {factor:g}, {case}: {before} -> {after}", flush=True)
    return after != before


def table(
    found: Mapping[str, dict[str, Nearest]], others: Mapping[tuple[str, float], tuple[int, int]]
) -> str:
    """Return thresholds with sources and figures, question by question."""
    by_name = {item.name: item for item in fields(Thresholds)}
    lines = []
    for question, names in QUESTIONS.items():
        lines += [
            f"### {question}", "",
            "| threshold | value | decides | from | nearest figures | halved | doubled |",
            "|---|---|---|---|---|---|---|",
        ]  # fmt: skip
        for name in names:
            item = by_name[name]
            own = [nearest[name] for nearest in found.values() if name in nearest]
            below = max((n.below for n in own if n.below is not None), default=None)
            above = min((n.above for n in own if n.above is not None), default=None)
            ends = [f"{end:.2g}" if end is not None else "–" for end in (below, above)]
            near = f"{ends[0]}, {ends[1]}" if own else "not asked"
            others_of = [_in_words(others.get((name, factor))) for factor in FACTORS]
            cells = (f"`{name}`", f"{getattr(DEFAULT, name):g}", item.metadata["decides"],
                     item.metadata["source"], near, *others_of)  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    return "\n".join(lines).rstrip()


def _in_words(item: tuple[int, int] | None) -> str:
    return "the same" if item is None or not item[0] else f"{item[0]} of {item[1]} others"


def main() -> int:
    """Diagnose, move thresholds and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.thresholds", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="a part of one recording, nothing moved"
    )
    parser.add_argument("--cases", nargs="+", choices=[*CASES], default=[*CASES])
    parser.add_argument("--out", type=Path, help="folder of what was done; one given goes on")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    parser.add_argument("--json", type=Path, help="write the figures here")
    given = parser.parse_args()
    if not DATA.is_dir():
        print(f"{DATA} is not there: nothing to diagnose")
        return 0
    out: Path = given.out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    cases: Sequence[str] = ["D"] if given.quick else given.cases
    answers: dict[str, Told] = {}
    found: dict[str, dict[str, Nearest]] = {}
    for case in cases:
        answers[case], found[case] = first_pass(case, out, "1 s" if given.quick else "")
        print(case, answers[case], flush=True)
    others: dict[tuple[str, float], tuple[int, int]] = {}
    for item in fields(Thresholds):
        for factor in () if given.quick else FACTORS:
            own = concerned(found, item.name, moved(item.name, factor))
            count = sum(is_changed(case, item.name, factor, answers[case], out) for case in own)
            others[item.name, factor] = count, len(cases)
    text = table(found, others)
    print(text)
    if given.page:
        write_between(given.page, MARKS, text)
    asked = {name for nearest in found.values() for name in nearest}
    rows = [Row("thresholds that figures were held against", len(asked), "",
                note=f"of {len(fields(Thresholds))}, in {len(cases)} recordings")]  # fmt: skip
    rows += [
        Row(f"verdicts that change where {name} is taken {factor:g} times", count, "",
            note=f"of {of}")
        for (name, factor), (count, of) in others.items() if count
    ]  # fmt: skip
    report_rows(given.json, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
