"""Training runs that are fitted up to a jump of their delay."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

from eha_bench.diagnosis.calibrate import calibrate
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.ended_runs import baseline_up_to_jumps

LATER, SINCE = 0.05, 7.0


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive whose readings come 50 ms later from 7 s on, in the run that is fitted."""
    folder = tmp_path_factory.mktemp("late")
    path = write_drive(folder, friction=0.0, seconds=10.0)
    log = folder / "train.csv"
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    delayed = table.copy()
    for column in (2, 3):
        delayed[:, column] = np.interp(table[:, 0] - LATER, table[:, 0], table[:, column])
    table[table[:, 0] >= SINCE] = delayed[table[:, 0] >= SINCE]
    np.savetxt(log, table, "%.9g", ",", header="t,r,x,u", comments="")
    return path


def test_the_run_is_fitted_up_to_there(late: Path) -> None:
    base = baseline_up_to_jumps(load_dataset(late))
    (note,) = (item for item in base.notes if "later than before" in item)
    assert "train: from 7" in note
    assert "it is fitted up to there" in note
    (measured,) = base.measured
    assert measured.valid[measured.time < SINCE - 0.5].all()
    assert not measured.valid[measured.time > SINCE + 0.5].any()
    assert base.dataset.training[0].until == pytest.approx(SINCE, abs=0.3)


def test_parameters_are_those_of_the_machine(late: Path) -> None:
    """The mass of 93 kg and the friction of 200 N*s/m that the log was made with."""
    found = calibrate(late)
    assert found.parameters["mass"].value == pytest.approx(93.0, rel=0.02)
    assert found.parameters["viscous_friction"].value == pytest.approx(200.0, rel=0.05)
    error = found.holdout["piston_position"]
    assert error.after < 1.5 * error.noise_floor


def test_a_run_that_fits_is_not_looked_at(tmp_path: Path) -> None:
    base = baseline_up_to_jumps(load_dataset(write_drive(tmp_path, friction=0.0)))
    assert base.dataset.training[0].until == float("inf")


BENT = ("hold_under_gravity", "friction_gravity", "backlash_detection", "trapezoidal_profile")


@pytest.mark.slow
@pytest.mark.parametrize("joint", ["rotation", "wrist_pitch"])
def test_a_jump_that_bends_the_calibration_is_found(
    joint: str, shared_data: Path, tmp_path: Path
) -> None:
    """A real arm of which four of five fitted motions are slow: the model as declared shows it."""
    example = Path(__file__).parents[2] / "examples" / "so101" / joint
    for name in ("plant.yaml", "channels.yaml"):
        (tmp_path / name).write_text((example / name).read_text())
    logs = [shared_data / "so101" / f"{name}.csv" for name in (*BENT, "chirp_sweep")]
    rows = "".join(f"  - {{log: {log}, use: train}}\n" for log in logs)
    (tmp_path / "dataset.yaml").write_text(
        f"model: plant.yaml\nchannels: channels.yaml\ninputs: [command]\nruns:\n{rows}"
    )
    base = baseline_up_to_jumps(load_dataset(tmp_path / "dataset.yaml"))
    (note,) = (item for item in base.notes if "later than before" in item)
    assert note.startswith("chirp_sweep: from 112")
    assert base.dataset.training[-1].until == pytest.approx(112.5, abs=0.5)
