"""Draws of a rival's posterior: their scatter, and where they may not go."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from experiment_question import rival, write_question

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.diagnosis.fit.uncertainty import Covariance
from eha_bench.diagnosis.outcome.rival import Rival
from eha_bench.experiment.hypothesis import Hypothesis, read_question, rivals_to_separate
from eha_bench.experiment.proposal import ProposalEnding
from imposed_plants import PUMPED
from spindle_plant import SPINDLE

KEYS = ("viscous_torque", "coulomb_torque", "bulk_modulus", "leakage")


def wide(share: float) -> Rival:
    """Friction, a modulus of 1e9 and a leakage of 1e-13, correlated in pairs."""
    found = rival(None, share=share, known=KEYS)
    deviation = np.sqrt(np.diag(found.covariance.matrix))
    correlation = np.eye(4)
    correlation[0, 1] = correlation[1, 0] = 0.8
    correlation[2, 3] = correlation[3, 2] = -0.6
    matrix = correlation * np.outer(deviation, deviation)
    return replace(found, covariance=Covariance(KEYS, matrix))


def asked(folder: Path, *rivals: Rival) -> tuple[Hypothesis, ...]:
    return read_question(write_question(folder, rivals)).rivals


def test_draws_scatter_as_the_covariance_says_over_twenty_decades(tmp_path: Path):
    (found,) = asked(tmp_path, wide(0.01))
    rebuilt = found.root @ found.root.T
    scale = np.sqrt(np.diag(found.covariance))
    assert scale.max() / scale.min() > 1e20
    assert rebuilt / np.outer(scale, scale) == pytest.approx(
        found.covariance / np.outer(scale, scale), abs=1e-9
    )
    places = [found.model.plant.layout.index[key] for key in KEYS]
    drawn = found.at(np.random.default_rng(1).standard_normal((4000, 4)))[:, places]
    off = (drawn - found.vector[places]) / scale
    assert off.std(axis=0) == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(off.T)[0, 1] == pytest.approx(0.8, abs=0.03)
    assert np.corrcoef(off.T)[2, 3] == pytest.approx(-0.6, abs=0.03)


def test_what_is_positive_is_drawn_positive(tmp_path: Path):
    (found,) = asked(tmp_path, wide(1.0))
    places = [found.model.plant.layout.index[key] for key in KEYS]
    drawn = found.at(np.random.default_rng(1).standard_normal((500, 4)))[:, places]
    assert (drawn >= 0.0499 * found.vector[places]).all()


def test_first_the_causes_and_then_their_forms_are_compared(tmp_path: Path):
    lag = rival("current_lag", {"time_constant": 2e-3})
    delay = rival("command_delay", {"delay": 2e-3})
    other = replace(delay, form="of another kind")
    found = asked(tmp_path, lag, other, delay)
    assert [item.id for item in rivals_to_separate(found)] == [
        "current_lag", "command_delay (of another kind)", "command_delay"
    ]  # fmt: skip
    # forms of one cause alone are nothing to separate
    assert [item.id for item in rivals_to_separate(found[1:])] == [
        "command_delay (of another kind)"
    ]


def test_friction_that_creeps_counts_as_one_that_sticks_too(tmp_path: Path):
    (tmp_path / "plant.yaml").write_text(PUMPED)
    plant, known = str(tmp_path / "plant.yaml"), ("drag.coulomb", "drag.creep_speed")
    creeping = [
        rival("asymmetric_friction", {"asymmetry": 0.3}, source=plant, known=known),
        rival("gravity_load", {"gravity_force": 60.0}, source=plant, known=known),
    ]
    both = [
        replace(item, model=item.model.with_parameters({"drag.creep_speed": 2e-5}))
        for item in creeping
    ]
    found = read_question(
        write_question(
            tmp_path / "diagnosis",
            both,
            extremes={"motor_speed": (-1.0, 1.0)},
            command="motor_speed",
        )
    ).rivals
    ids = [item.id for item in rivals_to_separate(found)]
    assert ids == [
        "asymmetric_friction", "gravity_load",
        "asymmetric_friction, sticking", "gravity_load, sticking",
    ]  # fmt: skip
    still = rivals_to_separate(found)[2]
    assert still.model.value("drag.creep_speed") == 0.0
    assert still.keys == ("drag.coulomb", "asymmetric_friction.asymmetry")
    assert still.covariance.shape == (2, 2)
    # one that sticks anyway is the same, and one cause alone is not separated
    stuck = [item for item in found if item.sticking() is None]
    assert not stuck
    assert [item.id for item in rivals_to_separate(found[:1])] == ["asymmetric_friction"]


PLANT = SPINDLE.replace("inputs:", "  load:  {kind: load, on: shaft, force: 0.02 N*m}\ninputs:")


@pytest.mark.parametrize(("effect", "key", "value", "half", "share", "of"), [
    ("cogging_torque", "phase", -0.096, 0.05, 0.05, "1 rad"),
    ("cogging_torque", "amplitude", 0.05, 0.01, 0.2, "its value"),
    # usually 10 %
    ("asymmetric_friction", "asymmetry", 0.02, 0.01, 0.1, "its usual size"),
    ("asymmetric_friction", "asymmetry", -0.4, 0.1, 0.25, "its value"),
])  # fmt: skip
def test_what_may_be_nothing_is_not_judged_by_its_value(
    tmp_path: Path, effect: str, key: str, value: float, half: float, share: float, of: str
):
    (tmp_path / "plant.yaml").write_text(SPINDLE)
    strength = {"amplitude": 0.05} if key == "phase" else {}
    item = rival(effect, {**strength, key: value}, source=str(tmp_path / "plant.yaml"),
                 known=("drag.coulomb",))  # fmt: skip
    matrix = np.diag([(1e-6 * 0.16) ** 2, *(1e-18 for _ in strength), (half / 1.96) ** 2])
    item = replace(item, covariance=Covariance(item.covariance.parameters, matrix))
    (found,) = asked(tmp_path / "diagnosis", item)
    name = f"{effect}.{key}"
    assert found.relative_half_widths(found.covariance)[name] == pytest.approx(share)
    assert found.judged_against[name] == of
    # a draw is judged as what was fitted
    there = found.drawn(np.array([0.0, *(0.0 for _ in strength), 1.9]))
    if of != "its value":
        assert there.relative_half_widths(found.covariance)[name] == pytest.approx(share)


@pytest.mark.parametrize(("half", "judged"), [(0.005, True), (0.03, False)])
def test_a_force_that_may_as_well_be_zero_is_a_share_of_nothing(
    tmp_path: Path, half: float, judged: bool
):
    (tmp_path / "plant.yaml").write_text(PLANT)
    item = rival(None, source=str(tmp_path / "plant.yaml"), known=("drag.coulomb", "load.force"))
    matrix = np.diag([1e-18, (half / 1.96) ** 2])
    item = replace(item, covariance=Covariance(item.covariance.parameters, matrix))
    folder = write_question(
        tmp_path / "diagnosis", [item], noise={"motor_speed": 0.3}, piston="free",
        extremes={"current_command": (-8.0, 8.0), "motor_speed": (-100.0, 100.0)},
    )  # fmt: skip
    (found,) = read_question(folder).rivals
    assert ("load.force" in found.relative_half_widths(found.covariance)) is judged
    if not judged:
        ended = eb.next_experiment(folder)
        assert ended.ending is ProposalEnding.NOTHING_OPEN
        assert "but for load.force, which may as well be 0" in ended.sentence


@pytest.mark.parametrize(("change", "said"), [
    ({"parameters": ["leak_age"]}, "has no parameter 'leak_age'"),
    ({"matrix": [[-1.0]]}, "negative variance"),
])  # fmt: skip
def test_a_covariance_that_cannot_be_is_refused(
    tmp_path: Path, change: dict[str, object], said: str
):
    folder = write_question(tmp_path, [rival(None, known=("leakage",))])
    file = folder / "diagnosis.json"
    content = json.loads(file.read_text())
    content["rivals"][0]["covariance"] |= change
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=said):
        read_question(folder)


def test_a_verdict_that_there_is_not_is_refused(tmp_path: Path):
    folder = write_question(tmp_path, [rival(None)])
    file = folder / "diagnosis.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"verdict": "foo"}))
    with pytest.raises(InputError, match="foo"):
        read_question(folder)


SPRUNG = """\
plant: spindle
nodes: {shaft: {kind: rotation, inertia: 9e-4 kg*m^2}}
elements:
  motor: {kind: motor, on: shaft, torque_constant: 0.13 N*m/A}
  drag:  {kind: friction, on: shaft, viscous: 0.004 N*m*s/rad}
  hold:  {kind: spring, on: shaft, stiffness: 2 N*m/rad}
inputs: {current_command: motor.current}
channels: {angle: shaft.angle}
calibrate: [shaft.inertia, drag.viscous]
"""


def test_an_unknown_that_follows_a_speed_that_nobody_logs_is_played_and_planned_for(
    tmp_path: Path,
) -> None:
    (tmp_path / "plant.yaml").write_text(SPRUNG)
    rivals = []
    for variable, most in (("shaft_speed", 10.0), ("angle", 0.5)):
        at = np.linspace(-most, most, 24)
        values = (-0.2 * np.sign(at) * (at / most) ** 2).tolist()
        model = {"model": "plant.yaml", "effects": [
            {"effect": "learned", "form": "additive", "variable": variable, "low": -most,
             "high": most, "values": values, "at": "shaft"}]}  # fmt: skip
        (tmp_path / f"{variable}.yaml").write_text(json.dumps(model))
        file = str(tmp_path / f"{variable}.yaml")
        item = rival(None, source=file, known=("shaft.inertia", "drag.viscous"))
        rivals.append(replace(item, cause=f"learned of {variable}", effects=("learned",)))
    extremes = {"current_command": (-3.0, 3.0), "angle": (-0.5, 0.5)}
    folder = write_question(tmp_path / "found", rivals, noise={"angle": 1e-3}, extremes=extremes,
                            piston="free")  # fmt: skip
    question = read_question(folder)
    assert [item.id for item in question.rivals] == ["learned of shaft_speed", "learned of angle"]
    found = eb.next_experiment(folder, tmp_path / "next.yaml", budget=3.0)
    assert found.ending is ProposalEnding.PROPOSED
