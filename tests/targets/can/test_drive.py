"""Frames to channels and back, for both shipped drives."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.trial import ControlMode
from eha_bench.rig.status import StatusFrames
from eha_bench.targets.can.drive import CanDrive, decode

MODES = [ControlMode.CURRENT, ControlMode.PRESSURE, ControlMode.JOINT_ANGLE]


@pytest.mark.parametrize("mode", MODES)
@given(value=st.floats(-50.0, 50.0))
def test_a_command_arrives_as_it_was_meant(
    eha_drive: CanDrive, mode: ControlMode, value: float
) -> None:
    command = eha_drive.commands[mode]
    scale = {"current": 1.0, "pressure": 1e6, "joint_angle": math.pi / 180}[mode.name]
    frame = eha_drive.command_frame(mode, value * scale, 1)
    signals = eha_drive.decode(frame.id, frame.data)
    assert signals is not None
    assert signals["Control"] == 1
    assert signals["Mode"] == MODES.index(mode)
    assert float(signals[command.coding.signal]) == pytest.approx(value, abs=6e-7)


@given(
    current=st.floats(-60, 60),
    pressure=st.floats(-25e6, 50e6),
    position=st.floats(-0.045, 0.045),
    counter=st.integers(0, 255),
)
def test_what_a_drive_measures_is_read_within_a_count(
    eha_drive: CanDrive, current: float, pressure: float, position: float, counter: int
) -> None:
    reading = {
        "current": current,
        "motor_speed": -3.0,
        "pressure_a": pressure,
        "pressure_b": 0.0,
        "piston_position": position,
        "piston_velocity": 0.1,
        "joint_angle": 1.5,
    }
    found = {}
    for frame in StatusFrames(eha_drive).frames(reading, counter, "enabled", stop_closed=True):
        status = eha_drive.status[frame.id]
        signals = decode(status.message, frame.data)
        assert signals[status.counter] == counter % status.modulus
        for channel, coding in status.channels.items():
            found[channel] = coding.to_si(float(signals[coding.signal]))
    assert found["current"] == pytest.approx(current, abs=1.01e-3)
    assert found["pressure_a"] == pytest.approx(pressure, abs=2.6e3)
    assert found["piston_position"] == pytest.approx(position, abs=0.76e-6)
    assert found["joint_angle"] == pytest.approx(1.5, abs=2.7e-5)


def test_a_value_that_a_signal_cannot_hold_is_held_at_its_end(eha_drive: CanDrive) -> None:
    frame = eha_drive.command_frame(ControlMode.CURRENT, 1e9, 1)
    signals = eha_drive.decode(frame.id, frame.data)
    assert signals is not None
    assert float(signals["CurrentReference"]) == pytest.approx(100.0)


def test_cia402_words_and_scaling(cia402: CanDrive) -> None:
    """CiA 402: operation enabled is xxxx xxxx x01x 0111 of the statusword; torque in per mille."""
    frame = cia402.command_frame(ControlMode.CURRENT, 23.0, 0x0F)
    assert frame.id == 0x205
    assert frame.data == bytes.fromhex("0F00F4010A")
    for state, word in (("enabled", 0x1637), ("fault", 0x0618), ("off", 0x0250), ("ready", 0x0631)):
        assert cia402.states[word & cia402.state.mask] == state


def test_short_and_foreign_frames_are_nobodys(eha_drive: CanDrive) -> None:
    assert eha_drive.decode(0x181, b"\x00") is None
    assert eha_drive.decode(0x7FF, bytes(8)) is None
