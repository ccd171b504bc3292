"""The schema files that editors read are those that the code prints."""

import json
from pathlib import Path

import jsonschema
import pytest

from eha_bench.core import plugins
from eha_bench.core.file_kind import kind_named

KINDS = plugins.names("file_kinds")


@pytest.mark.parametrize("kind", KINDS)
def test_schema_file_is_current(kind: str, repository: Path) -> None:
    path = repository / "docs" / "schemas" / f"{kind}.json"
    printed = json.dumps(kind_named(kind).schema(), indent=2, ensure_ascii=False) + "\n"
    assert path.is_file(), f"{path.name} is missing: run make schemas"
    assert path.read_text(encoding="utf-8") == printed, f"{path.name} is stale: run make schemas"


@pytest.mark.parametrize("kind", KINDS)
def test_schema_is_a_schema(kind: str) -> None:
    jsonschema.Draft202012Validator.check_schema(kind_named(kind).schema())
