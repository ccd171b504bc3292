"""Recordings that exist already are ranked by how surely they would decide."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from experiment_question import rival, write_question

from eha_bench.core.errors import InputError
from eha_bench.experiment.pool import rank

DELAY = ("command_delay", {"delay": 2e-3})
LAG = ("current_lag", {"time_constant": 2e-3})
CHANNELS = """\
time: {column: t, unit: s}
channels:
  current_command: {column: i, unit: A}
  motor_speed:     {column: w, unit: rad/s}
"""


def write_log(path: Path, current: np.ndarray) -> None:
    time = np.arange(current.size) / 1e3
    noise = 0.1 * np.random.default_rng(1).standard_normal(current.size)
    table = np.column_stack([time, current, noise])
    np.savetxt(path, table, "%.6g", ",", header="t,i,w", comments="")


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pool")
    write_question(folder, [rival(*DELAY), rival(*LAG)], noise={"motor_speed": 0.1})
    time = np.arange(1500) / 1e3
    write_log(folder / "still.csv", np.zeros(1500))
    write_log(folder / "fast.csv", 12.0 * np.sign(np.sin(2.0 * np.pi * 12.0 * time)))
    (folder / "channels.yaml").write_text(CHANNELS)
    (folder / "dataset.yaml").write_text(
        "model: recalibrated.yaml\nchannels: channels.yaml\nruns:\n"
        "  - {log: still.csv, piston: locked}\n"
        "  - {log: fast.csv, piston: locked, use: holdout}\n"
    )
    return folder


def test_a_motion_that_excites_what_differs_comes_first(pool: Path):
    first, last = rank(pool, [pool / "dataset.yaml"])
    assert (first.name, last.name) == ("fast", "still")
    assert first.right > 0.9
    # 1.5 s are fifteen blocks, about as many as a cause needs
    assert first.reached > 0.9 > last.reached
    assert last.right == 0.0


def test_logs_are_read_through_a_channel_map(pool: Path):
    found = rank(pool, [pool / "still.csv", pool / "fast.csv"], channels=pool / "channels.yaml")
    assert {item.name for item in found} == {"fast", "still"}
    assert all(not item.why for item in found)


def test_a_log_that_cannot_be_read_costs_only_itself(pool: Path, tmp_path: Path):
    torn = tmp_path / "torn.csv"
    torn.write_text("t,i,w\n")
    found = rank(pool, [pool / "fast.csv", torn], channels=pool / "channels.yaml")
    assert [bool(item.why) for item in found] == [False, True]


def test_nothing_to_rank_is_refused(pool: Path):
    with pytest.raises(InputError, match="no recording"):
        rank(pool, [])


def test_after_an_unexplained_remainder_the_one_that_is_predicted_worst_comes_first(
    pool: Path, tmp_path: Path
):
    rivals = [rival(*DELAY), rival(*LAG)]
    unexplained = {"motor_speed": 0.5}
    write_question(tmp_path, rivals, noise={"motor_speed": 0.1}, unexplained=unexplained)
    first, last = rank(tmp_path, [pool / "still.csv", pool / "fast.csv"],
                       channels=pool / "channels.yaml")  # fmt: skip
    # the recorded speed is noise alone; only the fast current is predicted to move the shaft
    assert (first.name, last.name) == ("fast", "still")
    assert last.error == pytest.approx(0.1 / np.hypot(0.1, 0.5), rel=0.1)
    assert first.error > 10.0
    assert np.isnan(first.right)


def test_recordings_of_one_name_are_told_apart_by_their_folders(pool: Path, tmp_path: Path):
    text = (pool / "fast.csv").read_text()
    for folder in ("monday", "tuesday"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "part.csv").write_text(text)
    logs = [tmp_path / "monday/part.csv", tmp_path / "tuesday/part.csv", pool / "still.csv"]
    found = rank(pool, logs, channels=pool / "channels.yaml")
    assert {item.name for item in found} == {"monday/part.csv", "tuesday/part.csv", "still"}


def test_a_log_that_is_not_there_is_named(pool: Path):
    with pytest.raises(InputError, match=r"fsat.csv: no such recording"):
        rank(pool, [pool / "fast.csv", pool / "fsat.csv"], channels=pool / "channels.yaml")
