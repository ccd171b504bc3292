"""The rig as a node of a SocketCAN bus, on python-can's virtual one: vcan is not everywhere."""

import uuid
from typing import Any

import can
import pytest

from eha_bench.core.errors import InputError
from eha_bench.rig.transport import SocketCan
from eha_bench.targets.can.bus import Bus
from eha_bench.targets.can.drive import Frame
from eha_bench.targets.can.target_file import BusFile


def test_bench_and_rig_hear_each_other_and_lose_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    channel = uuid.uuid4().hex
    real = can.Bus

    def virtual(*, interface: str, channel: str) -> Any:
        assert interface == "socketcan"
        return real(interface="virtual", channel=channel)

    bench = Bus(BusFile(interface="virtual", channel=channel))
    monkeypatch.setattr(can, "Bus", virtual)
    rig = SocketCan(channel)
    sent = [Frame(0x100 + k, bytes([k % 256, 1]), k % 2 == 0) for k in range(250)]
    for frame in sent:
        bench.send(frame)
    heard: list[Frame] = []
    while more := rig.receive(0.0):
        heard += more
    assert heard == sent
    rig.send([Frame(0x201, b"\x07")])
    message = bench.receive(1.0)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (0x201, b"\x07")
    bench.close()
    rig.close()


def test_a_bus_that_is_not_there_is_a_sentence_with_the_way_out() -> None:
    with pytest.raises(InputError, match=r"cannot be joined.*ip link add"):
        SocketCan("nocan9")
