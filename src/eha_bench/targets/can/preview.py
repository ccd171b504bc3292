"""What a run would send, as text: for `eha-bench run --dry-run`."""

from __future__ import annotations

import math

import numpy as np

from eha_bench.core.trial import Bypass, ControlMode, Piston, Trial, command_of, passes_on
from eha_bench.targets.can.drive import CanDrive, Frame
from eha_bench.targets.can.guard import GuardLimits


def preview(
    drive: CanDrive,
    mode: ControlMode,
    trial: Trial,
    position: float,
    command_limit: float,
    limits: GuardLimits,
) -> tuple[str, ...]:
    """Return one line for everything that a run of the trial would send or check."""
    file, word = drive.file, drive.file.control_word
    clock = trial.clock()
    lines = [f"bus: {file.bus.interface} {file.bus.channel}, {file.bus.bitrate} bit/s"]
    for item in file.begin:
        lines.append(f"begin: {item.message} {item.signals}")
    if file.fixture is not None:
        frame = drive.fixture_frame(
            1, trial.setup.piston is Piston.LOCKED, trial.setup.bypass is Bypass.OPEN, position
        )
        setup = f"piston {trial.setup.piston.value}, bypass {trial.setup.bypass.value}"
        lines.append(f"fixture: {_text(frame)} ({setup}, rod at {position * 1e3:.2f} mm)")
    sync = drive.sync_frame(1)
    if sync is not None:
        lines.append(f"every tick: {_text(sync)} (sync), {trial.sample_rate:g} Hz")
    for step in word.enable:
        frame = drive.command_frame(mode, 0.0, step.word)
        lines.append(f"enable: {_text(frame)} until the drive is '{step.state}'")
    on = word.enable[-1].word
    if passes_on(trial.mode, command_of(mode)):
        lines += _reference(drive, mode, trial, on)
    else:
        extremes = [drive.command_frame(mode, sign * command_limit, on) for sign in (-1, 1)]
        lines.append(
            f"{clock.size} ticks of {mode.name} from the bench's controller, at most "
            f"{command_limit:g} {mode.unit}: {_text(extremes[0])} .. {_text(extremes[1])}"
        )
    lines.append(f"always at the end: {_text(drive.command_frame(mode, 0.0, word.disable))}")
    for limit in limits.channels:
        lines.append(f"checked every tick: {limit.channel} {_limit(limit)}")
    lines += [f"checked every tick: {item.channel} {item.text} (suite)" for item in trial.safety]
    return tuple(lines)


def _reference(drive: CanDrive, mode: ControlMode, trial: Trial, word: int) -> list[str]:
    """Return the first frame of every value that the reference holds, as far as they are few."""
    clock = trial.clock()
    values = trial.reference(clock)
    changes = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    shown = changes[:8] if changes.size <= 8 else [0, int(values.argmin()), int(values.argmax())]
    lines = [f"{clock.size} ticks of {mode.name}, {values.min():g} .. {values.max():g}"]
    for tick in shown:
        frame = drive.command_frame(mode, float(values[tick]), word)
        lines.append(f"  at {clock[tick]:.4f} s: {_text(frame)} ({values[tick]:g} {mode.unit})")
    return lines


def _text(frame: Frame) -> str:
    digits = 8 if frame.extended else 3
    return f"{frame.id:0{digits}X}#{frame.data.hex().upper()}"


def _limit(limit: object) -> str:
    parts = []
    for name in ("low", "high", "rate", "stale", "frozen"):
        value = getattr(limit, name)
        if math.isfinite(value):
            parts.append(f"{name} {value:g}")
    return ", ".join(parts)
