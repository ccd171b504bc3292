"""How friction behaves at rest: sticking, or creeping at a speed that no sheet declares."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.recording import Recording
from eha_bench.diagnosis.data.dataset import Run, Use
from eha_bench.diagnosis.data.gate import admit
from eha_bench.diagnosis.data.windows import cut_windows
from eha_bench.diagnosis.fit.friction_at_rest import at_rest
from eha_bench.diagnosis.fit.least_squares import free_parameters, levenberg_marquardt
from eha_bench.diagnosis.fit.problem import Problem
from eha_bench.plants.model import load_model
from eha_bench.plants.plant import Drive

_PLANT = """\
plant: fast_shaft
nodes: {shaft: {kind: rotation, inertia: 1e-5 kg*m^2}}
elements:
  drag:  {kind: friction, on: shaft, viscous: 1e-5 N*m*s/rad, coulomb: 0.02 N*m}
  motor: {kind: motor, on: shaft, torque_constant: 0.1 N*m/A}
inputs:   {command: motor.current}
channels: {angle: shaft.angle}
calibrate: [{parameter: drag.coulomb, within: 20 %}]
"""
_NOISE = {"angle": 1e-3}


@pytest.mark.parametrize("creeps", [0.0, 0.25, 0.8])
def test_a_fast_shaft_creeps_as_fast_as_it_does(tmp_path: Path, creeps: float) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(_PLANT, encoding="utf-8")
    model = load_model(path)
    at = model.plant.layout.index["drag.creep_speed"]
    truth = model.vector()
    truth[at] = creeps
    time = np.arange(0.0, 4.0, 0.01)
    # now within the dry friction, now beyond
    current = 0.15 * np.sign(np.sin(2.0 * time)) + 0.1 * (np.sin(0.7 * time) > 0.9)
    angle = model.plant.simulate(truth, Drive(time, {"command": current}), 1e-4)[:, 0]
    angle += 1e-3 * np.random.default_rng(2).standard_normal(time.size)
    log = Recording(time, {"command": current, "angle": angle})
    run = Run("log", Path("log.csv"), None, False, False, Use.TRAIN, lambda: log)
    measured = admit(run, log, ["command"], ["angle"], roles=model.plant.roles)
    problem = Problem(model.plant, cut_windows(measured, _NOISE), _NOISE, 2e-4)
    begin = model.vector()
    problem.prepare(begin)
    free = free_parameters(model.plant.layout, ["drag.coulomb"], begin)
    fit = levenberg_marquardt(problem, begin, free, iterations=4)
    found = at_rest(problem, fit)
    # to a third: the fit goes on from there
    assert found.vector[at] == pytest.approx(creeps, rel=0.34)
    assert found.vector[model.plant.layout.index["drag.coulomb"]] == pytest.approx(0.02, rel=0.1)
