"""`eha-bench predict`, `calibrate` and `diagnose`: a model compared with recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eha_bench.cli.completion import complete_models
from eha_bench.cli.console import INTERRUPTED, TerminalProgress, say
from eha_bench.cli.terminal import columns
from eha_bench.core.errors import BUG
from eha_bench.core.note import Note, merged_notes

if TYPE_CHECKING:
    from eha_bench.diagnosis.fit.uncertainty import Estimate
    from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, FailedStage
    from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
    from eha_bench.diagnosis.replay.prediction import Prediction

Dataset = Annotated[
    Path, typer.Argument(help="dataset.yaml: a model and the recordings it is compared with.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result on standard output.")]
_HUNDRED = 100


def predict(
    dataset: Dataset,
    out: Annotated[Path, typer.Option("--out", help="Folder for one Parquet file a run.")],
    model: Annotated[
        str,
        typer.Option(
            "--model",
            help="model.yaml to simulate, or the name of a shipped one (default: the dataset's).",
            autocompletion=complete_models,
        ),
    ] = "",
    json: Json = False,
) -> None:
    """Simulate every run freely, from its inputs and first sample."""
    from eha_bench.diagnosis.replay.prediction import SUMMARY
    from eha_bench.diagnosis.replay.prediction import predict as simulate

    with TerminalProgress() as bar:
        found = simulate(dataset, model or None, out, progress=_stages(bar))
    for note in _notes_of(found):
        say(note)
    say(f"{len(found)} runs simulated")
    for cells in columns([*_prediction_rows(found)], right=(2,)):
        say("  ".join(cells).replace("\N{NO-BREAK SPACE}", " "))
    if json:
        typer.echo((out / SUMMARY).read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(str(out))


def _notes_of(found: Sequence[Prediction]) -> tuple[str, ...]:
    """Return the notes of all runs, those that differ in the run, or in numbers, as one."""
    notes = [note for item in found for note in item.notes]
    own = [note for note in notes if isinstance(note, Note) and "run" in note.values]
    return (*merged_notes(own), *dict.fromkeys(note for note in notes if note not in own))


def _prediction_rows(found: Sequence[Prediction]) -> Iterator[tuple[str, str, str]]:
    """Yield run, channel and error (root mean square), the run named once."""
    from eha_bench.report.engineering import quantity

    for item in found:
        for number, (channel, error) in enumerate(item.errors.items()):
            size = quantity(error, item.unit(channel)) if math.isfinite(error) else "diverges"
            yield "" if number else f"  error of {item.run}", channel, size


def calibrate(
    dataset: Dataset,
    out: Annotated[Path, typer.Option("--out", help="Folder for calibrated.yaml.")],
    json: Json = False,
) -> None:
    """Estimate a model's parameters, with intervals.

    Those under `calibrate` in the model; what the dataset's recordings do not determine is named.
    """
    from eha_bench.diagnosis.calibrate import calibrate as estimate
    from eha_bench.report.diagnosis_text import no_interval

    with TerminalProgress() as bar:
        found = estimate(dataset, out, _stages(bar))
    for note in found.notes:
        say(note)
    estimates = dict(found.parameters)
    for run, own in found.per_run.items():
        estimates |= {f"{name} in {run}": item for name, item in own.items()}
    _say_estimates(estimates, no_interval(found.convergence))
    for direction in found.undetermined:
        say(f"not identifiable: {direction}")
    models = ("declared", "calibrated")
    _say_errors(found.holdout, "held-out", models)
    _say_errors(found.unseen, "unseen", models)
    if json:
        typer.echo((out / "calibration.json").read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(str(out / "calibrated.yaml"))
    _leave_if_failed(found.failed, out)
    if not found.complete:
        say("interrupted: these are the values reached so far")
        raise typer.Exit(INTERRUPTED)


def diagnose(
    dataset: Dataset,
    out: Annotated[Path, typer.Option("--out", help="Folder for the page and the models.")],
    workers: Annotated[
        str,
        typer.Option(
            "--workers",
            help="Number of processes that fit candidates (0: one a processor), or "
            "dask://host:port or ray://host:port (default: threads).",
        ),
    ] = "",
    json: Json = False,
) -> None:
    """Find what a model lacks, and revise it.

    Residual, cause, revised model, and the error before and after.
    """
    from eha_bench.api import diagnose as close

    with TerminalProgress() as bar:
        found = close(dataset, out, _stages(bar), workers=workers)
    for note in found.notes:
        say(note)
    _say_verdict(found)
    if json:
        typer.echo(found.to_json(), nl=False)
    else:
        typer.echo(str(out / "diagnosis.html"))
    _leave_if_failed(found.failed, out)
    if not found.complete:
        raise typer.Exit(INTERRUPTED)


def _leave_if_failed(failed: FailedStage | None, out: Path) -> None:
    """Say which stage failed, and leave with the status of a bug."""
    if failed is not None:
        say(failed.trace.rstrip())
        say(f"eha-bench: the stage '{failed.stage}' failed; earlier findings are in {out}")
        raise typer.Exit(BUG)


def _say_verdict(found: Diagnosis) -> None:
    """Print verdict, causes and the held-out error before and after."""
    from eha_bench.diagnosis.outcome.diagnosis import Verdict
    from eha_bench.plants.effect import EVERYWHERE
    from eha_bench.report.diagnosis_text import declared_wrongly, no_interval, no_interval_of

    say(f"verdict: {found.verdict.value}{_unfinished_note(found)}")
    for clause in declared_wrongly(found):
        say(f"  {clause}")
    for effect in found.effects:
        why = no_interval_of(effect, found)
        values = ", ".join(
            f"{key} = {' '.join(_estimate(key, v, why))}" for key, v in effect.parameters.items()
        )
        place = f", at {effect.at}" if effect.at else ""
        place = ", everywhere" if effect.at == EVERYWHERE else place
        words = ", ".join(f"{key} {word}" for key, word in effect.settings.items())
        form = f" ({words})" if words else ""
        say(f"  {effect.id} in the {effect.equation} equation{place}{form}: {values}")
    if found.unknown and found.unknown.sensor:
        say(f"  a sensor reads wrongly, nothing else is missing: {found.unknown.sensor}")
    elif found.unknown and found.unknown.equation and found.unknown.variables:
        place = f", at {found.unknown.at}" if found.unknown.at else ""
        variables = ", ".join(found.unknown.in_words)
        say(
            f"  unknown effect in the {found.unknown.equation} equation{place}, "
            f"depends on {variables}"
        )
        if found.unknown.shape:
            say(f"  the learned curve is {found.unknown.shape}")
    elif found.unknown:
        say(f"  {found.unknown.description}")
    if found.verdict is Verdict.NONE and found.calibrated:
        say("  calibrated")
        _say_estimates(found.calibrated, no_interval(found.convergence), indent="    ")
    for group in found.equivalent:
        say(f"  these data do not distinguish: {', '.join(group)}")
    _say_errors(found.holdout, "held-out")
    _say_errors(found.unseen, "unseen")


def _unfinished_note(found: Diagnosis) -> str:
    if found.failed is not None:
        return f" (the stage '{found.failed.stage}' failed)"
    return "" if found.complete else " (interrupted)"


def _say_errors(
    errors: Mapping[str, ChannelError],
    kind: str,
    models: tuple[str, str] = ("recalibrated", "revised"),
) -> None:
    """Print each channel's error by both models, and its noise floor, in the page's units."""
    from eha_bench.report.diagnosis_text import error_rows

    if not errors:
        return
    heading = (f"  error, {kind} runs", *models, "noise floor")
    rows = [
        (f"    {row.channel}", row.before, row.after, row.floor) for row in error_rows(dict(errors))
    ]
    for cells in columns([heading, *rows], right=(1, 2, 3)):
        say("  ".join(cells).replace("\N{NO-BREAK SPACE}", " "))


def _say_estimates(estimates: Mapping[str, Estimate], why: str, indent: str = "") -> None:
    """Print each value with its interval, or why there is none."""
    rows = [(indent + name, *_estimate(name, item, why)) for name, item in estimates.items()]
    for cells in columns(rows, right=(1,)):
        say("  ".join(cells).rstrip())


def _estimate(name: str, item: Estimate, why: str = "") -> tuple[str, str]:
    """Return a value with its unit, and its interval, or why there is none, as the page has it."""
    from eha_bench.report.diagnosis_text import parameter_row

    row = parameter_row(name, item, why=why)
    return row.value.replace("\N{NO-BREAK SPACE}", " "), f"({row.interval})"


def _stages(bar: TerminalProgress) -> Callable[[str, float], None]:
    """Return a progress callback by stage and fraction that draws on the bar."""
    return lambda stage, fraction: bar(round(_HUNDRED * fraction), _HUNDRED, stage)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command()(predict)
    app.command()(calibrate)
    app.command()(diagnose)
