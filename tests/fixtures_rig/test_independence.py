"""A rig that shared code with the product would agree with it for the wrong reason."""

import ast
import re
from pathlib import Path

ALLOWED = {
    "argparse", "collections", "dataclasses", "fixtures", "functools", "itertools", "joblib",
    "math", "mcap", "numba", "numpy", "pathlib", "pyarrow", "ruamel", "shutil", "sys", "time",
    "typing",
}  # fmt: skip
IMPORTING = re.compile("fixtures|__import__|exec|eval")


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            names.add((node.module or "").split(".")[0])
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"__import__", "exec", "eval"}, path.name
    return names


def test_the_rig_imports_nothing_of_the_product(repository: Path) -> None:
    files = sorted((repository / "fixtures").rglob("*.py"))
    assert len(files) > 20
    for path in files:
        assert imported(path) <= ALLOWED, path.name
        assert "eha_bench" not in path.read_text(), path.name


def test_the_product_imports_nothing_of_the_rig(repository: Path) -> None:
    for path in (repository / "src").rglob("*.py"):
        # to parse them all takes seconds, and nothing is imported without one of these words
        if not IMPORTING.search(path.read_text(encoding="utf-8")):
            continue
        assert "fixtures" not in imported(path), path.name
