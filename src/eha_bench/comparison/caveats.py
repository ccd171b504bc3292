"""What differs between two sides besides what was to be compared, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

from eha_bench.comparison.side import Side
from eha_bench.core.errors import InputError


def check_targets(baseline: Side, candidate: Side) -> None:
    """Refuse results of different rigs.

    Raises:
        InputError: they ran on different targets.
    """
    kinds = {_kind(name) for side in (baseline, candidate) for name in side.targets}
    if len(kinds) > 1:
        raise InputError(
            f"not the same rig: the baseline ran on {_quoted(baseline.targets)}, the candidate "
            f"on {_quoted(candidate.targets)}",
            hint="allow it with --across-targets",
        )


def caveats(baseline: Side, candidate: Side) -> tuple[str, ...]:
    """Return what a reader has to know before believing the comparison, a sentence each."""
    return tuple(_caveats(baseline, candidate))


def _caveats(baseline: Side, candidate: Side) -> Iterator[str]:
    sides = {"baseline": baseline, "candidate": candidate}
    if baseline.suites != candidate.suites or len(baseline.suites) > 1:
        yield (
            f"Different suites: {_quoted(baseline.suites)} in the baseline, "
            f"{_quoted(candidate.suites)} in the candidate."
        )
    elif baseline.provenance("suite_sha256") != candidate.provenance("suite_sha256"):
        yield (
            "Different versions of the suite: only trials that are shown to be unchanged are "
            "compared."
        )
    for name, side in sides.items():
        if side.left_out:
            folders = ", ".join(f"'{folder.name}'" for folder in side.left_out)
            yield f"The {name} is without {folders}: set aside for a later run of that name."
        if len(side.provenance("suite_sha256")) > 1:
            yield f"The {name}'s results come from several versions of the suite."
        for key, word in (("model_sha256", "models"), ("controller_sha256", "controllers")):
            if len(side.provenance(key)) > 1:
                yield f"The {name}'s results come from several {word}."
        stopped = sum(not run.usable for runs in side.runs.values() for run in runs)
        if stopped:
            runs = "run" if stopped == 1 else "runs"
            yield f"{stopped} {runs} of the {name} did not finish and are left out."
    if baseline.targets != candidate.targets:
        yield (
            f"Different targets: {_quoted(baseline.targets)} in the baseline, "
            f"{_quoted(candidate.targets)} in the candidate."
        )
    yield from _hosts(baseline, candidate)
    if baseline.provenance("version") != candidate.provenance("version"):
        yield (
            f"Scored by different versions of eha-bench: {_quoted(baseline.provenance('version'))} "
            f"and {_quoted(candidate.provenance('version'))}."
        )
    for trial in baseline.runs.keys() - candidate.runs.keys():
        yield f"Trial {trial} is missing in the candidate."
    for trial in candidate.runs.keys() - baseline.runs.keys():
        yield f"Trial {trial} is missing in the baseline."


def _hosts(baseline: Side, candidate: Side) -> Iterator[str]:
    hosts = baseline.provenance("host"), candidate.provenance("host")
    simulated = all(_kind(name) == "simulator" for name in baseline.targets | candidate.targets)
    # a simulator gives the same on every host
    if not simulated and hosts[0] and hosts[1] and hosts[0] != hosts[1]:
        yield (
            f"Different hosts, perhaps different rigs: {_quoted(hosts[0])} in the baseline, "
            f"{_quoted(hosts[1])} in the candidate."
        )


def trial_problem(baseline: Side, candidate: Side, trial: str) -> str:
    """Return why a trial that both sides have must not be compared; "" if it may."""
    known = baseline.definitions(trial), candidate.definitions(trial)
    versions = baseline.provenance("suite_sha256"), candidate.provenance("suite_sha256")
    same_suite = baseline.suites == candidate.suites and versions[0] == versions[1]
    for name, found in zip(("baseline", "candidate"), known, strict=True):
        if len(found) > 1:
            return f"the {name} holds different trials of this name"
    if known[0] and known[1]:
        # a newer eha-bench may describe the same trial in more words
        other_tool = baseline.provenance("version") != candidate.provenance("version")
        if known[0] == known[1] or (same_suite and versions[0] and other_tool):
            return ""
        return "the trial itself was changed"
    if same_suite or (baseline.suites == candidate.suites and not (versions[0] and versions[1])):
        return ""
    return "another version of the suite, and nothing shows that the trial is the same"


def _kind(target: str) -> str:
    """Return a target without what a simulator simulates: models are what is compared."""
    kind = target.partition(":")[0]
    return kind if kind == "simulator" else target


def _quoted(names: frozenset[str]) -> str:
    return " and ".join(f"'{name}'" for name in sorted(names)) or "(unknown)"
