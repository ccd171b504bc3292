"""A proposal in words, and what its rivals predict as bands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from math import isfinite

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent
from eha_bench.core.trial import Bypass, Piston
from eha_bench.diagnosis.outcome.rival import NO_EFFECT
from eha_bench.experiment.candidates import Experiment, ExperimentSettings
from eha_bench.experiment.decision import DrawRows, distances, inner_products, layout_of
from eha_bench.experiment.hypothesis import Hypothesis
from eha_bench.experiment.narrowing import counted_parameters
from eha_bench.experiment.proposal import NEAR, Band, PlannedTrial, Proposal
from eha_bench.experiment.response import LimitMargin, Responses

_POINTS = 800
_OUTSIDE = 0.05
_SHORT_S = 0.1
_NO_ROOM = 1e6
"""Share of the room used from which on there is none: a channel begins at its limit, or beyond."""


def words_of(candidate: Experiment, plan: ExperimentSettings) -> str:
    """Say what a trial does."""
    signal = candidate.signal(plan.command[candidate.setup], plan.commanded.si_unit)
    phrases = {
        "steps": "steps of up to {most}, each held for {hold}",
        "ramp": "a ramp to {final} over {over}",
        "sine": "a sine of {amplitude} at {frequency}",
        "chirp": "a chirp of {amplitude} from {f_start} to {f_stop}",
        "multisine": "a multisine of {amplitude} from {f_min} to {f_max}",
        "prbs": "a random binary sequence between {low} and {high}, {bit} a bit",
    }[signal["kind"]].format(**_readable(signal), most=_most(signal.get("levels", ())))
    piston, bypass = candidate.setup
    # what nothing can lock moves freely anyway
    setups = ["piston locked"] if piston is Piston.LOCKED else []
    if any(other is Piston.LOCKED for other, _ in plan.command) and not setups:
        setups = ["free motion"]
    if bypass is Bypass.OPEN:
        setups.append("bypass open")
    return ", ".join([phrases, *setups, f"{candidate.seconds:.3g} s"])


def _readable(signal: Mapping[str, object]) -> dict[str, object]:
    """Return a signal's keys with times below 0.1 s in ms."""
    found = dict(signal)
    for key, value in signal.items():
        amount, _, unit = value.partition(" ") if isinstance(value, str) else ("", "", "")
        if unit == "s" and 0.0 < float(amount) < _SHORT_S:
            found[key] = f"{1000.0 * float(amount):.3g} ms"
    return found


def _most(levels: Sequence[object]) -> str:
    """Return the size of the largest of a pattern's levels, as a suite writes it."""
    words = [str(level).lstrip("-") for level in levels]
    return max(words, key=lambda word: float(word.split()[0]), default="")


def causes_in_words(rivals: Sequence[Hypothesis]) -> dict[str, str]:
    """Return what stands for each cause in a sentence, by cause.

    A rival without effects has a number that is declared wrongly, where it alone fits one.
    """
    found = {rival.cause: rival.cause for rival in rivals}
    for rival in rivals:
        if rival.cause != NO_EFFECT:
            continue
        others = {key for other in rivals if other.cause != NO_EFFECT for key in other.keys}
        own = [key for key in counted_parameters(rival.keys) if key not in others]
        found[rival.cause] = f"another {' and '.join(own)}" if own else "no effect"
    return found


def sentence_of(proposal: Proposal, causes: Mapping[str, str]) -> str:
    """Say what a proposal is worth.

    Args:
        proposal: without its sentence. causes: what stands for each of its rivals.
    """
    what = "; then ".join(_counted(trial.words for trial in proposal.trials))
    what = what[:1].upper() + what[1:]
    seconds = f"{proposal.bench_seconds:.3g} s of bench time"
    near = sorted({
        room.channel for trial in proposal.trials for room in trial.rooms if room.used > NEAR
    })  # fmt: skip
    close = f" It comes near the limit of {', '.join(near)}." if near else ""
    if proposal.odds is not None:
        right, wrong = proposal.odds.right, proposal.odds.wrong
        short = "" if right >= proposal.asked else (
            f" (less than the {per_cent(proposal.asked)} asked for)"
        )  # fmt: skip
        named = ", ".join(causes[name] for name in proposal.rivals)
        return (
            f"{what}. With {seconds} the diagnosis then names the right one of {named} in "
            f"{per_cent(right)} of cases{short} and a wrong one in {per_cent(wrong, 1)}.{close}"
        )
    worst = proposal.widths[0]
    after = max(proposal.widths, key=lambda item: item.after)
    short = "" if after.after <= proposal.asked else (
        f", more than the {per_cent(proposal.asked, 2)} asked for"
    )  # fmt: skip
    rest = ", the widest still" if after is worst else (
        f"; the widest is then {after.parameter}, {width_words(after.after, after.of)}"
    )  # fmt: skip
    return (
        f"{what}. It takes {seconds} and reduces the interval of {worst.parameter} from "
        f"{width_words(worst.before, worst.of)} to {width_words(worst.after, worst.of)}{rest}"
        f"{short}.{close}"
    )


def width_words(share: float, of: str) -> str:
    """Return half of an interval: `± 12 % of its value`, `± 48 times its value`, `± 0.05 rad`."""
    if of.startswith("1 "):
        return f"± {share:.2g} {of.removeprefix('1 ')}"
    if share < 1.0:
        return f"± {100.0 * share:.2g} % of {of}"
    return f"± {share:.2g} times {of}"


def broken_limit(room: LimitMargin, count: int, unit: str) -> str:
    """Say which limit is in the way, and how far the mildest experiment goes beyond it.

    Args:
        room: of the mildest. count: of experiments that break it at any size.
        unit: SI, of its channel.
    """
    scale, unit = (1e-6, "MPa") if unit == "Pa" else (1.0, unit)
    limit = room.limit
    ends = [f"{scale * end:.4g}" for end in (limit.low, limit.high) if isfinite(end)]
    kept = " to ".join(ends)
    if len(ends) == 1:
        kept = f"at {'most' if isfinite(limit.high) else 'least'} {kept}"
    kept = f", {kept} {unit}".rstrip() if ends else ""
    if isfinite(limit.rate):
        kept += f", at most {scale * limit.rate:.4g} {unit} a second".replace("  ", " ")
    reached = f"{scale * room.low:.3g} to {scale * room.high:.3g} {unit}".rstrip()
    times = f", with noise {room.used:.3g} times the room there is" if room.used < _NO_ROOM else ""
    return (
        f"{count} {'breaks' if count == 1 else 'break'} the limit of {room.channel}{kept}, at any "
        f"size; the mildest would go from {reached}{times}"
    )


def _counted(words: Iterable[str]) -> Iterator[str]:
    """Yield what is done, once with how often where it is done again and again."""
    for text, group in groupby(words):
        times = len(list(group))
        yield text if times == 1 else f"{text}, {times} times"


def planned_trial(
    name: str,
    candidate: Experiment,
    plan: ExperimentSettings,
    rivals: Sequence[Hypothesis],
    layout: DrawRows,
    responses: Responses,
) -> PlannedTrial:
    """Return a trial with what each rival predicts of it.

    Args:
        name: its id. candidate, plan: what it is. rivals, layout: what was simulated.
        responses: the simulation.
    """
    plant = rivals[0].model.plant
    clock = responses.trial.clock()
    every = max(1, clock.size // _POINTS)
    bands = {}
    for rival, outputs, z in zip(rivals, responses.outputs, layout.draws, strict=True):
        own = {}
        for channel in responses.bench.channels:
            curves = outputs[: len(z), ::every, plant.outputs.index(channel)]
            low, high = np.quantile(curves, [_OUTSIDE, 1.0 - _OUTSIDE], axis=0)
            own[channel] = Band(curves[0], low, high)
        bands[rival.id] = own
    time = clock[::every] - clock[0]
    piston, bypass = candidate.setup
    return PlannedTrial(
        name,
        words_of(candidate, plan),
        responses.trial.duration,
        time,
        responses.trial.reference(clock)[::every],
        bands,
        separation(rivals, layout, responses, range(1, clock.size + 1, every)),
        responses.rooms,
        (piston.value, bypass.value),
        dict(plant.units),
        plan.commanded.si_unit,
    )


def separation(
    rivals: Sequence[Hypothesis],
    layout: DrawRows,
    responses: Responses,
    ticks: Sequence[int],
) -> FloatArray:
    """Return the squared distance of the nearest two rivals up to each tick, 0 for one rival.

    Args:
        rivals, layout, responses: as of `planned_trial`. ticks: increasing.
    """
    if not layout.pairs:
        return np.zeros(len(ticks))
    # the fitted values and the slopes tell it; with all draws the products would take gigabytes
    fitted = layout_of(rivals, 0)
    simulated = [
        np.concatenate([outputs[:1], outputs[len(z) :]])
        for outputs, z in zip(responses.outputs, layout.draws, strict=True)
    ]
    outputs = rivals[0].model.plant.outputs
    grams = inner_products(fitted, simulated, outputs, responses.bench, ticks, [0])
    return np.array([float(distances(fitted, gram).min()) for gram in grams])
