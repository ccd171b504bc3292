"""target.yaml of a drive on a CAN bus: which frame and signal means what, and what is safe."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

from pydantic import Field

from eha_bench.core.trial import Bypass, Piston
from eha_bench.core.units import Unit
from eha_bench.core.yaml_file import Real, StrictModel

Seconds = Annotated[float, Unit("s")]
Quantity = Real | str


class ControlPlace(StrEnum):
    """Where the loop is closed."""

    HOST = "host"
    SET_POINT = "set-point"


class BusFile(StrictModel):
    """The bus as python-can opens it."""

    interface: Annotated[str, Field(description="of python-can: slcan, socketcan, pcan ...")]
    channel: Annotated[str, Field(description="port, device or network interface")]
    bitrate: Annotated[int, Field(gt=0, description="bit/s")] = 1_000_000
    options: Annotated[
        dict[str, bool | int | float | str], Field(description="passed on to python-can")
    ] = Field(default_factory=dict)


class SyncFile(StrictModel):
    """The frame that starts every tick; the drive answers it with its status frames."""

    message: str
    counter: Annotated[str, Field(description="signal that counts the ticks")] = ""


class SignalFile(StrictModel):
    """One signal of a message: `(physical value of the DBC * scale + offset)` in `unit`."""

    message: str
    signal: str
    unit: Annotated[str, Field(description="unit that scale and offset lead to")] = ""
    scale: Real = 1.0
    offset: Real = 0.0


class CommandFile(SignalFile):
    """The message that carries a mode's reference, and what else stands in it."""

    fixed: Annotated[
        dict[str, float], Field(alias="with", description="signals that stay as they are")
    ] = Field(default_factory=dict)


class StateFile(StrictModel):
    """Where the drive says in which state it is; `off`, `enabled` and `fault` are needed."""

    message: str
    signal: str
    mask: Annotated[int, Field(description="bits that count")] = 0xFFFFFFFF
    values: dict[str, int]


class WordFile(StrictModel):
    """One step of enabling: the word to send until the drive is in the state."""

    word: int
    state: str


class ControlWordFile(StrictModel):
    """What commands the drive; the signal stands in every command message."""

    signal: str
    enable: Annotated[list[WordFile], Field(min_length=1)]
    disable: int
    reset: Annotated[int, Field(description="clears a fault; only sent by `eha-bench clear`")]


class PlaceFile(StrictModel):
    """A signal of a message."""

    message: str
    signal: str


class ConditionFile(PlaceFile):
    """A signal that has to have a value."""

    mask: int = 0xFFFFFFFF
    value: int


class HeartbeatFile(StrictModel):
    """A frame that comes by itself as long as the drive lives."""

    message: str
    timeout: Annotated[Seconds, Field(gt=0)]
    signal: str = ""
    value: Annotated[int | None, Field(description="what the signal has to be")] = None


class FramesFile(StrictModel):
    """A frame sent once, when the bus is opened (CANopen: start the node)."""

    message: str
    signals: dict[str, float]


class PistonSignalFile(StrictModel):
    """Signal that locks the rod."""

    signal: str
    locked: int
    free: int


class BypassSignalFile(StrictModel):
    """Signal that opens the bypass."""

    signal: str
    open: int
    closed: int


class PositionFile(StrictModel):
    """Signal that says where the rod is to start."""

    signal: str
    unit: str
    scale: Real = 1.0
    offset: Real = 0.0


class FixtureFile(StrictModel):
    """The test fixture: brings the rig into a trial's setup while the torque is off."""

    message: str
    request: Annotated[str, Field(description="signal with a new number for every request")]
    done: Annotated[PlaceFile, Field(description="repeats the number when it is done")]
    piston: PistonSignalFile
    bypass: BypassSignalFile
    position: PositionFile
    timeout: Seconds = 5.0


class ManualSetupFile(StrictModel):
    """How a person has set up a rig that has no such fixture."""

    piston: Piston
    bypass: Bypass = Bypass.CLOSED
    start_within: Annotated[
        float, Unit("m"), Field(gt=0, description="of the trial's start position")
    ] = 1e-3


class ChannelLimitFile(StrictModel):
    """What a channel has to keep at every tick; a key that is left out is not checked."""

    low: Quantity | None = None
    high: Quantity | None = None
    rate: Annotated[Quantity | None, Field(description="largest change a second")] = None
    stale: Annotated[
        Seconds | None, Field(description="oldest value that is used; 12 ms if not given")
    ] = None
    frozen: Annotated[
        Seconds | None, Field(description="longest time with exactly the same value")
    ] = None


class FollowingFile(StrictModel):
    """How far a channel may be from its command, and for how long."""

    within: Quantity
    length: Annotated[Seconds, Field(alias="for")] = 0.01


class TorqueBalanceFile(StrictModel):
    """What the torque balance may be off."""

    within: Annotated[float, Unit("N*m"), Field(gt=0)]
    share: Annotated[Real, Field(ge=0, description="of the larger side")] = 0.15


class MotionBalanceFile(StrictModel):
    """What the change of position may be off from the velocity."""

    within: Annotated[float, Unit("m/s"), Field(gt=0)]
    share: Annotated[Real, Field(ge=0, description="of the larger side")] = 0.15


class BalanceFile(StrictModel):
    """Signals that may not contradict each other, by the nominal model."""

    over: Annotated[Seconds, Field(gt=0, description="length of the window")] = 0.015
    torque: TorqueBalanceFile | None = None
    motion: MotionBalanceFile | None = None


class LoopFile(StrictModel):
    """How the loop is run, and when it is too bad to be scored (shares of ticks or frames)."""

    overruns: Annotated[Real, Field(ge=0, le=1)] = 0.01
    lost: Annotated[Real, Field(ge=0, le=1)] = 0.01
    late: Annotated[Real, Field(ge=0, le=1)] = 0.01
    reply: Annotated[
        float, Field(gt=0, lt=1, description="share of a period to wait for the drive's answer")
    ] = 0.6
    spin: Annotated[
        Seconds, Field(ge=0, le=1e-3, description="busy waiting at the end of a period")
    ] = 0.0
    priority: Annotated[
        int, Field(ge=0, le=99, description="SCHED_FIFO priority where permitted; 0: none")
    ] = 0


class StartFile(StrictModel):
    """What has to hold before the torque comes on."""

    timeout: Annotated[Seconds, Field(gt=0, description="for the first frames")] = 2.0
    watch: Annotated[Seconds, Field(gt=0, description="how long the sensors are read")] = 0.1
    speed: Annotated[
        float, Unit("rad/s"), Field(gt=0, description="largest motor speed at rest")
    ] = 2.0
    velocity: Annotated[
        float, Unit("m/s"), Field(gt=0, description="largest rod velocity at rest")
    ] = 0.01
    enable: Annotated[Seconds, Field(gt=0, description="for the drive to take its torque on")] = 1.0


class CanTargetFile(StrictModel):
    """A target.yaml for a drive on a CAN bus."""

    target: Annotated[str, Field(pattern="^can$")]
    base: Annotated[
        str, Field(description="another target.yaml; keys given here replace its keys")
    ] = ""
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,60}$")]
    dbc: Annotated[str, Field(description="DBC file, relative to this file")]
    bus: BusFile
    control: ControlPlace = ControlPlace.HOST
    model: Annotated[str, Field(description="the rig's nominal model.yaml")] = ""
    controller: Annotated[str, Field(description="controller.yaml of host mode")] = ""
    sync: SyncFile | None = None
    channels: Annotated[dict[str, SignalFile], Field(min_length=1)]
    counters: dict[str, str] = Field(default_factory=dict)
    commands: Annotated[dict[str, CommandFile], Field(min_length=1, description="by control mode")]
    state: StateFile
    control_word: ControlWordFile
    fault_code: PlaceFile | None = None
    heartbeat: HeartbeatFile | None = None
    emergency_stop: ConditionFile | None = None
    begin: Annotated[list[FramesFile], Field(description="sent when the bus is opened")] = Field(
        default_factory=list
    )
    fixture: FixtureFile | None = None
    setup: ManualSetupFile | None = None
    limits: dict[str, ChannelLimitFile] = Field(default_factory=dict)
    following: dict[str, FollowingFile] = Field(default_factory=dict)
    joint_agrees: Annotated[
        float | None, Unit("rad"), Field(description="joint angle against rod position")
    ] = None
    balance: BalanceFile = Field(default_factory=BalanceFile)
    start: StartFile = Field(default_factory=StartFile)
    loop: LoopFile = Field(default_factory=LoopFile)


def schema() -> dict[str, Any]:
    """Return the JSON Schema."""
    return CanTargetFile.model_json_schema()
