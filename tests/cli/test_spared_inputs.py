"""No command writes over what it reads: measurements cannot be made again."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.core.shipped import find

from .conftest import Cli

sys.path.insert(0, str(Path(__file__).parents[1] / "experiment"))

from experiment_question import rival, write_question

CHANNELS = """\
time: {column: t, unit: s}
channels:
  current_command: {column: i, unit: A}
  motor_speed: {column: n, unit: rad/s}
"""
PLANT = """\
plant: spindle
nodes: {shaft: {kind: rotation, inertia: 9e-4 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  drag: {kind: friction, on: shaft, coulomb: 0.1 N*m}
inputs: {current_command: motor.current}
channels: {motor_speed: shaft.speed}
"""
SUITE = """\
name: judge
trials:
  - id: log
    mode: current
    signal: {kind: recorded}
    duration: 0.2 s
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder that holds everything in the place where results would be written."""
    rows = "".join(f"{k / 1e3:.3f},{k % 7},{k * 0.1:.3f}\n" for k in range(200))
    for name in ("log.csv", "held.csv"):
        (tmp_path / name).write_text("t,i,n\n" + rows)
    (tmp_path / "channels.yaml").write_text(CHANNELS)
    (tmp_path / "plant.yaml").write_text(PLANT)
    (tmp_path / "suite.yaml").write_text(SUITE)
    return tmp_path


def _dataset(folder: Path, model: str, log: str) -> None:
    (folder / "dataset.yaml").write_text(
        f"model: {model}\nchannels: channels.yaml\ninputs: [current_command]\nruns:\n"
        f"  - {{log: {log}, use: train}}\n  - {{log: held.csv, use: holdout}}\n"
    )


def _content(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def _refused(cli: Cli, folder: Path, name: str, *words: str, way: str = "name another") -> None:
    before = _content(folder)
    done = cli(*words, check=2)
    assert f"{name}: is read here and would be overwritten; {way}" in done.stderr
    assert _content(folder) == before


def test_a_log_is_not_replaced_by_its_prediction(cli: Cli, folder: Path) -> None:
    log = eb.read(folder / "log.csv", channels=folder / "channels.yaml")
    eb.recordings.export(folder / "own.parquet", log)
    (folder / "own.yaml").write_text(
        "model: plant.yaml\ninputs: [current_command]\nruns:\n  - {log: own.parquet}\n"
    )
    _refused(cli, folder, "own.parquet", "predict", "own.yaml", "--out", ".")
    # also where the folder is named otherwise, and from Python
    (folder / "link").symlink_to(folder)
    _refused(cli, folder, "own.parquet", "predict", "own.yaml", "--out", "link")
    with pytest.raises(InputError, match=r"own\.parquet: is read here"):
        eb.predict("own.yaml", out=folder)


def test_a_model_is_not_replaced_by_a_better_one(cli: Cli, folder: Path) -> None:
    calibrated = "model: plant.yaml\ncalibrate: [drag.coulomb]\n"
    (folder / "calibrated.yaml").write_text(calibrated)
    _dataset(folder, "calibrated.yaml", "log.csv")
    _refused(cli, folder, "calibrated.yaml", "calibrate", "dataset.yaml", "--out", ".")
    # what a file that was read has named itself is an input as well
    shutil.move(folder / "plant.yaml", folder / "revised.yaml")
    (folder / "model.yaml").write_text("model: revised.yaml\n")
    _dataset(folder, "model.yaml", "log.csv")
    _refused(cli, folder, "revised.yaml", "diagnose", "dataset.yaml", "--out", ".")
    (folder / "rivals").mkdir()
    shutil.move(folder / "revised.yaml", folder / "rivals" / "mine.yaml")
    _dataset(folder, "rivals/mine.yaml", "log.csv")
    _refused(cli, folder, "mine.yaml", "diagnose", "dataset.yaml", "--out", ".")


def test_a_log_is_not_replaced_by_what_it_is_exported_to(cli: Cli, folder: Path) -> None:
    words = ("export", "log.csv", "log.csv", "--channels", "channels.yaml")
    _refused(cli, folder, "log.csv", *words, way="give another target")


@pytest.mark.parametrize("source", ["log.csv", "channels.yaml"])
def test_files_that_are_told_of_stay(cli: Cli, folder: Path, source: str) -> None:
    command = "channels" if source == "log.csv" else "layout"
    _refused(cli, folder, source, command, source, "--out", source)


def test_scores_do_not_replace_what_they_are_of(cli: Cli, folder: Path) -> None:
    shutil.copy(folder / "suite.yaml", folder / "summary.md")
    words = ("score", "log.csv", "--suite", "summary.md", "--channels", "channels.yaml")
    with pytest.raises(InputError, match=r"summary\.md: is read here"):
        eb.score_files(["log.csv"], folder / "summary.md", folder / "channels.yaml", folder)
    _refused(cli, folder, "summary.md", *words, "--out", ".")


@pytest.fixture
def results(ran: Path) -> Path:
    """A folder of a run whose result has the name of what `compare` writes."""
    shutil.copy(ran / "result.json", ran / "comparison.json")
    return ran


def test_a_result_is_not_replaced_by_its_comparison(cli: Cli, results: Path) -> None:
    words = ("compare", "ran/comparison.json", "ran", "--out", "ran")
    _refused(cli, results, "ran/comparison.json", *words)


def test_a_result_is_no_baseline_of_itself(cli: Cli, results: Path) -> None:
    words = ("baseline", "ran/result.json", "ran")
    _refused(cli, results, "ran/result.json", *words, way="name another baseline file")


def test_rounds_do_not_replace_their_dataset(cli: Cli, folder: Path) -> None:
    _dataset(folder, "plant.yaml", "log.csv")
    shutil.move(folder / "dataset.yaml", folder / "of.json")
    words = ("close", "of.json", "--target", "plant.yaml", "--out", ".")
    _refused(cli, folder, "of.json", *words)


def test_an_experiment_does_not_replace_the_diagnosis(cli: Cli, folder: Path) -> None:
    write_question(folder, [rival("current_lag", {"time_constant": 2e-3})])
    words = ("next", ".", "--out", "diagnosis.yaml")
    _refused(cli, folder, "diagnosis.json", *words)
    shutil.copy(folder / "plant.yaml", folder / "revised.yaml")
    words = ("next", ".", "--out", "revised.yaml")
    _refused(cli, folder, "revised.yaml", *words)


def test_the_log_of_a_rig_replaces_no_model(cli: Cli, folder: Path) -> None:
    shutil.copy(find("paper", "models"), folder / "model.yaml")
    words = ("rig", "--model", "model.yaml", "--log", "model.yaml")
    _refused(cli, folder, "model.yaml", *words)


def test_a_page_replaces_no_figures(cli: Cli, folder: Path) -> None:
    (folder / "tuning").mkdir()
    (folder / "tuning/tuned.yaml").write_text("extends: paper\n")
    (folder / "tuning/tuning.json").write_text("{}")
    shutil.copy(folder / "plant.yaml", folder / "tuning/model.yaml")
    (folder / "found").mkdir()
    (folder / "found/diagnosis.json").write_text('{"model": "revised.yaml"}')
    shutil.copy(folder / "plant.yaml", folder / "found/revised.yaml")
    words = ("before-after", "tuning", "found", "--out", "found/diagnosis.json")
    _refused(cli, folder, "found/diagnosis.json", *words, way="name another page")


def test_a_sweep_that_goes_on_does_not_replace_its_suite(cli: Cli, folder: Path) -> None:
    (folder / "swept").mkdir()
    (folder / "swept/points.jsonl").write_text("{}\n")
    shutil.move(folder / "suite.yaml", folder / "swept/sweep.json")
    (folder / "over.yaml").write_text("over: {parameters: {bulk_modulus: [600 MPa, 900 MPa]}}\n")
    words = ("sweep", "swept/sweep.json", "--over", "over.yaml", "--out", "swept", "--resume")
    _refused(cli, folder, "swept/sweep.json", *words)


def test_a_history_does_not_replace_what_says_its_causes(cli: Cli, results: Path) -> None:
    (results / "history.json").write_text("diagnose: {model: physical}\n")
    before = _content(results)
    with pytest.raises(InputError, match=r"history\.json: is read here"):
        eb.history(results, results, diagnose=results / "history.json")
    assert _content(results) == before
