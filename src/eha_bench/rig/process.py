"""The rig's process: one loop over frames and time, from the first frame to the last."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from eha_bench.control.controller_file import load_controllers
from eha_bench.core.errors import InputError
from eha_bench.core.input_files import noting_inputs
from eha_bench.core.output_folder import spare_inputs
from eha_bench.core.shipped import shipped_file
from eha_bench.core.trial import command_of
from eha_bench.plants.model import model_from
from eha_bench.rig.drive import DriveLimits, RigDrive
from eha_bench.rig.faults import Fault, FaultKind, Faults
from eha_bench.rig.log import RigLog
from eha_bench.rig.real_plant import RealPlant
from eha_bench.rig.transport import Transport, open_transport
from eha_bench.targets.can.drive import CanDrive
from eha_bench.targets.can.load import load_drive
from eha_bench.targets.can.pacing import RealTime

_LONGEST_WAIT = 5e-3
_MOST_OVERSLEPT = 5e-3


@dataclass(frozen=True)
class RigOptions:
    """How a rig is played.

    Attributes:
        listen: `pty`, `pty:LINK`, `socket://127.0.0.1:PORT`, `socketcan:INTERFACE`, or "" for the
            target's bus.
        model: what the actuator really is, effects included; the target's nominal model if None.
        controller: the drive's own controllers of set-point mode; the target's if None.
        limits: of the drive.
        faults: on request.
        seed: of the sensors' noise and of lost frames.
        log: JSON lines, or None.
        priority: SCHED_FIFO priority where permitted, 0 for none.
    """

    listen: str = ""
    model: Path | None = None
    controller: Path | None = None
    limits: DriveLimits = field(default_factory=DriveLimits)
    faults: Sequence[Fault] = ()
    seed: int = 0
    log: Path | None = None
    priority: int = 0


class Rig:
    """A rig that is plugged in; `serve` runs it until it is asked to stop."""

    def __init__(self, target: Path, options: RigOptions) -> None:
        """Read the target, compile the model, open the transport.

        Raises:
            EhaBenchError: one of the files is wrong, or the transport cannot be opened.
        """
        with noting_inputs() as read:
            drive = load_drive(target)
            model = options.model or drive.model or shipped_file("models/paper.yaml")
            controller = (
                options.controller or drive.controller or shipped_file("controllers/paper.yaml")
            )
            self._plant = RealPlant(model_from(model), options.seed)
            controllers = load_controllers(controller)
        if options.log is not None:
            spare_inputs((options.log,), (*read, drive.dbc), "name another file with --log")
        _as_set_up(drive, self._plant)
        _check_command(drive, self._plant)
        _check_faults(options.faults, self._plant)
        self._log = RigLog(options.log)
        self._drive = RigDrive(
            drive,
            self._plant,
            controllers,
            Faults(options.faults),
            self._log,
            options.limits,
            options.seed,
        )
        self._priority = options.priority
        self._transport: Transport = open_transport(options.listen, drive.file.bus)

    @property
    def channel(self) -> str:
        """What a bench gives as its channel."""
        return self._transport.name

    def serve(self, stopping: Callable[[], bool], duration: float = float("inf")) -> None:
        """Run in real time until `stopping` or for `duration` s."""
        drive, transport, log = self._drive, self._transport, self._log
        started = time.monotonic()
        overslept_most = 0.0
        log.write(0.0, "start", channel=transport.name, monotonic=started)
        try:
            with RealTime(self._priority):
                now = 0.0
                while not stopping() and now < duration:
                    due = drive.due
                    frames = transport.receive(min(due - now, _LONGEST_WAIT))
                    now = time.monotonic() - started
                    overslept = max(now - due, 0.0)
                    overslept_most = max(overslept_most, overslept)
                    if overslept > _MOST_OVERSLEPT:
                        log.write(now, "overslept", by=round(overslept, 6))
                    for frame in frames:
                        drive.receive(frame, now)
                    drive.pass_time(now)
                    out = drive.take_out()
                    if out:
                        transport.send(out)
        finally:
            log.write(time.monotonic() - started, "end", overslept_most=round(overslept_most, 6))

    def close(self) -> None:
        """Unplug the rig."""
        self._transport.close()
        self._log.close()


def _check_command(drive: CanDrive, plant: RealPlant) -> None:
    """Refuse a model whose plant is commanded by something else than the drive.

    Raises:
        InputError: see above.
    """
    if drive.command is not None and command_of(drive.command) != plant.command:
        raise InputError(
            f"{drive.path.name}: the drive is commanded by {command_of(drive.command)}, and the "
            f"model's plant by {plant.command}",
            hint="name the model of what hangs on that drive with --model",
        )


def _check_faults(faults: Sequence[Fault], plant: RealPlant) -> None:
    """Refuse a fault of something that the plant does not have.

    Raises:
        InputError: see above.
    """
    for fault in faults:
        if fault.kind is FaultKind.OVER_PRESSURE and "pressure_a" not in plant.states:
            raise InputError(f"'{fault.text}': the plant has no pressure_a")


def _as_set_up(drive: CanDrive, plant: RealPlant) -> None:
    """Set the actuator up as the target says that a person did."""
    setup = drive.file.setup
    if setup is None:
        return
    if drive.file.fixture is not None:
        raise InputError(
            f"{drive.path.name}: give either `fixture` or `setup`: one of them sets the rig up"
        )
    plant.set_up(
        {}, locked=setup.piston.value == "locked", bypass_open=setup.bypass.value == "open"
    )
