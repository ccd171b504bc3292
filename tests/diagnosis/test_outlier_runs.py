"""A run that is another machine's is left out, and only where others of its setup are explained."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import COARSE, gather
from eha_bench.diagnosis.fit.outlier_runs import outlier_runs
from eha_bench.diagnosis.fit.problem import Problem


def _outliers(folder: Path, logs: list[str], others: Sequence[float] = ()) -> dict[str, str]:
    path = folder / "dataset.yaml"
    head = "model: model.yaml\nchannels: channels.yaml\ninputs: [reference]\nruns:\n"
    path.write_text(head + "".join(f"  - {{log: {log}.csv, use: train}}\n" for log in logs))
    dataset = load_dataset(path)
    _, windows, noise, _ = gather(dataset)
    problem = Problem(dataset.model.plant, windows, noise, COARSE)
    vector = dataset.model.vector()
    problem.prepare(vector)
    residual = problem.residual(vector)
    return outlier_runs(problem, [residual, *(share * residual for share in others)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two runs of a drive whose friction is not declared, and one with a sensor upside down."""
    folder = tmp_path_factory.mktemp("drive")
    write_drive(folder, seconds=0.8)
    table = np.loadtxt(folder / "train.csv", delimiter=",", skiprows=1)
    table[:, 2] *= -1.0
    np.savetxt(folder / "odd.csv", table, "%.9g", ",", header="t,r,x,u", comments="")
    return folder


def test_a_run_with_a_sensor_upside_down_is_outliers(folder: Path) -> None:
    assert _outliers(folder, ["train", "held", "odd"]) == {"odd": "piston_position"}


def test_what_is_missing_in_the_model_makes_no_run_outliers(folder: Path) -> None:
    assert _outliers(folder, ["train", "held"]) == {}


def test_of_two_runs_nobody_knows_which_is_outliers(folder: Path) -> None:
    assert _outliers(folder, ["train", "odd"]) == {}


def test_a_run_that_one_of_two_models_explains_is_not_outliers(folder: Path) -> None:
    assert _outliers(folder, ["train", "held", "odd"], others=[0.0]) == {}
