"""`eha-bench tune`: the gains that pass with the highest probability."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.completion import complete_sweeps, complete_targets
from eha_bench.cli.console import INTERRUPTED, TerminalProgress, say
from eha_bench.cli.running import Conditions, Posterior, Suite, Workers, say_probability

if TYPE_CHECKING:
    from eha_bench.tuning.tune import Tuned


def tune(  # noqa: PLR0913, PLR0917 - the options of a command
    suite: Suite,
    model: Annotated[
        str,
        typer.Option(
            "--model",
            help="model.yaml that gains are tuned for, or a simulator's target.yaml.",
            autocompletion=complete_targets,
        ),
    ],
    vary: Annotated[
        Path,
        typer.Option(
            "--vary", help="vary.yaml: which gains, how far.", autocompletion=complete_sweeps
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for tuned.yaml and its page.")],
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller", help="controller.yaml to start from (default: the suite's or target's)."
        ),
    ] = None,
    posterior: Posterior = None,
    conditions: Conditions = None,
    draws: Annotated[
        int,
        typer.Option(
            "--draws", min=1, help="Number of drawn machines on which the best gains are checked."
        ),
    ] = 200,
    candidates: Annotated[
        int,
        typer.Option(
            "--candidates", min=8, help="Number of candidates that are tried; more if none passes."
        ),
    ] = 240,
    robust: Annotated[
        str | None,
        typer.Option(
            "--robust",
            help="worst: the least margin of any draw; cvar: of the worst tenth; in place of "
            "P(pass).",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of search and draws.")] = 0,
    workers: Workers = "",
    json: Annotated[
        bool, typer.Option("--json", help="Print tuning.json on standard output.")
    ] = False,
) -> None:
    """Find the gains that pass with the highest probability.

    The probability is over what is not known of the machine.
    """
    from eha_bench.api import tune as find

    with TerminalProgress() as progress:
        found = find(
            suite, model, vary, out,
            controller=controller, posterior=posterior, conditions=conditions, draws=draws,
            candidates=candidates, robust=robust, seed=seed, workers=workers, progress=progress,
        )  # fmt: skip
    _say(found)
    if json:
        typer.echo((out / "tuning.json").read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(str(out / "tuned.yaml"))
    if not found.complete:
        raise typer.Exit(INTERRUPTED)
    if not found.feasible:
        raise typer.Exit(1)


def _say(found: Tuned) -> None:
    """Print the gains, how likely they pass, or what contradicts what."""
    for factor, before, after in zip(found.space.factors, found.before, found.point, strict=True):
        say(f"{factor.key}: {factor.formatted(before)} -> {factor.formatted(after)}")
    if found.after is not None:
        say_probability(found.after)
    else:
        for note in found.notes:
            say(f"note: {note}")
    if found.declared is not None:
        say(f"with the declared gains: P(pass) {found.declared.suite}")
    worst = min(
        zip(found.margins, found.limits, strict=True), key=lambda item: (item[0] >= -1e9, item[0])
    )
    say(f"at the model as fitted: least margin {worst[0]:+.3f}, {worst[1].key}")
    clash = found.contradiction
    if clash is None:
        return
    if not found.complete:
        say(f"interrupted: none of the {clash.tried} candidates so far keeps all limits")
        return
    say(f"infeasible: none of {clash.tried} candidates keeps all limits")
    for place in clash.never:
        say(f"  none keeps {found.limits[place].key} ({found.limits[place].text})")
    for group in clash.together:
        group_text = " and ".join(f"{found.limits[k].key} ({found.limits[k].text})" for k in group)
        say(f"  no candidate keeps all of: {group_text}")


def before_after(
    folders: Annotated[
        list[Path],
        typer.Argument(help="Folders of one diagnosis, one tuning, and one result or two."),
    ],
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path("before_after.html"),
) -> None:
    """Put a machine's diagnosis, tuning and results on one page.

    Recordings, diagnosis, revised model, tuned gains, its own result before and after.
    """
    from eha_bench.before_after import before_after as write

    typer.echo(str(write(folders, out)))


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(tune)
    app.command("before-after")(before_after)
