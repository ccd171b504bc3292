"""What a target may be named by."""

from pathlib import Path

import pytest

from eha_bench.core import file_kind, plugins
from eha_bench.core.errors import InputError
from eha_bench.core.file_kind import FileKind
from eha_bench.plants.model import Model
from eha_bench.targets.resolve import open_target

SHEET = FileKind(
    "sheet",
    frozenset({"sheet"}),
    9,
    lambda path: None,
    dict,
    model=lambda path: Model("linear_drive", {"mass": 2.0}),
)


def test_any_kind_of_file_that_holds_a_model_is_a_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = file_kind.kinds()
    monkeypatch.setattr(file_kind, "kinds", lambda: (SHEET, *known))
    path = tmp_path / "drive.yaml"
    path.write_text("sheet: drive\n")
    assert b"mass: 2.0" in open_target(path).identity.attachments["model.yaml"]
    (tmp_path / "target.yaml").write_text("target: simulator\nmodel: drive.yaml\n")
    assert b"mass: 2.0" in open_target(tmp_path / "target.yaml").identity.attachments["model.yaml"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("trials: []\n", "this is a suite, and a target or a model is expected"),
        ("- 1\n", "neither a target nor a model"),
        ("target: simulator\nmodel: other.yaml\n", "this is a suite, and a model is expected"),
        ("model: pump_hold\n", "no input that a controller commands"),
    ],
)
def test_what_holds_no_model_is_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "other.yaml").write_text("trials: []\n")
    (tmp_path / "x.yaml").write_text(text)
    with pytest.raises(InputError, match=says):
        open_target(tmp_path / "x.yaml")


def test_the_kinds_of_files_that_are_shipped_load() -> None:
    assert {kind.name for kind in file_kind.kinds()} >= set(plugins.names("file_kinds"))
