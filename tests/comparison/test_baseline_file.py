"""A baseline of several results: repeats of each other in one file."""

import json
import sys
from pathlib import Path

import pytest

from eha_bench.comparison.baseline_file import accept
from eha_bench.core.errors import InputError
from eha_bench.core.result import Result

sys.path.insert(0, str(Path(__file__).parent))
from results import folder, result


def test_results_become_repeats_of_each_other_in_one_file(tmp_path: Path) -> None:
    paths = [
        folder(tmp_path / "first", result((1.0, 1.1), revision="a1")),
        folder(tmp_path / "second", result((1.2,), revision="b2")),
    ]
    file = tmp_path / "new" / "folder" / "knee.json"
    update = accept(file, paths)
    assert update.change is None
    written = Result.read(file)
    assert [run.repeat for run in written.trials] == [0, 1, 2]
    assert [run.scores[0].value for run in written.trials] == [1.0, 1.1, 1.2]
    assert written.provenance["revision"] == "a1"
    assert written.provenance["results"] == "2"
    assert written.provenance["baseline"] == str(file)


def test_one_result_is_a_baseline_too_and_the_next_is_held_against_it(tmp_path: Path) -> None:
    file = tmp_path / "knee.json"
    accept(file, [folder(tmp_path / "first", result((1.0, 1.001, 0.999, 1.002)))])
    other = folder(tmp_path / "second", result((1.2, 1.201, 1.199, 1.202)))
    change = accept(file, [other]).change
    assert change is not None
    assert change.status == "regression"
    assert set(json.loads(change.to_json())) == {
        "schema_version", "status", "stopped", "counts", "alpha", "paired", "caveats", "baseline",
        "candidate", "metrics",
    }  # fmt: skip


def test_results_of_another_suite_are_no_repeats(tmp_path: Path) -> None:
    paths = [
        folder(tmp_path / "first", result((1.0,))),
        folder(tmp_path / "second", result((1.0,), suite="other")),
    ]
    with pytest.raises(InputError, match="repeats of one suite on one target"):
        accept(tmp_path / "knee.json", paths)
    assert not (tmp_path / "knee.json").exists()
