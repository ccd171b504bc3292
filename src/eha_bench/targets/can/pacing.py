"""Ticks at absolute deadlines, and how well they were kept.

`time.sleep` sleeps to an absolute time of CLOCK_MONOTONIC, so that errors do not add up. With
`spin` the last part of a period is waited for busily, which takes the kernel's wake-up out of the
period; with SCHED_FIFO no ordinary process can delay it.
"""

from __future__ import annotations

import ctypes
import gc
import os
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Self

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.per_cent import per_cent

_LOCK_ALL = 1 | 2 | 4
"""MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT: every page once it is used."""
_LOOK_EVERY = 2e-3
"""Longest sleep without a look at what has to be watched, s."""
LATE = 0.5
"""Share of a period by which a tick has to be late to be an overrun."""


def _nothing() -> None:
    """Watch nothing."""


class Pacer:
    """Waits for ticks k = 0, 1, ... at start + k * period."""

    def __init__(self, period: float, spin: float = 0.0) -> None:
        """Start now; period and spin in s."""
        self._period = period
        self._spin = min(spin, 0.5 * period)
        self.start = time.monotonic()

    def begin(self, start: float) -> None:
        """Let tick 0 be at a time (of time.monotonic) in s."""
        self.start = start

    def wait(self, tick: int, watch: Callable[[], None] = _nothing) -> float:
        """Wait until a tick is due and return the time of time.monotonic then, s.

        Args:
            tick: its number.
            watch: called every few milliseconds of a long wait; what it raises ends the wait.
        """
        due = self.start + tick * self._period
        now = time.monotonic()
        while due - now - self._spin > _LOOK_EVERY:
            time.sleep(_LOOK_EVERY)
            watch()
            now = time.monotonic()
        if due - now > self._spin:
            time.sleep(due - now - self._spin)
            now = time.monotonic()
        while now < due:
            now = time.monotonic()
        return now

    def due_tick(self, now: float) -> int:
        """Return the last tick that is due at a time of time.monotonic."""
        return int((now - self.start) / self._period + 1e-9)


class RealTime:
    """A context in which the loop runs undisturbed, as far as the machine permits.

    No garbage is collected, and with a priority above 0 the calling thread runs under SCHED_FIFO
    and the process keeps its pages in memory: one that has to be read from a disk again costs more
    than many periods.

    Attributes:
        scheduling: what was reached, for the recording.
    """

    def __init__(self, priority: int) -> None:
        self._priority = priority
        self._before: tuple[int, os.sched_param] | None = None
        self._collecting = False
        self._locked = False
        self.scheduling = "ordinary"

    def __enter__(self) -> Self:
        """Ask for the priority; go on without where it is not permitted."""
        self._collecting = gc.isenabled()
        gc.disable()
        if self._priority > 0:
            policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
            with suppress(OSError):
                before = os.sched_getscheduler(0), os.sched_getparam(0)
                os.sched_setscheduler(0, policy, os.sched_param(self._priority))
                self._before = before
                self.scheduling = f"SCHED_FIFO {self._priority}"
            self._locked = _lock_memory(_LOCK_ALL)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Be an ordinary process again."""
        if self._before is not None:
            with suppress(OSError):
                os.sched_setscheduler(0, *self._before)
        if self._locked:
            _lock_memory(0)
        if self._collecting:
            gc.enable()


def _lock_memory(flags: int) -> bool:
    """Lock all pages that are there and those to come (mlockall); 0 unlocks them."""
    try:
        library = ctypes.CDLL(None)
        done = library.mlockall(flags) if flags else library.munlockall()
    except (OSError, AttributeError):  # no such call on this system
        return False
    return bool(done == 0)


class LoopHealth:
    """Counts how the ticks of one trial were kept; all memory is taken at its start."""

    def __init__(self, ticks: int, period: float, messages: int) -> None:
        """Begin with nothing; `messages` status frames are expected at every tick.

        0 stands for a drive that sends by its own clock: its lost frames are `gaps` then.
        """
        self._times: FloatArray = np.full(ticks, np.nan)
        self._period = period
        self._messages = messages
        self.ticks = 0
        self.overruns = 0
        self.skipped = 0
        self.on_time = 0
        self.late = 0
        self.gaps = 0
        self.latency_max = 0.0

    def tick(self, now: float, late_by: float, skipped: int) -> None:
        """Count a tick at `now` (s) that came `late_by` s after its deadline."""
        if self.ticks < self._times.size:
            self._times[self.ticks] = now
        self.ticks += 1
        self.skipped += skipped
        if skipped or late_by > LATE * self._period:
            self.overruns += 1 + skipped

    @property
    def lost(self) -> int:
        """Status frames that never came."""
        if not self._messages:
            return self.gaps
        return max(self._messages * self.ticks - self.on_time - self.late, 0)

    @property
    def frames(self) -> int:
        """Status frames that should have come."""
        return self._messages * self.ticks or self.on_time + self.late + self.gaps

    def metadata(self, shares: tuple[float, float, float]) -> dict[str, str]:
        """Return the health as metadata of a recording.

        Args:
            shares: of overruns, lost and late frames above which the loop was not healthy.
        """
        times = self._times[: self.ticks]
        periods = np.diff(times[np.isfinite(times)])
        p50, p999 = np.quantile(periods, (0.5, 0.999)) if periods.size else (np.nan, np.nan)
        return {
            "loop_ticks": str(self.ticks),
            "loop_period_p50": f"{p50:.9g}",
            "loop_period_p99_9": f"{p999:.9g}",
            "loop_period_max": f"{periods.max() if periods.size else np.nan:.9g}",
            "loop_overruns": str(self.overruns),
            "loop_frames": str(self.frames),
            "loop_lost_frames": str(self.lost),
            "loop_late_frames": str(self.late),
            "loop_reply_max": f"{self.latency_max:.9g}",
            "loop_unhealthy": self.trouble(*shares),
        }

    def trouble(self, overruns: float, lost: float, late: float) -> str:
        """Return why the loop is not to be believed, "" where it is."""
        found = []
        ticks, frames = max(self.ticks + self.skipped, 1), max(self.frames, 1)
        for count, of, share, what in (
            (self.overruns, ticks, overruns, "ticks overran"),
            (self.lost, frames, lost, "frames lost"),
            (self.late, frames, late, "frames late"),
        ):
            if count > share * of:
                found.append(f"{count} of {of} {what} (at most {per_cent(share, 2)})")
        return ", ".join(found)
