"""What a proposal writes: a suite that runs, a dataset that takes its recordings, and figures."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eha_bench.core import yaml_file
from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import InputError, Place
from eha_bench.core.output_folder import writable
from eha_bench.experiment.commanded import Commanded
from eha_bench.experiment.hypothesis import Question, read_question
from eha_bench.experiment.proposal import Proposal, ProposalEnding
from eha_bench.suites import load_suite


def suite_path(out: str | Path) -> Path:
    """Return where the suite goes.

    Raises:
        InputError: it is not a name of a YAML file.
    """
    path = Path(out)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(
            "--out names the suite to write", where=Place(file=str(out)), hint="end it in .yaml"
        )
    writable(path.parent)
    return path


def run_folder(suite: Path) -> Path:
    """Return the result folder that the dataset expects the suite's run in."""
    return suite.with_name(f"{suite.stem}-run")


def dataset_path(suite: Path) -> Path:
    """Return where the dataset goes."""
    return suite.with_name(f"{suite.stem}-dataset.yaml")


def write_proposal(proposal: Proposal, out: str | Path) -> tuple[Path, ...]:
    """Write suite, dataset and figures (JSON) of a proposal; return what was written.

    Nothing but the figures is written where nothing is proposed.

    Args:
        proposal: what to write. out: the suite's path.

    Raises:
        InputError: the path cannot be used.
    """
    path = suite_path(out)
    figures = path.with_suffix(".json")
    text = json.dumps(proposal.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(figures, text + "\n")
    if proposal.ending is not ProposalEnding.PROPOSED:
        return (figures,)
    head = _comment(proposal.sentence)
    load_suite(proposal.suite)
    write_text(path, head + yaml_file.to_text(proposal.suite))
    load_suite(path)
    question = read_question(proposal.source)
    content = _dataset(proposal, question, path)
    own = f"# The recordings of `eha-bench run {path.name} --out {run_folder(path).name}`"
    note = f"{own}, and\n# those of the diagnosis.\n"
    if len(content["runs"]) == len(proposal.trials):
        note = (
            f"{own} alone:\n# those of the diagnosis are not there any more, or driven otherwise.\n"
        )
    write_text(dataset_path(path), note + yaml_file.to_text(content))
    return path, dataset_path(path), figures


def _comment(sentence: str) -> str:
    lines, line = [], "#"
    for word in sentence.split():
        if len(line) + 1 + len(word) > 98:
            lines.append(line)
            line = "#"
        line += f" {word}"
    return "\n".join([*lines, line, ""])


def _dataset(proposal: Proposal, question: Question, suite: Path) -> dict[str, Any]:
    """Return a dataset over the old recordings and those that the suite will make."""
    folder = suite.parent.resolve()
    command = Commanded.of(question).channel
    recordings = os.path.relpath(run_folder(suite).resolve() / "recordings", folder)
    new = [
        {
            "log": f"{recordings}/{trial.id}-0.mcap",
            "piston": trial.setup[0],
            "bypass": trial.setup[1],
            "use": "train",
        }
        for trial in proposal.trials
    ]
    old = Path(question.covered.dataset)
    if question.covered.dataset and old.is_file():
        content = yaml_file.plain(yaml_file.load(old))
        moved = _rebase_files(content, old.resolve().parent, folder)
        inputs = moved.get("inputs", [command])
        if command in inputs:
            return {**moved, "runs": [*moved["runs"], *new]}
    # what was recorded before is driven by something else, or is not there any more
    model = question.source.parent.resolve() / "recalibrated.yaml"
    return {"model": os.path.relpath(model, folder), "inputs": [command], "runs": new}


def _rebase_files(content: Mapping[str, Any], before: Path, after: Path) -> dict[str, Any]:
    """Return a dataset whose files are named from another folder; channels stand in each run."""

    def named(name: str) -> str:
        return os.path.relpath(before / name, after)

    shared = content.get("channels")
    runs = []
    for run in content["runs"]:
        own = {**run, "log": named(run["log"])}
        channels = run.get("channels", shared if isinstance(shared, str) else None)
        if channels is not None:
            own["channels"] = named(channels)
        runs.append(own)
    out = {key: value for key, value in content.items() if key not in ("runs", "channels")}
    if isinstance(shared, dict):
        out["channels"] = shared
    if (before / str(content["model"])).exists():
        out["model"] = named(content["model"])
    return {**out, "runs": runs}
