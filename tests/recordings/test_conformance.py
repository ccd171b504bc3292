"""The MCAP project's own conformance files give exactly the records that stand beside them."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from eha_bench.recordings.mcap.records import records

SHARED = os.environ.get("EHA_BENCH_SHARED")
FOLDER = (
    Path(SHARED) if SHARED else Path(__file__).resolve().parents[3] / "shared"
) / "data/mcap_conformance"
FILES = sorted(FOLDER.glob("*/*.mcap"))


def text(value: Any) -> Any:
    """Write a field as the conformance files do: numbers and bytes as text."""
    if isinstance(value, bytes):
        return [str(byte) for byte in value]
    if isinstance(value, dict):
        return {str(key): text(inner) for key, inner in value.items()}
    return str(value)


def as_written(record: Any) -> dict[str, Any]:
    fields = sorted([name, text(value)] for name, value in vars(record).items())
    return {"type": type(record).__name__, "fields": fields}


def test_all_files_are_there(shared_data: Path) -> None:
    assert (shared_data / "mcap_conformance").samefile(FOLDER)
    assert len(FILES) == 416


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_records_are_exactly_those_beside_the_file(file: Path) -> None:
    expected = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))["records"]
    assert [as_written(record) for record in records(file)] == expected
