"""What holds for the whole repository: nothing of one machine in it, every module explained."""

import ast
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = sorted((REPOSITORY / "src").rglob("*.py"))

# Written so that no pattern matches its own text.
FOREIGN = {
    "a path of one machine": re.compile(
        r"(?<![\w.})\]-])/(?:root|work|home/\w+|Users/\w+|tmp/\w+)/[\w.]"
    ),
    "a file URL": re.compile(r"file:///\w"),
    "a package index": re.compile(r"https?://[^\s\"']+/simple(?![\w-])"),
}
INDEX_OPTION = re.compile(
    r"^\s*(?:-i|-f|--(?:extra-)?index-url|--find-links|--trusted-host)\b", re.M
)


def tracked_files() -> list[Path]:
    """Every file under version control that is there; skips outside a checkout."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    files = [REPOSITORY / name for name in listed.stdout.split("\0") if name]
    return [file for file in files if file.is_file()]


def text_of(file: Path) -> str | None:
    """The file's text, or None where it is binary."""
    content = file.read_bytes()
    return None if b"\0" in content[:8192] else content.decode("utf-8", errors="replace")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("see " + "/root" + "/notes.txt", "a path of one machine"),
        ('Path("' + "/home" + '/ada/log.mcap")', "a path of one machine"),
        ("file:" + "///etc/index", "a file URL"),
        ("https://index.example" + "/simple", "a package index"),
    ],
)
def test_foreign_text_is_recognised(text: str, what: str) -> None:
    assert FOREIGN[what].search(text)


def test_ordinary_text_is_not_foreign() -> None:
    text = "frame" + "work/core, reports/tmp/x, https://example.org/simple-steps, file://"
    assert not [what for what, pattern in FOREIGN.items() if pattern.search(text)]


def test_a_class_name_stands_for_one_thing() -> None:
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        if "templates" in path.parts:
            continue  # what `init` writes into projects, each a program of its own
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name, []).append(f"{path.name}:{node.lineno}")
    assert len(homes) > 500
    assert not {name: places for name, places in homes.items() if len(places) > 1}


def test_no_tracked_file_names_this_machine_or_a_package_index() -> None:
    found = []
    for file in tracked_files():
        for number, line in enumerate((text_of(file) or "").splitlines(), start=1):
            found += [
                f"{file.relative_to(REPOSITORY)}:{number}: {what}: {line.strip()[:100]}"
                for what, pattern in FOREIGN.items()
                if pattern.search(line)
            ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", ["lock.txt", "dev.txt", "mutation.txt"])
def test_lock_pins_every_package_with_a_hash_and_names_no_index(name: str) -> None:
    text = (REPOSITORY / "requirements" / name).read_text(encoding="utf-8")
    assert not INDEX_OPTION.search(text)
    entries = re.split(r"\n(?=[A-Za-z0-9])", re.sub(r"(?m)^\s*#.*\n", "", text).strip())
    unpinned = [
        entry.splitlines()[0]
        for entry in entries
        if not re.match(r"[\w.\[\]-]+==\S+", entry) or "--hash=sha256:" not in entry
    ]
    assert entries
    assert not unpinned


def test_lock_holds_every_declared_dependency() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    for name, wanted in {
        "lock.txt": [*project["dependencies"], *extras["can"]],
        "dev.txt": [
            *project["dependencies"],
            *(line for extra in extras.values() for line in extra),
        ],
    }.items():
        text = (REPOSITORY / "requirements" / name).read_text(encoding="utf-8")
        locked = set(re.findall(r"(?m)^([\w.-]+)==", text))
        names = {re.split(r"[\[<>=!~; ]", line)[0].lower().replace(".", "-") for line in wanted}
        missing = {n.replace("_", "-") for n in names} - locked - {"eha-bench"}
        assert not missing, f"requirements/{name} lacks {sorted(missing)}: run make lock"


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(REPOSITORY)))
def test_source_file_is_explained(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)), "a module says in its docstring what it is"
