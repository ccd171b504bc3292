"""What a shell completes on TAB: names of what is shipped, files, and names within files given."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import typer

Completion = Callable[[str], list[str]]


def beginning(words: Iterable[str], incomplete: str) -> list[str]:
    """Return the words that go on from what was typed."""
    return [word for word in words if word.startswith(incomplete)]


def _yaml_files(incomplete: str) -> list[str]:
    """Return YAML files and folders that a path may go on with."""
    folder = Path(incomplete).parent if "/" in incomplete else Path()
    start = "" if incomplete.endswith("/") else Path(incomplete).name
    folder = Path(incomplete) if incomplete.endswith("/") else folder
    if not folder.is_dir():
        return []
    found = []
    for path in sorted(folder.iterdir()):
        if path.name.startswith(start) and not path.name.startswith("."):
            if path.is_dir():
                found.append(f"{path}/")
            elif path.suffix in (".yaml", ".yml"):
                found.append(str(path))
    return found


def _shipped_or_file(*folders: str, also: tuple[str, ...] = ()) -> Completion:
    def complete(incomplete: str) -> list[str]:
        from eha_bench.core.shipped import names

        known = dict.fromkeys((*also, *(name for folder in folders for name in names(folder))))
        return [*beginning(known, incomplete), *_yaml_files(incomplete)]

    return complete


complete_suites = _shipped_or_file("suites")
complete_models = _shipped_or_file("models")
complete_targets = _shipped_or_file("targets", "models", also=("simulator",))


def complete_sweeps(incomplete: str) -> list[str]:
    """Return YAML files."""
    return _yaml_files(incomplete)


def complete_kinds(incomplete: str) -> list[str]:
    """Return the kinds of YAML file."""
    from eha_bench.core import plugins

    return beginning(plugins.names("file_kinds"), incomplete)


def complete_trials(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the trials of the suite that the command line names."""
    from eha_bench.core.errors import EhaBenchError
    from eha_bench.suites import load_suite

    suite = ctx.params.get("suite")
    if not suite:
        return []
    try:
        return beginning((trial.id for trial in load_suite(suite).trials), incomplete)
    except EhaBenchError:
        return []
