"""The played drive, in simulated time: nothing here waits for a clock."""

from collections.abc import Callable

import numpy as np
import pytest

from eha_bench.control.controller import Context
from eha_bench.control.controller_file import load_controllers
from eha_bench.core.linkage import Linkage
from eha_bench.core.recording import Recording
from eha_bench.core.shipped import shipped_file
from eha_bench.core.trial import ControlMode
from eha_bench.metrics import score
from eha_bench.suites import load_suite
from eha_bench.targets.can.drive import Frame
from eha_bench.targets.simulator import default_simulator

from .conftest import Bench

MakeBench = Callable[..., Bench]
CURRENT = ControlMode.CURRENT


def test_without_commands_the_torque_is_off_within_the_watchdog(bench: MakeBench) -> None:
    rig = bench()
    rig.enable()
    for tick in range(50):
        rig.tick(tick, CURRENT, 10.0, 1)
    assert rig.state == "enabled"
    assert rig.readings["current"] == pytest.approx(10.0, abs=0.3)
    rig.pass_time(rig.now + 0.1)
    off = [event for event in rig.events if event["event"] == "torque off"][-1]
    assert 0.0 < off["t"] - off["last_command"] <= 20e-3
    rig.send(rig.drive.sync_frame(0))
    assert rig.state == "fault"
    assert abs(rig.readings["current"]) < 0.3


def test_a_fault_stays_until_the_word_that_resets_it(bench: MakeBench) -> None:
    rig = bench()
    rig.enable()
    rig.pass_time(rig.now + 0.1)
    for word in (1, 0, 1):
        rig.tick(0, CURRENT, 5.0, word)
        rig.send(rig.drive.sync_frame(0))
        assert rig.state == "fault"
    rig.tick(0, CURRENT, 0.0, 2)
    rig.send(rig.drive.sync_frame(0))
    assert rig.state == "off"
    rig.enable()
    assert rig.state == "enabled"


def test_a_late_command_is_not_taken_for_a_timely_one(bench: MakeBench) -> None:
    """A command that comes after the watchdog has run out does not bring the torque back."""
    rig = bench()
    rig.enable()
    rig.now += 0.030
    rig.played.pass_time(rig.now)
    rig.tick(0, CURRENT, 10.0, 1)
    assert [event for event in rig.events if event["event"] == "torque off"]
    rig.send(rig.drive.sync_frame(0))
    assert rig.state == "fault"


@pytest.mark.parametrize(
    ("fault", "reason"),
    [("over-pressure@0.02", "over-pressure"), ("emergency-stop@0.02", "emergency stop")],
)
def test_the_drive_keeps_its_own_limits(bench: MakeBench, fault: str, reason: str) -> None:
    rig = bench(fault)
    rig.enable()
    for tick in range(60):
        rig.tick(tick, CURRENT, 1.0, 1)
    injected = next(event for event in rig.events if event["event"] == "injected")
    off = next(event for event in rig.events if event["event"] == "torque off")
    assert off["reason"] == reason
    assert off["t"] - injected["t"] <= 20e-3


def test_nonsense_on_the_bus_takes_the_torque_off(bench: MakeBench) -> None:
    rig = bench()
    rig.enable()
    rig.send(Frame(0x201, bytes([1, 99, 0, 0, 0, 0, 0, 0])))
    rig.send(rig.drive.sync_frame(0))
    assert rig.state == "fault"
    for length in range(9):
        rig.send(Frame(0x201, bytes(length)))
        rig.send(Frame(0x080, bytes(1)))
        rig.send(Frame(0x123, bytes(length)))


def test_bus_off_hears_nothing_and_says_nothing(bench: MakeBench) -> None:
    rig = bench("bus-off@0.02")
    rig.enable()
    for tick in range(60):
        rig.tick(tick, CURRENT, 1.0, 1)
    off = next(event for event in rig.events if event["event"] == "torque off")
    assert off["t"] - off["last_command"] <= 20e-3


def test_the_fixture_moves_the_rod_only_without_torque(bench: MakeBench) -> None:
    rig = bench()
    rig.send(rig.drive.fixture_frame(7, True, False, 0.012))
    rig.send(rig.drive.sync_frame(0))
    assert rig.readings["piston_position"] == pytest.approx(0.012, abs=50e-6)
    rig.enable()
    rig.send(rig.drive.fixture_frame(8, True, False, -0.02))
    rig.pass_time(rig.now + 2e-3)
    rig.send(rig.drive.sync_frame(1))
    assert rig.readings["piston_position"] == pytest.approx(0.012, abs=50e-6)


def test_cia402_has_to_be_taken_through_its_states_in_order(bench: MakeBench) -> None:
    rig = bench(target="cia402_drive.yaml")
    rig.tick(0, CURRENT, 0.0, 0x0F)
    rig.send(rig.drive.sync_frame(0))
    assert rig.state == "off"
    for word, state in ((0x06, "ready"), (0x07, "switched_on"), (0x0F, "enabled"), (0x06, "ready")):
        rig.tick(0, CURRENT, 0.0, word)
        rig.send(rig.drive.sync_frame(0))
        assert rig.state == state


def test_hours_pass_without_the_plant_forgetting_its_delay(bench: MakeBench) -> None:
    """The window of moments that is kept moves on, and nothing is seen of it."""
    rig = bench(watchdog=1.0)
    rig.enable()
    for tick in range(4500):
        rig.tick(tick, CURRENT, 4.0, 1)
    assert rig.state == "enabled"
    assert rig.readings["current"] == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize("mode", ["host", "set-point"])
def test_scores_over_the_frames_agree_with_the_simulators(bench: MakeBench, mode: str) -> None:
    """The same trial through DBC, drive and real-time plant: response time and holding current."""
    trial = load_suite(shipped_file("paper.yaml")).trials[0]
    rig = bench()
    rig.send(rig.drive.fixture_frame(1, True, False, 0.0))
    controllers = load_controllers(shipped_file("controllers/paper.yaml"))
    linkage = Linkage(0.3208, 0.0462, 0.280, 0.04)
    controller = controllers.make(trial.mode, Context(1e-3, 42.0, linkage))
    host = mode == "host"
    commanded = CURRENT if host else trial.mode
    rig.enable(commanded)
    clock = trial.clock()
    reference = trial.reference(clock)
    columns: dict[str, list[float]] = {name: [] for name in rig.drive.channels}
    for tick, wanted in enumerate(reference.tolist()):
        rig.send(rig.drive.sync_frame(tick))
        for name, values in columns.items():
            values.append(rig.readings[name])
        value = controller.step(wanted, rig.readings) if host else wanted
        rig.send(rig.drive.command_frame(commanded, value, 1))
        rig.pass_time(rig.now + 1e-3)
    values = {name: np.array(column) for name, column in columns.items()}
    recording = Recording(clock, {"reference": reference, **values}, {"reference": "Pa"})
    found = {item.metric: item for item in score(recording, trial)}
    wanted_scores = score(default_simulator().run(trial, 0).recording, trial)
    for item in wanted_scores:
        if item.limit:
            assert found[item.metric].value == pytest.approx(item.value, rel=0.025), item.metric
            assert found[item.metric].status == item.status
