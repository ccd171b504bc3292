"""From a fitted vector back to a model file."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.outcome.revise import revised_model
from eha_bench.plants.model import DeclaredEffect, Model

LAG, FRICTION = "current_lag", "coulomb_friction"


def vector_of(model: Model, **values: float) -> FloatArray:
    """The model's vector with some values changed; `effect__name` is an effect's."""
    vector = model.vector().copy()
    for key, value in values.items():
        vector[model.plant.layout.index[key.replace("__", ".")]] = value
    return vector


def test_estimated_parameters_are_written_and_others_stay() -> None:
    model = Model("linear_drive", {"mass": 90.0})
    vector = vector_of(model, mass=101.5, viscous_friction=7.0)
    out = revised_model(model, vector, ["mass"])
    assert dict(out.parameters) == {"mass": 101.5}
    assert dict(model.parameters) == {"mass": 90.0}


def test_a_declared_effect_gets_its_estimate_and_keeps_the_rest() -> None:
    declared = DeclaredEffect(FRICTION, {"friction_force": 5.0, "static_ratio": 1.5})
    model = Model("linear_drive", effects=(declared,))
    vector = vector_of(model, coulomb_friction__friction_force=7.5, mass=1.0)
    (effect,) = revised_model(model, vector, [f"{FRICTION}.friction_force"]).effects
    assert dict(effect.values) == {"friction_force": 7.5, "static_ratio": 1.5}


def test_an_added_effect_stands_with_all_its_values() -> None:
    model = Model("linear_drive")
    vector = vector_of(model, current_lag__time_constant=0.003)
    out = revised_model(model, vector, [], [LAG])
    assert [(item.id, dict(item.values)) for item in out.effects] == [
        (LAG, {"time_constant": 0.003})
    ]
    assert np.array_equal(out.vector(), vector)


def test_a_choice_is_written_as_its_word() -> None:
    model = Model("linear_drive")
    effect = model.plant.layout.effect("asymmetric_friction")
    parameter = next(item for item in effect.parameters if item.choices)
    for number, word in enumerate(parameter.choices):
        key = f"asymmetric_friction__{parameter.name}"
        out = revised_model(model, vector_of(model, **{key: float(number)}), [], [effect.id])
        assert out.effects[0].values[parameter.name] == word


def test_a_learned_curve_is_written_knot_by_knot() -> None:
    model = Model("linear_drive")
    effect = model.plant.layout.effect("learned")
    curve = next(item for item in effect.parameters if item.size > 1)
    at = model.plant.layout.index[f"learned.{curve.name}"]
    vector = model.vector().copy()
    vector[at : at + curve.size] = np.linspace(-1.0, 2.0, curve.size)
    out = revised_model(model, vector, [], ["learned"])
    assert out.effects[0].values[curve.name] == pytest.approx(np.linspace(-1.0, 2.0, curve.size))


def test_what_a_run_or_a_clock_has_of_its_own_is_no_model_s() -> None:
    model = Model("linear_drive")
    keys = ["mass in first.csv", "lateness of log", f"{LAG}.time_constant"]
    # an estimate of an effect that is neither declared nor added is not written either
    assert revised_model(model, vector_of(model, current_lag__time_constant=0.01), keys) == model


@given(
    st.dictionaries(
        st.sampled_from(["mass", "viscous_friction", "coulomb_friction", "force_offset"]),
        st.floats(0.5, 500.0),
    ),
    st.floats(1e-4, 0.01),
)
def test_the_revised_model_simulates_with_the_fitted_vector(
    values: dict[str, float], lag: float
) -> None:
    model = Model("linear_drive")
    vector = vector_of(model, current_lag__time_constant=lag, **values)
    assert np.array_equal(revised_model(model, vector, list(values), [LAG]).vector(), vector)
