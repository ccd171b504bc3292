"""A plant in plain Python, of somebody else's package, from a suite to a diagnosis."""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from eha_bench.core import plugins
from eha_bench.plants.plant import get_plant

sys.path.insert(0, str(Path(__file__).parents[1] / "targets"))
from strangers_plant import write_package

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
    write_package(tmp_path / "site")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    caches = (plugins._entry_points, plugins._group, get_plant)
    for cache in caches:
        cache.cache_clear()
    importlib.invalidate_caches()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    yield tmp_path
    for cache in caches:
        cache.cache_clear()
    for name in [name for name in sys.modules if name.startswith("flap_bench")]:
        del sys.modules[name]


def test_it_is_run_predicted_calibrated_and_diagnosed(cli, flap: Path) -> None:
    cli("run", "suite.yaml", "--out", "run", check=0)
    cli("validate", *FILES, check=0)
    assert "flap_angle" in (flap / "run" / "report.html").read_text()
    cli("predict", "dataset.yaml", "--model", "truth.yaml", "--out", "predicted", check=0)
    found = json.loads((flap / "predicted" / "prediction.json").read_text())
    assert found["runs"][0]["error"]["flap_angle"]["unit"] == "rad"
    done = cli("calibrate", "dataset.yaml", "--out", "calibrated", "--json", check=0)
    lag = json.loads(done.stdout)["parameters"]["lag"]
    assert lag["low"] < 5e-3 < lag["high"]
    cli("diagnose", "dataset.yaml", "--out", "diagnosed", check=0)
    diagnosis = json.loads((flap / "diagnosed" / "diagnosis.json").read_text())
    assert diagnosis["verdict"] == "none"
    units = {name: error["unit"] for name, error in diagnosis["error"]["holdout"].items()}
    assert units == {"flap_angle": "rad", "spool_position": "m"}
