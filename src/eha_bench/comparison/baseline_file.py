"""A baseline: results taken together in one file, which only an explicit command changes.

The file is a complete result.json: `compare` takes it as a side, and limits `of baseline` in a
suite refer to it. It holds no recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eha_bench.comparison.compare import compare_sides
from eha_bench.comparison.comparison import Comparison
from eha_bench.comparison.side import Side, load_side
from eha_bench.core.errors import InputError, Place
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.output_folder import spare_inputs, writable
from eha_bench.core.result import Result, Status, TrialResult


@dataclass(frozen=True)
class BaselineUpdate:
    """What became a baseline, and how it compares to the one before (None for the first)."""

    result: Result
    change: Comparison | None


def accept(file: Path, results: Sequence[Path], *, failed: bool = False) -> BaselineUpdate:
    """Write results into a baseline file, in place of what was in it.

    Args:
        file: the baseline, e.g. baselines/knee.json.
        results: result folders or files; several are repeats of each other.
        failed: whether results are taken that missed limits.

    Raises:
        InputError: a result is not there, came to no end or missed limits, the results are of
            different suites or targets, or the file cannot be written.
    """
    if file.is_dir():
        raise InputError(
            "a baseline is a file, and this is a folder",
            where=Place(file=str(file)),
            hint="name a file, e.g. baselines/knee.json, and the results after it",
        )
    writable(file.parent, hint="name a file in another folder, and the results after it")
    with noting_inputs() as read:
        sides = [load_side(path) for path in results]
    spare_inputs((file,), read, "name another baseline file")
    loaded = tuple(entry for side in sides for entry in side.results)
    if not loaded:
        raise InputError("there is no result to take", hint="name a result folder")
    _check(loaded, failed=failed)
    result = _together(loaded, str(file))
    change = None
    if file.is_file():
        before = load_side(file)
        after = Side(str(file), ((result, file.parent),))
        change = compare_sides(before, after, across_targets=True)
    file.parent.mkdir(parents=True, exist_ok=True)
    result.write(file)
    return BaselineUpdate(result, change)


def _check(loaded: Sequence[tuple[Result, Path]], *, failed: bool) -> None:
    first = loaded[0][0]
    for result, folder in loaded:
        where = Place(file=str(folder))
        if result.status in (Status.FAULT, Status.INCOMPLETE):
            raise InputError(f"the run is {result.status.value}: no baseline", where=where)
        if result.status is Status.FAILED and not failed:
            raise InputError(
                "the run missed limits", where=where, hint="accept it anyway with --failed"
            )
        if (result.suite, result.target) != (first.suite, first.target):
            raise InputError(
                f"is of suite '{result.suite}' on '{result.target}', the first of "
                f"'{first.suite}' on '{first.target}'",
                where=where,
                hint="a baseline holds repeats of one suite on one target",
            )
        if result.provenance.get("suite_sha256") != first.provenance.get("suite_sha256"):
            raise InputError("is of another version of the suite than the first", where=where)


def _together(loaded: Sequence[tuple[Result, Path]], name: str) -> Result:
    runs: list[TrialResult] = []
    counts: dict[str, int] = {}
    for result, _ in loaded:
        for run in result.trials:
            repeat = counts.get(run.id, 0)
            counts[run.id] = repeat + 1
            runs.append(replace(run, repeat=repeat, recording="", sha256=""))
    first = loaded[0][0]
    origin = {**first.provenance, "baseline": name, "results": str(len(loaded))}
    return replace(first, trials=tuple(runs), provenance=origin)
