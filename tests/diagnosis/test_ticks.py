"""Topics on common ticks: rates, losses, late and jittered stamps, and what is made of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.ticks import nearest, on_ticks
from eha_bench.recordings.series import gap_note, nan_note

PERIOD = 1e-3
COUNT = 4000
FAST = 2 * np.pi * 20.0


def _speed(time: np.ndarray) -> np.ndarray:
    return 100.0 * np.sin(FAST * time)


class _Log:
    """A drive and a pressure sensor in topics of their own."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.clock = np.arange(COUNT) * PERIOD
        self.parts: list[Recording] = []

    def add(
        self, name: str, *, every: int = 1, lost: float = 0.0, jitter: float = 0.0,
        late: float = 0.0, true: bool = False,
    ) -> np.ndarray:  # fmt: skip
        """Add a topic; return which ticks its messages are of."""
        ticks = np.arange(0, COUNT, every)
        kept = self.rng.random(ticks.size) >= lost
        kept[[0, -1]] = True
        ticks = ticks[kept]
        stamps = self.clock[ticks] + late + jitter * self.rng.random(ticks.size)
        values = _speed(stamps if true else self.clock[ticks])
        values += 0.01 * self.rng.standard_normal(ticks.size)
        self.parts.append(Recording(stamps, {name: values}))
        return ticks


def test_a_single_recording_stays_as_it_is() -> None:
    alone = Recording(np.arange(9.0), {"motor_speed": np.arange(9.0)}, {"motor_speed": "rad/s"})
    found = on_ticks([alone], ["current_command"], ["motor_speed"])
    assert found.recording is alone
    assert not found.is_of_several
    assert not found.taken


def _interleaved(lost: float, *, slow: int = 2) -> Recording:
    """A table with rows of a drive, its pressure in one of `slow`, and of an encoder behind."""
    clock = np.arange(COUNT) * PERIOD
    rows = np.sort(np.append(clock, clock + 0.4e-3))
    values = {name: _speed(rows) for name in ("current_command", "pressure_a", "motor_angle")}
    values["current_command"][1::2] = np.nan
    values["pressure_a"][np.arange(rows.size) % slow > 0] = np.nan
    values["motor_angle"][::2] = np.nan
    kept = np.random.default_rng(0).random(rows.size) >= lost
    kept[[0, 1, -2, -1]] = True
    return Recording(rows[kept], {name: own[kept] for name, own in values.items()})


def test_cells_that_are_empty_in_rows_of_another_clock_are_no_lost_messages() -> None:
    names = ["current_command", "pressure_a", "motor_angle"]
    found = on_ticks([_interleaved(0.0)], names[:1], names[1:])
    assert found.is_of_several
    assert not found.lost["current_command"].any()
    assert np.isfinite(found.recording["current_command"]).all()
    assert np.isfinite(found.recording["motor_angle"]).sum() == COUNT
    # a sensor at half the rate has rows of the drive
    slow = on_ticks([_interleaved(0.0, slow=4)], names[:1], names[1:])
    assert slow.late.keys() == {"motor_angle"}
    # one per cent of the rows lost: as many messages
    some = on_ticks([_interleaved(0.01)], names[:1], names[1:])
    assert some.lost["current_command"].sum() == pytest.approx(0.01 * COUNT, rel=0.4)


def test_counts_of_a_tables_rows_say_nothing_of_its_clocks() -> None:
    names = ["current_command", "pressure_a", "motor_angle"]
    table = _interleaved(0.01)
    stamps = np.round(1e9 * table.time).astype(np.int64)
    empty = nan_note("motor_angle", table["motor_angle"], table.time)
    counts = [
        *gap_note("time", stamps, 0),
        *empty,
        *nan_note(names[0], table[names[0]], table.time),
    ]
    assert len(counts) == 3
    found = on_ticks([replace(table, notes=("of the file", *counts))], names[:1], names[1:])
    assert "of the file" in found.recording.notes
    assert not {*counts} & {*found.recording.notes}
    # of one clock they are true
    whole = Recording(table.time, dict.fromkeys(names, table.time), notes=tuple(counts))
    assert on_ticks([whole], names[:1], names[1:]).recording.notes[:3] == tuple(counts)


def test_a_command_in_some_of_a_tables_rows_acts_until_its_next() -> None:
    time = np.arange(COUNT) * PERIOD
    values = {name: _speed(time) for name in ("current_command", "motor_speed")}
    values["current_command"][np.arange(COUNT) % 4 > 0] = np.nan
    found = on_ticks([Recording(time, values)], ["current_command"], ["motor_speed"])
    assert not found.lost["current_command"].any()
    assert np.isfinite(found.recording["motor_speed"]).all()
    assert np.isfinite(found.recording["current_command"]).sum() == COUNT // 4


@pytest.mark.parametrize("late", [0.4e-3, 2e-3, 3e-3])
def test_what_is_always_off_the_commands_by_the_same_may_be_stamped_so(late: float) -> None:
    """Also where it is off by so much that it has ticks of its own."""
    clock = np.arange(COUNT) * 4e-3 + 1e-3 * np.random.default_rng(0).random(COUNT)
    asked = Recording(clock, {"current_command": np.zeros(COUNT)})
    found = on_ticks([asked, Recording(clock + late, {"motor_angle": _speed(clock)})],
                     ["current_command"], ["motor_angle"])  # fmt: skip
    assert found.late == {"motor_angle": "motor_angle"}
    good = np.isfinite(found.recording["motor_angle"])
    taken = found.recording.time[good] + found.taken["motor_angle"][good]
    assert taken == pytest.approx(clock[: taken.size] + late, abs=1e-9)
    assert found.recording.time.size == taken.size, "none has a tick of its own"


def test_an_input_that_fails_for_a_while_stays_in_its_table() -> None:
    time = np.arange(COUNT) * PERIOD
    values = {name: _speed(time) for name in ("current_command", "motor_speed")}
    values["current_command"][1000:2000] = np.nan
    alone = Recording(time, values)
    assert on_ticks([alone], ["current_command"], ["motor_speed"]).recording is alone


def test_a_plain_log_comes_back_onto_its_ticks() -> None:
    log = _Log()
    asked = log.add("current_command", lost=0.01, jitter=60e-6)
    state = log.add("motor_speed", every=2, lost=0.01, jitter=60e-6)
    pressure = log.add("pressure_a", lost=0.01, jitter=60e-6, late=0.25e-3)
    found = on_ticks(log.parts, ["current_command"], ["motor_speed", "pressure_a"])
    time = found.recording.time
    # up to the last message of the drive, whose other ones are between
    assert time.size == state[-1] + 1
    assert np.abs(np.diff(time) - PERIOD).max() < 1e-6
    assert {*found.taken} == {*found.late} == {"pressure_a"}
    assert found.taken["pressure_a"][pressure[:-1]] == pytest.approx(0.25e-3, abs=3e-6)
    for name, ticks in {"current_command": asked, "motor_speed": state}.items():
        there = np.flatnonzero(np.isfinite(found.recording[name]))
        assert there.tolist() == ticks[ticks < time.size].tolist()
    lost = np.setdiff1d(np.arange(time.size), asked)
    assert np.flatnonzero(found.lost["current_command"]).tolist() == lost.tolist()
    said = " ".join(found.recording.notes)
    assert f"current_command: every 1 ms, {COUNT - asked.size} of {COUNT} messages lost" in said
    assert "motor_speed: every 2 ms" in said
    assert "off a regular clock, which is used" in said


def test_stamps_that_the_readings_follow_are_kept_sample_by_sample() -> None:
    log = _Log()
    log.add("current_command")
    log.add("motor_speed", jitter=200e-6, true=True)
    found = on_ticks(log.parts, ["current_command"], ["motor_speed"])
    good = np.isfinite(found.recording["motor_speed"])
    taken = found.recording.time[good] + found.taken["motor_speed"][good]
    assert found.recording["motor_speed"][good] == pytest.approx(_speed(taken), abs=0.06)
    assert np.ptp(found.taken["motor_speed"][good]) > 150e-6
    assert "the readings follow the stamps" in " ".join(found.recording.notes)


@pytest.mark.parametrize("rate", [437.0, 1000.7, 93.0])
def test_topics_that_tick_by_themselves_keep_every_sample_at_its_instant(rate: float) -> None:
    own = 1.3e-4 + np.arange(int(3.9 * rate)) / rate
    asked = Recording(np.arange(COUNT) * PERIOD, {"current_command": np.zeros(COUNT)})
    read = Recording(own, {"pressure_a": np.arange(float(own.size))})
    found = on_ticks([asked, read], ["current_command"], ["pressure_a"])
    good = np.isfinite(found.recording["pressure_a"])
    taken = found.recording.time[good] + found.taken["pressure_a"][good]
    number = found.recording["pressure_a"][good].astype(int)
    assert number.tolist() == list(range(own.size))
    assert taken == pytest.approx(own[number], abs=1e-9)
    assert np.abs(found.taken["pressure_a"]).max() <= 0.5e-3 + 1e-9


def test_slow_commands_act_from_their_own_stamps() -> None:
    asked = Recording(0.0003 + np.arange(100) * 0.02, {"current_command": np.arange(100.0)})
    read = Recording(np.arange(2000) * PERIOD, {"motor_speed": np.zeros(2000)})
    found = on_ticks([asked, read], ["current_command"], ["motor_speed"])
    command = found.recording["current_command"]
    at = np.flatnonzero(np.isfinite(command))
    assert found.recording.time[at] == pytest.approx(asked.time, abs=1e-9)
    assert not found.lost["current_command"].any()


def test_commands_that_come_when_they_change_are_not_lost_between() -> None:
    time = np.sort(np.random.default_rng(1).random(60)) * 3.0
    asked = Recording(time, {"current_command": np.arange(60.0)})
    read = Recording(np.arange(3500) * PERIOD, {"motor_speed": np.zeros(3500)})
    found = on_ticks([asked, read], ["current_command"], ["motor_speed"])
    assert not found.lost["current_command"].any()


def test_slow_readings_that_share_a_commands_tick_keep_their_instants() -> None:
    """Polled every 11 ms or so, with a command 0.3 ms behind each reading, or 1.3 ms."""
    rng = np.random.default_rng(0)
    read = np.cumsum(rng.integers(9, 15, 400) * 1e-3)
    asked = read + np.where(np.arange(400) % 2, 0.3e-3, 1.3e-3)
    topics = [Recording(asked, {"goal": _speed(asked)}), Recording(read, {"angle": _speed(read)})]
    found = on_ticks(topics, ["goal"], ["angle"])
    there = np.isfinite(found.recording["angle"])
    instants = (found.recording.time + found.taken["angle"])[there]
    assert np.allclose(_speed(instants), found.recording["angle"][there])
    assert found.late == {"angle": "angle"}


def test_the_nearest_tick() -> None:
    ticks = np.array([0.0, 1.0, 2.0])
    found = nearest(ticks, np.array([-5.0, 0.4, 0.6, 1.49, 1.51, 9.0]))
    assert found.tolist() == [0, 0, 1, 1, 2, 2]


def _table(rows: np.ndarray, period: float = 2e-3) -> Recording:
    time = period * np.arange(rows.size)
    values = {"current_command": np.sin(9.0 * time), "motor_speed": _speed(time)}
    return Recording(time[rows], {name: column[rows] for name, column in values.items()})


def test_rows_that_a_table_has_lost_are_ticks_without_readings() -> None:
    rows = np.random.default_rng(1).random(1000) > 0.02
    rows[[0, -1]] = True
    found = on_ticks([_table(rows)], ["current_command"], ["motor_speed"])
    assert found.recording.time == pytest.approx(2e-3 * np.arange(1000), abs=1e-12)
    assert (found.logged == rows).all()
    for column in found.recording.values.values():
        assert (np.isfinite(column) == rows).all()
    assert not found.is_of_several


def test_rows_are_lost_also_where_stamps_scatter_by_a_quarter_of_a_period() -> None:
    """Stamps 1 ms off a clock of 4 ms: single steps do not tell how many rows were lost."""
    rng = np.random.default_rng(3)
    rows = rng.random(2000) > 0.01
    rows[[0, -1]] = True
    table = _table(rows, 4e-3)
    stamps = table.time + rng.uniform(-1e-3, 1e-3, table.time.size)
    found = on_ticks([replace(table, time=stamps)], ["current_command"], ["motor_speed"])
    assert found.logged is not None
    assert (found.logged == rows).all()
    assert found.recording.time[rows] == pytest.approx(stamps, abs=1e-12)


def test_a_table_that_is_paused_or_irregular_stays_as_it_is() -> None:
    paused = np.ones(1000, dtype=bool)
    paused[400:500] = False
    on_change = np.random.default_rng(1).random(1000) > 0.7
    for rows in (paused, on_change):
        alone = _table(rows)
        assert on_ticks([alone], ["current_command"], ["motor_speed"]).recording is alone
