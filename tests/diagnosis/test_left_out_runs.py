"""A run of which nothing is explained is taken up again where nothing else is missing."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

import eha_bench
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.baseline import Baseline, calibrated_baseline
from eha_bench.diagnosis.search.left_out_runs import explains_all_runs, search_in_all_runs
from eha_bench.diagnosis.search.state import Search, begin

DECLARED = "effects:\n  - {effect: coulomb_friction, friction_force: 20 N}\n"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    """Two runs of a drive of which nothing is missing, and one with a sensor upside down."""
    folder = tmp_path_factory.mktemp("drive")
    path = write_drive(folder, seconds=0.8)
    with (folder / "model.yaml").open("a") as file:
        file.write(DECLARED)
    table = np.loadtxt(folder / "train.csv", delimiter=",", skiprows=1)
    table[:, 2] *= -1.0
    np.savetxt(folder / "turned.csv", table, "%.9g", ",", header="t,r,x,u", comments="")
    head = "model: model.yaml\nchannels: channels.yaml\ninputs: [reference]\nruns:\n"
    logs = ("train", "held", "turned")
    path.write_text(head + "".join(f"  - {{log: {log}.csv, use: train}}\n" for log in logs))
    return path


@pytest.fixture(scope="module")
def searches(dataset: Path) -> tuple[Baseline, Search, Baseline, Search]:
    """A calibration without the run and its search, and the same with it."""
    base = calibrated_baseline(load_dataset(dataset))
    search = begin(base)
    return base, search, *search_in_all_runs(base, search, lambda *_: None)


def test_the_search_in_all_runs_begins_with_what_the_others_gave(searches) -> None:
    base, search, whole, wider = searches
    assert base.left_out == ("turned",)
    assert whole.left_out == ()
    names = {window.measured.run.name for window in wider.problem.windows}
    assert names == {"train", "held", "turned"}
    for key, place in search.problem.places.index.items():
        at = wider.problem.places.index[key]
        assert wider.fit.vector[at] == search.fit.vector[place]
        assert wider.declared_vector[at] == search.fit.vector[place]
    assert wider.excess_base.relative > 10.0 * max(search.excess_base.relative, 0.1)


def test_a_run_that_stays_unexplained_stays_out(searches) -> None:
    base, _, _, wider = searches
    assert not explains_all_runs(wider, base)


def test_what_explains_every_run_is_believed(searches) -> None:
    base, _, _, wider = searches
    white = np.random.default_rng(3).standard_normal(wider.fit.residual.size)
    good = replace(wider, fit=replace(wider.fit, residual=white))
    assert explains_all_runs(good, base)
    # but not at the cost of those of which nothing was missing
    for piece in wider.problem.pieces:
        if wider.problem.windows[piece.window].measured.run.name == "train":
            white[piece.rows] *= 2.0
    assert not explains_all_runs(good, base)


def test_a_log_of_another_machine_changes_no_verdict(dataset: Path, tmp_path: Path) -> None:
    eha_bench.diagnose(dataset, out=tmp_path)
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["verdict"] == "none"
    assert any(note.startswith("turned is left out") for note in found["notes"])
