"""The notebooks of examples/ run from top to bottom, and show what they promise."""

import ast
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from pages import ROOT

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def shown(source: str, names: dict[str, Any]) -> Any:
    """Run a cell as a notebook does; return the value of its last line."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "<cell>", "exec"), names)
    return eval(compile(ast.Expression(last.value), "<cell>", "eval"), names) if last else None


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    shutil.copy(notebook, tmp_path)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    forms = 0
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "outputs are not kept under version control"
            value = shown("".join(cell["source"]), names)
            html = getattr(value, "_repr_html_", lambda: None)()
            forms += bool(html)
            assert len(repr(value)) < 4000
    assert forms


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3
