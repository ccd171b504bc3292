"""A plant in plain Python, of somebody else's package, from a suite to a diagnosis."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "targets"))
from strangers_plant import installed

FILES = {
    "truth.yaml": "model: flap\n",
    "model.yaml": "model: flap\nparameters: {lag: 6 ms}\ncalibrate: [lag, opening]\n",
    "controller.yaml": "flap_angle: {controller: pid, k_p: 60 V/rad, output_limit: 5 V}\n",
    "target.yaml": "target: simulator\nmodel: truth.yaml\ncontroller: controller.yaml\n"
    "sensors: {spool_position: {noise: 2 um}, flap_angle: {noise: 0.02 deg}}\n",
    "suite.yaml": """\
name: flap
target: target.yaml
defaults: {duration: 0.3 s, sample_rate: 500 Hz}
trials:
  - id: turn
    mode: flap_angle
    signal: {kind: step, final: 15 deg, at: 10 ms}
    accept: {response_time: <= 0.5 s}
  - id: push
    mode: valve_command
    signal: {kind: sine, amplitude: 2 V, frequency: 8 Hz, cycles: 2}
  - id: hold
    mode: flap_angle
    signal: {kind: sine, amplitude: 5 deg, frequency: 4 Hz, cycles: 1}
""",
    "dataset.yaml": """\
model: model.yaml
inputs: [valve_command]
runs:
  - {log: run/recordings/turn-0.mcap, use: train}
  - {log: run/recordings/push-0.mcap, use: train}
  - {log: run/recordings/hold-0.mcap, use: holdout}
""",
}


@pytest.fixture
def flap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    with installed(tmp_path / "site", monkeypatch):
        yield tmp_path
    for name in [name for name in sys.modules if name.startswith("flap_bench")]:
        del sys.modules[name]


def test_it_is_run_predicted_calibrated_and_diagnosed(cli, flap: Path) -> None:
    cli("run", "suite.yaml", "--out", "run", check=0)
    cli("validate", *FILES, check=0)
    assert "flap_angle" in (flap / "run" / "report.html").read_text()
    done = cli("predict", "dataset.yaml", "--model", "truth.yaml", "--out", "predicted", check=0)
    found = json.loads((flap / "predicted" / "prediction.json").read_text())
    row = next(line for line in done.stderr.splitlines() if "error of" in line)
    assert row.split()[:3] == ["error", "of", found["runs"][0]["run"]]
    assert row.split()[-1] in {"µrad", "mrad", "rad", "deg", "m", "mm", "µm"}
    assert found["runs"][0]["error"]["flap_angle"]["unit"] == "rad"
    done = cli("calibrate", "dataset.yaml", "--out", "calibrated", "--json", check=0)
    table = next(line for line in done.stderr.splitlines() if "error, held-out runs" in line)
    assert table.split("runs")[1].split() == ["declared", "calibrated", "noise", "floor"]
    lag = json.loads(done.stdout)["parameters"]["lag"]
    assert lag["low"] < 5e-3 < lag["high"]
    cli("diagnose", "dataset.yaml", "--out", "diagnosed", check=0)
    diagnosis = json.loads((flap / "diagnosed" / "diagnosis.json").read_text())
    assert diagnosis["verdict"] == "none"
    units = {name: error["unit"] for name, error in diagnosis["error"]["holdout"].items()}
    assert units == {"flap_angle": "rad", "spool_position": "m"}


LATE = "effects:\n  - {effect: command_delay, delay: 12 ms}\n"
SLOW = "effects:\n  - {effect: sensor_lag, at: flap_angle, time_constant: 20 ms}\n"
VALUES = ", ".join(f"{0.05 * (k / 11.5 - 1) ** 2:.5f}" for k in range(24))
BENT = f"""\
effects:
  - {{effect: learned, at: flap_angle.sensor, form: additive, variable: flap_angle, scale: 1,
     low: -0.3, high: 0.3, values: [{VALUES}]}}
"""


@pytest.mark.slow  # a diagnosis each
@pytest.mark.parametrize(
    ("hidden", "effects", "unknown"),
    [
        (LATE, ["command_delay"], None),
        (SLOW, ["sensor_lag"], None),
        (BENT, [], ("measurement", ["flap_angle"])),
    ],
    ids=["late", "slow", "bent"],
)
def test_what_acts_on_its_signals_is_found(cli, flap: Path, hidden, effects, unknown) -> None:
    (flap / "truth.yaml").write_text(FILES["truth.yaml"] + hidden)
    cli("run", "suite.yaml", "--out", "run")
    cli("diagnose", "dataset.yaml", "--out", "out", check=0)
    found = json.loads((flap / "out" / "diagnosis.json").read_text())
    assert [item["id"] for item in found["effects"]] == effects
    if unknown:
        assert found["verdict"] == "unknown"
        assert (found["unknown"]["equation"], found["unknown"]["variables"]) == unknown
    # what is written is taken again
    cli("predict", "dataset.yaml", "--model", "out/revised.yaml", "--out", "again", check=0)
    before, after = (found["error"]["holdout"]["flap_angle"][key] for key in ("before", "after"))
    assert after < 0.5 * before
