"""What has to hold before the torque comes on: life, plausible sensors, rest, setup."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from eha_bench.core.channels import unit_of
from eha_bench.core.errors import TargetFault
from eha_bench.targets.can.guard import Guard
from eha_bench.targets.can.link import DriveAbsent, Link
from eha_bench.targets.can.plan import DrivePlan

_SETTLED = 0.02
Idle = Callable[[float, Callable[[], bool]], bool]


class StartCheck:
    """The checks, in their order; each waits with the loop running and no torque."""

    def __init__(self, plan: DrivePlan, link: Link, idle: Idle) -> None:
        self._plan = plan
        self._link = link
        self._idle = idle
        self._start = link.drive.file.start

    def answers(self) -> None:
        """Wait for the first frame of everything.

        Raises:
            DriveAbsent: something does not come.
        """
        link, began = self._link, time.monotonic()
        heartbeat = link.drive.heartbeat is None

        def complete() -> bool:
            fresh = all(link.stamps.get(name, -math.inf) >= began for name in link.drive.channels)
            return fresh and link.state != "" and (heartbeat or link.heartbeat_at >= began)

        if not self._idle(self._start.timeout, complete):
            missing = [
                name for name in link.drive.channels if link.stamps.get(name, -math.inf) < began
            ]
            what = f"no {', '.join(missing)}" if missing else "no state"
            if not missing and link.state:
                what = link.alive(time.monotonic()) or "no heartbeat"
            raise DriveAbsent(
                f"the drive does not answer: {what} within {self._start.timeout:g} s",
                hint="check its supply, the bus and the DBC",
            )

    def fit(self) -> None:
        """Look at what the drive says of itself.

        Raises:
            TargetFault: it is in fault, or the emergency stop is open.
        """
        wrong = self._link.alive(time.monotonic())
        if not wrong:
            return
        if self._link.state == "fault":
            self._idle(0.3, lambda: self._link.fault_code != 0)
            wrong = self._link.alive(time.monotonic())
            hint = "look at the rig, then `eha-bench clear TARGET --by NAME`"
        else:
            hint = "" if self._link.emergency_closed else "close the emergency stop"
        raise TargetFault(f"start-up check: {wrong}", hint=hint)

    def setup(self, *, locked: bool, bypass: bool, position: float) -> None:
        """Let the fixture set the rig up, or see that a person has.

        Raises:
            DriveAbsent: the fixture does not answer.
            TargetFault: the rod is not where the trial starts.
        """
        file, link = self._link.drive.file, self._link
        if file.fixture is not None:
            request = ((link.fixture_done or 0) + 1) % 256
            link.send(link.drive.fixture_frame(request, locked, bypass, position))
            if not self._idle(file.fixture.timeout, lambda: link.fixture_done == request):
                raise DriveAbsent(
                    f"the fixture did not set the rig up within {file.fixture.timeout:g} s"
                )
            self._idle(_SETTLED, lambda: False)  # what was read while it moved is not looked at
            return
        found = link.readings.get("piston_position", math.nan)
        within = file.setup.start_within if file.setup is not None else math.inf
        if "piston_position" in link.drive.channels and not abs(found - position) <= within:
            raise TargetFault(
                f"start-up check: the rod is at {found * 1e3:.2f} mm, and the trial starts at "
                f"{position * 1e3:.2f} mm",
                hint="bring it there, or change `setup: {initial: ...}` of the trial",
            )

    def sensors(self) -> None:
        """Watch the sensors for a while: all there, plausible, at rest, none of them dead.

        Raises:
            TargetFault: one of them is not.
        """
        link = self._link
        period = 1.0 / self._plan.trial.sample_rate
        guard = Guard(self._plan.limits, self._plan.trial.safety, self._plan.linkage, period)
        wrong = ""
        speeds: dict[str, list[float]] = {"motor_speed": [], "piston_velocity": []}

        def watch() -> bool:
            nonlocal wrong
            wrong = link.alive(time.monotonic())
            wrong = wrong or guard.check(time.monotonic(), link.readings, link.stamps)
            for name, seen in speeds.items():
                if name in link.readings:
                    seen.append(link.readings[name])
            return bool(wrong)

        self._idle(self._start.watch, watch)
        for name, most in (
            ("motor_speed", self._start.speed),
            ("piston_velocity", self._start.velocity),
        ):
            seen = speeds[name]
            # the mean of the watch: noise is not motion
            mean = sum(seen) / len(seen) if seen else 0.0
            if not wrong and not abs(mean) <= most:
                wrong = f"{name} is {mean:.4g} {unit_of(name)} at rest (at most {most:g})"
        if wrong:
            raise TargetFault(f"start-up check: {wrong}")
