"""The page on recordings names every key and every word of a channels.yaml."""

from pathlib import Path
from typing import Any

from eha_bench.recordings import ChannelMapFile

PAGE = Path(__file__).resolve().parents[2] / "docs" / "recordings.md"


def words(schema: dict[str, Any]) -> set[str]:
    """Return the keys and the allowed words of all objects of a JSON schema."""
    found: set[str] = set()
    for part in (schema, *schema.get("$defs", {}).values()):
        found.update(part.get("properties", {}))
        found.update(word for word in part.get("enum", []) if isinstance(word, str))
    return found


def test_the_page_names_every_key_and_word() -> None:
    written = PAGE.read_text(encoding="utf-8")
    ticked = {word.strip(":{},") for part in written.split("`")[1::2] for word in part.split()}
    assert words(ChannelMapFile.model_json_schema()) <= ticked
