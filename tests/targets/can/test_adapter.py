"""Two benches never share an adapter, whatever they call it; and noise on it ends no run."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from eha_bench.core.interruption import Interruption
from eha_bench.targets.can.adapter import adapter_of
from eha_bench.targets.can.bus import Bus, BusLost
from eha_bench.targets.can.hold import Hold, RigBusy, RigLatched
from eha_bench.targets.can.target_file import BusFile


@pytest.fixture
def port() -> Iterator[tuple[int, str]]:
    """A pseudo terminal: (the adapter's end, the name of the host's end)."""
    master, slave = os.openpty()
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def named(channel: str, interface: str = "slcan") -> str:
    return adapter_of(BusFile(interface=interface, channel=channel))


def test_every_alias_of_a_device_is_one_adapter(tmp_path: Path, port: tuple[int, str]) -> None:
    _, device = port
    link = tmp_path / "by-id"
    link.symlink_to(device)
    again = tmp_path / "again"
    again.symlink_to(link)
    folder, name = os.path.split(device)
    aliases = (
        device, str(link), str(again), f"{device}@115200", f"{folder}/../pts/{name}",
        os.path.relpath(device),
    )  # fmt: skip
    assert len({named(alias) for alias in aliases}) == 1
    assert named(device, "serial") == named(device)
    assert named("/dev/null") != named(device)


def test_every_alias_of_a_port_of_this_machine_is_one_adapter() -> None:
    hosts = ("127.0.0.1", "localhost", "[::1]")
    assert {named(f"socket://{host}:4001") for host in hosts} == {"tcp-4001"}
    assert named("socket://127.0.0.1:4002") == "tcp-4002"
    assert named("PCAN_USBBUS1", "pcan") == named("pcan_usbbus1", "PCAN")
    assert named("can7", "socketcan") != named("can8", "socketcan")


def test_the_second_bench_on_an_adapter_is_refused_whatever_its_target_is_called() -> None:
    adapter = f"tcp-test-{os.getpid()}"
    first, second = Hold("one", adapter), Hold("another", adapter)
    first.take()
    try:
        with pytest.raises(RigBusy, match=f"process {os.getpid()}"):
            second.take()
    finally:
        first.let_go()
    second.take()
    second.let_go()


def test_deleting_the_lock_frees_nothing(tmp_path: Path) -> None:
    adapter = f"tcp-deleted-{os.getpid()}"
    first, second = Hold("rig", adapter), Hold("rig", adapter)
    first.take()
    try:
        for file in (tmp_path / "state").glob("*.lock"):
            file.unlink()
        with pytest.raises(RigBusy, match="another run holds its adapter"):
            second.take()
    finally:
        first.let_go()
    second.take()
    second.let_go()


def test_a_latch_is_found_by_the_adapter_as_well() -> None:
    Hold("one", "tcp-4711").arm("step")
    with pytest.raises(RigLatched, match="step"):
        Hold("another", "tcp-4711").check()
    with pytest.raises(RigLatched, match="step"):
        Hold("one", "tcp-4712").check()
    Hold("one", "tcp-4711").clear("Ada")
    Hold("another", "tcp-4711").check()


def test_a_serial_port_is_opened_by_one_bench_only(port: tuple[int, str]) -> None:
    file = BusFile(interface="slcan", channel=port[1])
    first = Bus(file)
    try:
        with pytest.raises(BusLost, match=r"in use|cannot be opened"):
            Bus(file)
    finally:
        first.close()


def test_malformed_lines_are_counted_and_the_next_frame_is_read(port: tuple[int, str]) -> None:
    adapter, device = port
    bus = Bus(BusFile(interface="slcan", channel=device))
    try:
        os.read(adapter, 4096)
        lines = (
            b"t1Z0400\r", b"t1004AB\r", b"tq\r", b"\xff\xfe\x80t\r", b"T123\r", b"t100", b"\r",
            b"z\r", b"x" * 600, b"\r", b"t1002BEEF\r",
        )  # fmt: skip
        for line in lines:
            os.write(adapter, line)
        until, found = time.monotonic() + 5, None
        while found is None and time.monotonic() < until:
            found = bus.receive(0.05)
        assert found is not None
        assert (found.arbitration_id, bytes(found.data)) == (0x100, b"\xbe\xef")
        assert bus.malformed >= 5
    finally:
        bus.close()


def test_a_closed_terminal_ends_as_a_nightly_job_does() -> None:
    outside = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
    try:
        with Interruption() as stopping:
            os.kill(os.getpid(), signal.SIGHUP)
            assert stopping()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGHUP, outside)


def test_nohup_is_respected() -> None:
    code = (
        "import os, signal; from eha_bench.core.interruption import Interruption\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "with Interruption() as stopping:\n"
        "    os.kill(os.getpid(), signal.SIGHUP)\n"
        "    assert not stopping()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
