"""`eha-bench next` and `close`: the experiment that separates what a diagnosis leaves open."""

from __future__ import annotations

import json as json_text
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Annotated

import typer

from eha_bench.cli.console import TerminalProgress, say
from eha_bench.core.errors import InputError
from eha_bench.core.per_cent import per_cent
from eha_bench.core.result import Status

_HUNDRED = 100
_GOES_ON = "the same command goes on from here"
NONE, FAULT = 1, 3
"""Exit statuses: no experiment is proposed, or nothing settled; the target faulted."""

Budget = Annotated[
    str, typer.Option("--budget", help="Bench time that an experiment may take, e.g. '30 s'.")
]
Safety = Annotated[
    str,
    typer.Option(
        "--safety",
        help="target.yaml of a drive, or a suite, whose limits hold; without one, the extremes of "
        "the recordings are the limits.",
    ),
]
Probability = Annotated[
    float,
    typer.Option(
        "--probability", min=0.5, max=0.999, help="Required probability of naming the right rival."
    ),
]
Within = Annotated[
    str, typer.Option("--within", help="Required half-width of the 95 % intervals, e.g. '10 %'.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result on standard output.")]


def next_experiment(
    diagnosis: Annotated[Path, typer.Argument(help="diagnosis.json, or the folder it is in.")],
    logs: Annotated[
        list[Path] | None, typer.Argument(help="Further recordings to rank, with --from.")
    ] = None,
    out: Annotated[str, typer.Option("--out", help="Suite to write (next.yaml).")] = "",
    budget: Budget = "30 s",
    safety: Safety = "",
    probability: Probability = 0.95,
    within: Within = "10 %",
    pool: Annotated[
        list[Path] | None,
        typer.Option(
            "--from",
            help="Rank existing recordings, or the runs of a dataset.yaml, instead of planning.",
        ),
    ] = None,
    channels: Annotated[
        str, typer.Option("--channels", help="channels.yaml of the recordings to rank.")
    ] = "",
    json: Json = False,
) -> None:
    """Plan the experiment that tells what a diagnosis leaves open.

    The cheapest permitted one, as a suite that `run` takes.
    """
    from eha_bench.core.units import positive

    if pool:
        if out:
            raise InputError(
                "recordings that are ranked give no suite",
                hint="leave out --out; --json prints the ranking for a file",
            )
        share = positive("--within", within, "")
        _rank(diagnosis, [*pool, *(logs or [])], channels, share, json=json)
        return
    if logs or channels:
        raise InputError("recordings are ranked with --from", hint="put --from before them")
    if not out:
        raise InputError("no path for the suite", hint="add --out next.yaml")
    from eha_bench.api import next_experiment as propose
    from eha_bench.experiment.proposal import ProposalEnding

    with TerminalProgress() as bar:
        found = propose(
            diagnosis,
            out,
            budget=positive("--budget", budget, "s"),
            safety=safety or None,
            probability=probability,
            within=positive("--within", within, ""),
            progress=stages(bar),
        )
    for note in found.notes:
        say(note)
    say(found.sentence)
    if json:
        typer.echo(json_text.dumps(found.to_dict(), indent=1, ensure_ascii=False, allow_nan=False))
    else:
        page = Path(out).with_suffix(".html")
        typer.echo(out if found.ending is ProposalEnding.PROPOSED else str(page))
    if found.ending is not ProposalEnding.PROPOSED:
        raise typer.Exit(NONE)


def _rank(diagnosis: Path, logs: list[Path], channels: str, within: float, *, json: bool) -> None:
    """Print recordings, the one that would decide most surely first."""
    from eha_bench.experiment.pool import rank

    with TerminalProgress() as bar:
        found = rank(diagnosis, logs, channels=channels or None, within=within,
                     progress=stages(bar))  # fmt: skip
    if json:
        content = [item.to_dict() for item in found]
        typer.echo(json_text.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
    for place, item in enumerate(() if json else found, 1):
        if item.why:
            typer.echo(f"-   {item.name}: not ranked, {item.why}")
            continue
        outlook = _share_of_what_is_needed(item.reached)
        if isfinite(item.error):
            outlook = f"the model errs {_times_as_much(item.error)} as in what was fitted"
        elif isfinite(item.right):
            outlook = (
                f"names the right one in {per_cent(item.right)}, "
                f"a wrong one in {per_cent(item.wrong, 1)}"
            )
        typer.echo(f"{place:<3} {item.name}: {item.seconds:.3g} s, {outlook}")
    if all(item.why for item in found):
        raise InputError("none of the recordings could be ranked", hint="the list says why of each")


def _share_of_what_is_needed(share: float) -> str:
    """Return how much of what decides a recording gives, in words."""
    if share >= 2.0:
        return f"{share:.0f} times what a decision needs"
    return f"{per_cent(share)} of what a decision needs"


def _times_as_much(ratio: float) -> str:
    """Return a ratio of two errors, in words."""
    times = f"{ratio:.2g}"
    return "as much" if times == "1" else f"{times} times as much"


def close(
    dataset: Annotated[Path, typer.Argument(help="dataset.yaml to start from.")],
    target: Annotated[str, typer.Option("--target", help="Target that experiments run on.")],
    out: Annotated[Path, typer.Option("--out", help="Folder of all rounds.")],
    rounds: Annotated[
        int, typer.Option("--rounds", min=1, help="Most experiments that are made.")
    ] = 3,
    budget: Budget = "30 s",
    safety: Safety = "",
    probability: Probability = 0.95,
    within: Within = "10 %",
    json: Json = False,
) -> None:
    """Diagnose, plan, run, diagnose again until one cause is left.

    The same command goes on with rounds that were interrupted.
    """
    from eha_bench.core.units import positive
    from eha_bench.rounds import PAGE, Settled
    from eha_bench.rounds import close as close_in_rounds

    with TerminalProgress() as bar:
        try:
            found = close_in_rounds(
                dataset,
                target,
                out,
                rounds=rounds,
                budget=positive("--budget", budget, "s"),
                safety=safety or None,
                probability=probability,
                within=positive("--within", within, ""),
                progress=stages(bar),
            )
        except KeyboardInterrupt as stop:
            raise KeyboardInterrupt(_GOES_ON) from stop
    for note in found.notes:
        say(f"note: {note}")
    for item in found.rounds:
        causes = ", ".join(item.causes) or "no effect"
        plan = str((item.experiment or {}).get("sentence", ""))
        say(
            f"round {item.number}: {item.verdict} ({causes}). {plan[:1].upper()}{plan[1:]}".rstrip()
        )
    for why in found.stops:
        say(why)
    ended = {
        Settled.NONE_PERMITTED: "not settled (no further experiment)",
        Settled.OUT_OF_ROUNDS: "not settled (out of rounds)",
    }.get(found.ending, found.ending.value)
    say(f"{ended} after {found.bench_seconds:.3g} s of bench time")
    if json:
        content = found.to_dict()
        typer.echo(json_text.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))
    else:
        typer.echo(str(out / PAGE))
    if found.rounds[-1].status == Status.INCOMPLETE:
        raise KeyboardInterrupt(_GOES_ON)
    status = {Settled.SETTLED: 0, Settled.STOPPED: FAULT}.get(found.ending, NONE)
    if status:
        raise typer.Exit(status)


def stages(bar: TerminalProgress) -> Callable[[str, float], None]:
    """Return a progress callback by stage and fraction that draws on the bar."""
    return lambda stage, share: bar(round(_HUNDRED * share), _HUNDRED, stage)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("next")(next_experiment)
    app.command()(close)
