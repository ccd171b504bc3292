"""A diagnosis in words: the verdict as one sentence, its numbers as a person reads them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from eha_bench.diagnosis.fit.candidates import LEARNED
from eha_bench.diagnosis.fit.convergence import Convergence
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, FoundEffect, Unknown, Verdict
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
from eha_bench.plants.model import DeclaredEffect
from eha_bench.report.engineering import (
    SIGNIFICANT_DIGITS,
    DisplayUnit,
    channel_name,
    decimals_for,
    display_unit,
    number,
    quantity,
)

_NOTHING = "\N{EN DASH}"
_SHORT_GAP = 0.02
_TIMES = 12
_ALIKE = 0.005
"""Relative difference of two errors that nobody sees in three digits."""
_WHERE = {
    "torque": "the torque balance of the shaft",
    "flow": "the flow balances of the chambers",
    "force": "the force balance of the rod",
    "measurement": "a sensor",
    "actuation": "the actuation",
}


@dataclass(frozen=True)
class ErrorRow:
    """One channel's errors as text; `ratio` is the error after over the noise floor."""

    channel: str
    uncalibrated: str
    before: str
    after: str
    floor: str
    ratio: str
    windows: str
    worse: bool


@dataclass(frozen=True)
class ParameterRow:
    """A parameter's value and 95 % interval as text; `declared` may be empty."""

    name: str
    value: str
    interval: str
    declared: str = ""


def words_of(identifier: str) -> str:
    """Return an id as words: `entrained_air` -> entrained air."""
    return identifier.replace("parameter:", "value of ").replace("_", " ")


def where(equation: str) -> str:
    """Return a balance in words."""
    return _WHERE.get(equation, f"the {equation} equation")


def headline(found: Diagnosis) -> tuple[str, str, str]:
    """Return status, verdict and the sentence that says what it rests on."""
    if found.failed is not None:
        ended = f"The stage '{found.failed.stage}' failed: "
        return "incomplete", _verdict(found), ended + _rests_on(found)
    if not found.complete:
        return "incomplete", _verdict(found), "Interrupted: " + _rests_on(found)
    status = {Verdict.NONE: "passed", Verdict.EFFECT: "warned", Verdict.UNKNOWN: "undecided"}
    wrong = found.verdict is Verdict.NONE and declared_wrongly(found)
    return "warned" if wrong else status[found.verdict], _verdict(found), _rests_on(found)


def declared_wrongly(found: Diagnosis) -> list[str]:
    """Return what is declared otherwise than the data ask for, a clause for each mistake."""
    clauses = [f"its channel map is wrong: {words} is right" for words in found.misread]
    if found.doubtful:
        clauses.append(f"all would be as believed with {' or '.join(found.doubtful)}")
    alike: dict[tuple[str, str], list[str]] = {}
    for name, declared in found.corrected.items():
        now = found.calibrated[name]
        said = amount(declared, now.unit), amount(now.value, now.unit)
        alike.setdefault(said, []).append(name)
    for (was, asked), names in alike.items():
        are = "is" if len(names) == 1 else "are"
        clauses.append(
            f"{' and '.join(names)} {are} declared as {was}, and the data ask for {asked}"
        )
    return clauses


def _verdict(found: Diagnosis) -> str:
    if found.verdict is Verdict.NONE:
        wrong = declared_wrongly(found)
        but = f", but {_enumeration(wrong)}" if wrong else ""
        return f"Nothing is missing from the model{but}"
    if found.verdict is Verdict.EFFECT:
        names = [
            f"{_or_equivalent(item.id, found)} (in {where(item.equation)})"
            for item in found.effects
        ]
        return f"The model lacks {_enumeration(names)}"
    if found.unknown is None or found.unknown.equation is None:
        return "Something is missing from the model; what it is remains open"
    if found.unknown.sensor:
        return f"A sensor reads wrongly: {found.unknown.sensor}"
    on = _enumeration([words_of(name) for name in found.unknown.in_words])
    depends = f" and depends on {on}" if on else ""
    return f"Something unknown acts in {where(found.unknown.equation)}{depends}"


def _or_equivalent(effect: str, found: Diagnosis) -> str:
    """Return an effect in words, with what the data cannot distinguish from it."""
    group = next((group for group in found.equivalent if effect in group), ())
    others = [words_of(name) for name in group if name != effect]
    return " or ".join([words_of(effect), *others])


def _adds_anything(found: Diagnosis) -> bool:
    """Whether the revised model has an effect, a curve or a number that the declared one lacks."""
    return bool(found.effects or found.corrected) or any(
        item.id == LEARNED for item in found.revised.effects
    )


def _rests_on(found: Diagnosis) -> str:
    errors = found.holdout or found.unseen or found.train
    named = [name for name, item in errors.items() if _is_explained(item)]
    if not named:
        return "no run could be scored."
    name = max(named, key=lambda key: errors[key].before / errors[key].noise_floor)
    item = errors[name]
    fitted = errors is found.train
    kind = "the runs that were fitted" if fitted else "runs that were never fitted"
    noise = f"the noise there is {amount(item.noise_floor, item.unit)}"
    if not _adds_anything(found):
        return (
            f"Recalibrated, its error in {_channel(name)} on {kind} is "
            f"{amount(item.after, item.unit)} RMS; {noise}."
        )
    if abs(item.after - item.before) < _ALIKE * item.before:
        size = amount(item.after, item.unit)
        return f"The error in {_channel(name)} on {kind} stays at {size} RMS; {noise}."
    word = "falls" if item.after <= item.before else "grows"
    return (
        f"The error in {_channel(name)} on {kind} {word} from "
        f"{amount(item.before, item.unit)} to {amount(item.after, item.unit)} RMS; {noise}."
    )


def _channel(name: str) -> str:
    words = channel_name(name)
    return words[:1].lower() + words[1:]


def _is_explained(item: ChannelError) -> bool:
    return item.noise_floor > 0.0 and math.isfinite(item.before) and math.isfinite(item.after)


def error_rows(errors: dict[str, ChannelError]) -> tuple[ErrorRow, ...]:
    """Return the table of errors, the channel that was missed most first."""

    def gap(name: str) -> float:
        # a current that is logged as it was commanded has no noise
        floor = errors[name].noise_floor
        ratio = errors[name].before / floor if floor > 0.0 else math.nan
        return -ratio if math.isfinite(ratio) else 0.0

    rows = []
    for name in sorted(errors, key=lambda name: (gap(name), name)):
        item = errors[name]
        ratio = item.after / item.noise_floor if item.noise_floor > 0.0 else math.nan
        apart = item.after > 1.5 * item.after_windows
        times_floor = f"{number(ratio, 2 if ratio < 100.0 else 0)} ×"
        # one unit a row, so that its numbers compare at a glance
        unit = display_unit(item.unit, (item.before, item.noise_floor))
        rows.append(
            ErrorRow(
                channel_name(name) + (f" / {unit.symbol}" if unit.symbol else ""),
                error_text(item.uncalibrated, unit),
                error_text(item.before, unit),
                error_text(item.after, unit),
                error_text(item.noise_floor, unit),
                times_floor if math.isfinite(ratio) else _NOTHING,
                amount(item.after_windows, item.unit) if apart else "",
                item.after > 1.05 * item.before,
            )
        )
    return tuple(rows)


def error_text(value: float, unit: DisplayUnit, digits: int = 3) -> str:
    """Write an error in a unit that stands elsewhere."""
    if math.isinf(value):
        return "diverges"
    if not math.isfinite(value):
        return _NOTHING
    shown = unit.difference(value)
    return number(shown, max(0, decimals_for(shown) - (SIGNIFICANT_DIGITS - digits)))


def amount(value: float, si: str) -> str:
    """Write an error: with its unit, or that it is not known or diverges."""
    if math.isinf(value):
        return "diverges"
    return quantity(value, si) if math.isfinite(value) else _NOTHING


def no_interval(convergence: Convergence | None) -> str:
    """Return why a whole fit gives no interval, "" where it gives those that the data determine."""
    if convergence is None or convergence.has_intervals:
        return ""
    return "no interval: " + (
        "the residual is far above its floor" if convergence.converged else "not converged"
    )


def parameter_row(
    name: str, item: Estimate, declared: float = math.nan, why: str = ""
) -> ParameterRow:
    """Return a parameter as text; `why` no interval of its fit is given, "" where they are."""
    # a frequency is no speed, whatever their common unit
    written = item.unit if name.endswith("frequency") else ""
    spread = (item.high - item.low) / 2.0
    known = math.isfinite(item.low) and math.isfinite(item.high)
    interval = why or "not determined by these data"
    if known and spread > 0.0:
        unit = display_unit(item.unit, (item.value,), written=written)
        digits = decimals_for(unit.from_si(item.value), unit.difference(spread))
        low, high = (
            # an end at a bound of nothing has no digits to tell
            number(unit.from_si(end), digits) if unit.from_si(end) else "0"
            for end in (item.low, item.high)
        )
        interval = f"{low} … {high}"
    elif known:
        interval = "exact"
    value = quantity(item.value, item.unit, spread=spread if known else math.nan, written=written)
    given = quantity(declared, item.unit, written=written) if math.isfinite(declared) else ""
    return ParameterRow(name, value, interval, given)


def no_interval_of(effect: FoundEffect, found: Diagnosis) -> str:
    """Return why an effect's numbers have no interval, "" where the data determine them."""
    why, left = no_interval(found.convergence), found.remainder
    if not why and left is not None and effect.id in left.found_there:
        return "no interval: its law may be another one"
    return why


def effect_rows(effect: FoundEffect, found: Diagnosis) -> tuple[ParameterRow, ...]:
    """Return the numbers of an effect, and its words.

    Args:
        effect: one of those that were found. found: the diagnosis.
    """
    why = no_interval_of(effect, found)
    rows = [parameter_row(name, item, why=why) for name, item in effect.parameters.items()]
    rows += [ParameterRow(name, word, "") for name, word in effect.settings.items()]
    return tuple(rows)


def share(value: float) -> str:
    """Write a share of the excess as per cent."""
    if not math.isfinite(value):
        return _NOTHING
    if 0.0 < value < 0.0005:
        return "< 0.1 %"
    return f"{number(100.0 * min(value, 1.0), 1)} %" if value > 0.0 else "nothing"


def probability(value: float) -> str:
    """Write a p-value."""
    if not math.isfinite(value):
        return _NOTHING
    return "< 0.0001" if value < 1e-4 else number(value, 4)


def times(when: Iterable[tuple[float, float]]) -> str:
    """Write stretches of time in s; those less than a gap apart are one, and many are counted."""
    merged: list[list[float]] = []
    for start, stop in when:
        if merged and start - merged[-1][1] < _SHORT_GAP:
            merged[-1][1] = stop
        else:
            merged.append([start, stop])
    named = [f"{number(start, 3)} … {number(stop, 3)} s" for start, stop in merged[:_TIMES]]
    more = len(merged) - len(named)
    return ", ".join(named) + (f" and {more} more stretches" if more else "")


def unknown_place(found: Unknown) -> str:
    """Say in which balance something unknown acts, and where; "" where it was not located."""
    if found.equation is None:
        return ""
    at = words_of(found.at.removesuffix(".sensor"))
    return f"{where(found.equation)}, at {at}" if at else where(found.equation)


def unknown_text(found: Unknown, effects: Iterable[DeclaredEffect]) -> str:
    """Say how much a learned curve explains, whether it comes again, and where the model errs most.

    Args:
        found: what is unknown. effects: of the revised model, the curve among them if it has it.
    """
    named = []
    if found.sensor:
        named.append(
            f"{found.sensor}: read right, as here, {share(found.share)} of what was missing goes. "
            "Correct the channel's scale, or have the sensor calibrated."
        )
    elif math.isfinite(found.share) and found.share > 0.0:
        text = f"A learned curve explains {share(found.share)} of what noise does not"
        if any(effect.id == LEARNED for effect in effects):
            named.append(f"{text}.")
            if found.shape:
                named.append(f"It is {found.shape}.")
        else:
            named.append(f"{text} in windows; the revised model is without it, the notes say why.")
    elif found.description:
        named.append(f"{found.description[:1].upper()}{found.description[1:]}.")
    if found.period > 0.0:
        unit = {"time": "s", "shaft_angle": "rad"}.get(next(iter(found.variables), ""), "")
        named.append(f"It repeats every {quantity(found.period, unit)}.")
    if found.where:
        named.append(f"{found.where[:1].upper()}{found.where[1:]}.")
    return " ".join(named)


def _enumeration(words: list[str]) -> str:
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
