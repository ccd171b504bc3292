"""Our plant as an FMU: run by our own FMU target, it is the simulator."""

from pathlib import Path

import numpy as np
import pytest

import eha_bench
from eha_bench.core.errors import InputError
from eha_bench.core.shipped import shipped_file
from eha_bench.targets.fmu.export import export_fmu
from locked import locked

locked("fmpy", "fmu")

MODEL = """\
model: eha_knee
parameters: {leakage: 4e-15, rotor_inertia: 0.002}
effects:
  - {effect: command_delay, delay: 3.3 ms}
  - {effect: entrained_air, air_fraction: 0.02}
"""
OUTPUTS = (
    "current", "motor_speed", "pressure_a", "pressure_b", "piston_position", "piston_velocity",
    "joint_angle",
)  # fmt: skip
MAPPED = "\n".join(f"  {name}: {{variable: {name}}}" for name in OUTPUTS)
TARGET = f"""\
target: fmu
fmu: knee.fmu
model: model.yaml
inputs: {{current_command: {{variable: current_command}}}}
outputs:
{MAPPED}
setup:
  piston: {{variable: piston_locked}}
  bypass: {{variable: bypass_open}}
initial: {{piston_position: {{variable: start_piston_position}}}}
"""
SIMULATOR = "target: simulator\nmodel: model.yaml\nsensors: {}\n"
SUITE = """\
name: knee
trials:
  - id: locked
    mode: pressure
    setup: {piston: locked, initial: {piston_position: 3 mm}}
    signal: {kind: step, initial: 0 MPa, final: 8 MPa, at: 10 ms}
    duration: 0.1 s
  - id: bypassed
    mode: current
    setup: {piston: locked, bypass: open}
    signal: {kind: ramp, final: 8 A, over: 80 ms}
    duration: 0.1 s
  - id: free
    mode: joint_angle
    signal: {kind: sine, offset: 50 deg, amplitude: 2 deg, frequency: 4 Hz}
    duration: 0.3 s
"""


@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_an_exported_plant_is_the_simulator(version: int, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    (tmp_path / "model.yaml").write_text(MODEL)
    (tmp_path / "fmu.yaml").write_text(TARGET)
    (tmp_path / "simulator.yaml").write_text(SIMULATOR)
    (tmp_path / "suite.yaml").write_text(SUITE)
    path = export_fmu(tmp_path / "model.yaml", tmp_path / "knee.fmu", version)
    assert validate_fmu(str(path)) == []
    results = {
        name: eha_bench.run(tmp_path / "suite.yaml", tmp_path / f"{name}.yaml", tmp_path / name)
        for name in ("fmu", "simulator")
    }
    for mine, theirs in zip(results["fmu"].trials, results["simulator"].trials, strict=True):
        assert mine.status.value == "passed"
        one = eha_bench.read(tmp_path / "fmu" / mine.recording)
        other = eha_bench.read(tmp_path / "simulator" / theirs.recording)
        assert dict(one.metadata)["model.leakage"] == "4e-15"
        for name in ("reference", "current_command", *OUTPUTS):
            scale = np.abs(other[name]).max() + 1e-12
            np.testing.assert_allclose(one[name], other[name], rtol=1e-7, atol=1e-9 * scale)
        for found, wanted in zip(mine.scores, theirs.scores, strict=True):
            assert found.metric == wanted.metric
            assert found.value == pytest.approx(wanted.value, rel=1e-6, nan_ok=True)
    values = [score.value for trial in results["fmu"].trials for score in trial.scores]
    assert np.isfinite(values).sum() > 10


def test_a_plant_without_a_command_is_not_exported(tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text("model: pump_hold\n")
    with pytest.raises(InputError, match="no input that a controller commands"):
        export_fmu(tmp_path / "model.yaml", tmp_path / "x.fmu")
    with pytest.raises(InputError, match=r"end it in \.fmu"):
        export_fmu(shipped_file("models/paper.yaml"), tmp_path / "x.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["model.yaml"]


def test_a_drive_that_is_commanded_by_a_voltage_is_exported_too(tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text("model: linear_drive\nparameters: {voltage_limit: 10 V}\n")
    (tmp_path / "controller.yaml").write_text(
        "piston_position: {controller: pid, k_p: 39 kV/m, k_d: 243 V*s/m}\n"
    )
    (tmp_path / "fmu.yaml").write_text(
        "target: fmu\nfmu: drive.fmu\nmodel: model.yaml\ncontroller: controller.yaml\n"
        "inputs: {voltage: {variable: voltage}}\n"
        "outputs:\n  piston_position: {variable: piston_position}\n"
        "  piston_velocity: {variable: piston_velocity}\n"
        "initial: {piston_position: {variable: start_piston_position}}\n"
    )
    (tmp_path / "simulator.yaml").write_text(SIMULATOR + "controller: controller.yaml\n")
    (tmp_path / "suite.yaml").write_text(
        "name: drive\ntrials:\n  - id: step\n    mode: piston_position\n    duration: 0.2 s\n"
        "    signal: {kind: step, initial: 1 mm, final: 3 mm, at: 10 ms}\n"
        "    accept: {peak: 2.9 mm .. 4 mm}\n"
    )
    export_fmu(tmp_path / "model.yaml", tmp_path / "drive.fmu")
    found = {}
    for name in ("fmu", "simulator"):
        out = tmp_path / name
        result = eha_bench.run(tmp_path / "suite.yaml", tmp_path / f"{name}.yaml", out)
        assert result.status.value == "passed"
        found[name] = eha_bench.read(out / result.trials[0].recording)
    assert np.abs(found["fmu"]["voltage"]).max() == 10.0
    for channel in ("voltage", "piston_position", "piston_velocity"):
        scale = np.abs(found["simulator"][channel]).max()
        one, other = (found[name][channel] for name in ("fmu", "simulator"))
        np.testing.assert_allclose(one, other, atol=1e-6 * scale)
