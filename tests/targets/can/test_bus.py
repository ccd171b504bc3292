"""The bus is on this machine, and whatever python-can raises is a lost bus."""

import os
import pty
import tty

import pytest

from eha_bench.core.errors import TargetFault
from eha_bench.targets.can.bus import Bus, BusLost, check_channel
from eha_bench.targets.can.drive import Frame
from eha_bench.targets.can.target_file import BusFile


@pytest.mark.parametrize(
    ("interface", "channel"),
    [
        ("slcan", "socket://192.0.2.1:29536"),
        ("slcan", "rfc2217://127.0.0.1:1"),
        ("slcan", "socket://example.org:1"),
        ("udp_multicast", "239.0.0.1"),
    ],
)
def test_a_channel_that_leaves_the_machine_is_refused(interface: str, channel: str) -> None:
    with pytest.raises(TargetFault):
        check_channel(BusFile(interface=interface, channel=channel))


@pytest.mark.parametrize(
    "channel", ["socket://127.0.0.1:1", "socket://localhost:1", "/dev/ttyACM0", "can0"]
)
def test_a_channel_of_this_machine_is_taken(channel: str) -> None:
    check_channel(BusFile(interface="slcan", channel=channel))


def test_an_adapter_that_is_not_there_is_a_sentence() -> None:
    with pytest.raises(BusLost, match="cannot be opened"):
        Bus(BusFile(interface="slcan", channel="/dev/no-such-adapter"))
    with pytest.raises(BusLost, match="cannot be opened"):
        Bus(BusFile(interface="no-such-interface", channel="x"))


def test_frames_pass_both_ways_and_an_unplugged_adapter_is_a_lost_bus() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    bus = Bus(
        BusFile(interface="slcan", channel=os.ttyname(slave), options={"sleep_after_open": 0})
    )
    opening = b""
    while not opening.endswith(b"O\r"):  # closed, then opened: in one piece or in two
        opening += os.read(master, 100)
    bus.send(Frame(0x201, b"\x01\x02"))
    assert os.read(master, 100) == b"t20120102\r"
    bus.send(Frame(0x1ABCDEF0, b"", extended=True))
    assert os.read(master, 100) == b"T1ABCDEF00\r"
    os.write(master, b"z\rt181" + b"20304\rt1")
    message = bus.receive(1.0)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (0x181, b"\x03\x04")
    assert bus.receive(0.0) is None
    os.write(master, b"83105\r")
    message = bus.receive(1.0)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (0x183, b"\x05")
    os.close(slave)
    os.close(master)
    with pytest.raises(BusLost, match="is lost"):
        bus.receive(0.1)
    bus.close()
    bus.close()
