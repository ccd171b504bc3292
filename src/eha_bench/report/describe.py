"""A trial in a few words: what is asked of the actuator, and how the rig is set up."""

from __future__ import annotations

import math

from eha_bench.core.signal import Edge, Tone
from eha_bench.core.trial import Bypass, Piston, Trial
from eha_bench.report.engineering import channel_name, display_unit, number


def describe(trial: Trial) -> tuple[str, ...]:
    """Return short phrases: reference, setup, length and rate, e.g. `piston locked`."""
    words = [_reference(trial)]
    words.append("piston locked" if trial.setup.piston is Piston.LOCKED else "piston free")
    if trial.setup.bypass is Bypass.OPEN:
        words.append("bypass open")
    if math.isfinite(trial.duration):
        words.append(_quantity(trial.duration, "s"))
    words.append(_quantity(trial.sample_rate, "Hz"))
    return tuple(words)


def _reference(trial: Trial) -> str:
    signal, si = trial.signal, trial.mode.unit
    name = channel_name(trial.channel)
    if len(signal.edges) == 1:
        return f"{name}: step {_step(signal.edges[0], si)}"
    if signal.edges:
        return f"{name}: {len(signal.edges)} steps"
    if len(signal.tones) == 1:
        return f"{name}: sine {_tone(signal.tones[0], si)}"
    if signal.tones:
        low = min(tone.frequency for tone in signal.tones)
        high = max(tone.frequency for tone in signal.tones)
        return f"{name}: stepped sine, {_short(low)} to {_quantity(high, 'Hz')}"
    if signal.lines:
        return f"{name}: multisine"
    if signal.sweeps:
        sweep = signal.sweeps[0]
        return f"{name}: chirp, {_short(sweep.f_start)} to {_quantity(sweep.f_stop, 'Hz')}"
    return name


def _step(edge: Edge, si: str) -> str:
    unit = display_unit(si, (edge.before, edge.after))
    return f"{_short(unit.from_si(edge.before))} → {_short(unit.from_si(edge.after))}{unit.suffix}"


def _tone(tone: Tone, si: str) -> str:
    unit = display_unit(si, (tone.offset, tone.amplitude))
    around = f"{_short(unit.from_si(tone.offset))} " if tone.offset else ""
    return (
        f"{around}± {_short(unit.difference(tone.amplitude))}{unit.suffix} "
        f"at {_short(tone.frequency)}\N{NO-BREAK SPACE}Hz"
    )


def _quantity(value: float, si: str) -> str:
    unit = display_unit(si, (value,))
    return _short(unit.from_si(value)) + unit.suffix


def _short(value: float) -> str:
    text = number(value)
    return text.rstrip("0").rstrip(".") if "." in text else text
