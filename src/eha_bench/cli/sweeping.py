"""`eha-bench sweep`: a suite over gains, parameters, effects and keys of its trials."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.completion import complete_sweeps, complete_targets
from eha_bench.cli.console import INTERRUPTED, TerminalProgress, say
from eha_bench.cli.running import Suite, Workers
from eha_bench.core.result import Status

if TYPE_CHECKING:
    from eha_bench.sweeps.sweep import SweepResult


def sweep(
    suite: Suite,
    over: Annotated[
        Path,
        typer.Option(
            "--over", help="sweep.yaml: what is varied, how far.", autocompletion=complete_sweeps
        ),
    ],
    target: Annotated[
        str | None,
        typer.Option(
            "--target",
            help="simulator, a target.yaml of it, a model.yaml, or a shipped name.",
            autocompletion=complete_targets,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder (default: reports/<suite>-sweep/<time>)."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Finish an interrupted sweep.")] = False,
    workers: Workers = "",
    point: Annotated[
        int | None,
        typer.Option("--point", min=0, help="Run this point alone, with recordings and report."),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print sweep.json on standard output.")
    ] = False,
) -> None:
    """Run a suite over gains or parameters: which points pass.

    Also over effects and keys of trials.
    """
    from eha_bench.api import run_point
    from eha_bench.api import sweep as run_sweep

    if point is not None:
        from eha_bench.cli.running import finish

        with TerminalProgress() as progress:
            result = run_point(suite, over, point, target, out, progress=progress)
        finish(result, json=json, verbose=False)
        return
    with TerminalProgress() as progress:
        found = run_sweep(
            suite, over, target, out, resume=resume, workers=workers, progress=progress
        )
    _say(found)
    if json:
        typer.echo((found.folder / "sweep.json").read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(str(found.folder / "sweep.html"))
    if not found.complete:
        words = ["eha-bench", "sweep", str(suite), "--over", str(over)]
        words += ["--target", target] if target else []
        say(f"interrupted; to go on: {shlex.join([*words, '--out', str(found.folder)])} --resume")
        raise typer.Exit(INTERRUPTED)
    if not found.passing_points:
        raise typer.Exit(1)


def _say(found: SweepResult) -> None:
    """Print how many points pass, the best one, and what keeps the others from it."""
    done, kept = len(found.results), found.margins >= 0.0
    say(f"{len(found.passing_points)} of {done} points keep all limits")
    best = found.best
    if best is not None:
        named = ", ".join(
            f"{factor.key} = {factor.formatted(value)}"
            for factor, value in zip(found.space.factors, found.points[best], strict=True)
        )
        word = "most margin" if found.results[best].passed else "nearest miss"
        say(f"{word}: point {best} ({named}), least margin {found.results[best].margin:+.3f}")
    if done and not found.passing_points:
        for place, limit in enumerate(found.limits):
            if not kept[:, place].any():
                say(f"  no point keeps {limit.key} ({limit.text})")
    for places in _without_score(found)[:3]:
        more = f" and {len(places) - 1} more" if len(places) > 1 else ""
        say(f"  {found.results[places[0]].reason} (point {places[0]}{more})")


def _without_score(found: SweepResult) -> list[list[int]]:
    """Return the points that have no score, in groups by the first limit that has none."""
    groups: dict[tuple[Status, int], list[int]] = {}
    for place, item in sorted(found.results.items()):
        if item.reason:
            missing = [k for k, margin in enumerate(item.margins) if not math.isfinite(margin)]
            groups.setdefault((item.status, missing[0] if missing else -1), []).append(place)
    return sorted(groups.values(), key=len, reverse=True)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(sweep)
