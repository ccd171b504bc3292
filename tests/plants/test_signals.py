"""What may act on the signals of a plant in Python: its command and its sensors."""

from types import MappingProxyType

import numpy as np
import pytest

from eha_bench.plants.effect import AT, registered_effects
from eha_bench.plants.layout import Layout
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.plant import Drive, Plant
from eha_bench.plants.session import Session
from eha_bench.plants.signals import SignalPlant, with_signals


class Integrator(Plant):
    """dx/dt = gain u, read as it is: whatever is on shows at once."""

    id = "integrator"
    outputs = states = ("level",)
    state_places = MappingProxyType({"level": 0})
    inputs = ("flow",)
    command = "flow"
    units = MappingProxyType({"flow": "V", "level": "m"})

    def __init__(self) -> None:
        self.layout = Layout(self.id, (Parameter("gain", "m/(V*s)", 2.0, 0.0, 1e9),))

    def start(self, vector, initial):
        (_gain,) = vector
        return np.array([initial.get("level", 0.0)]), np.zeros(1)

    def advance(self, first, last, time, inputs, locked, bypass_open, step, fresh, vector, memory,
                state, out):  # fmt: skip
        (gain,) = vector
        for k in range(first, last + 1):
            out[k] = state
            if k < last:
                state[0] += gain * inputs[k, 0] * (time[k + 1] - time[k])


TIME = np.arange(0.0, 1.0, 0.01)
STEP = np.where(TIME >= 0.2 - 1e-9, 1.0, 0.0)


@pytest.fixture(scope="module")
def plant() -> Plant:
    return with_signals(Integrator(), registered_effects())


def _run(plant: Plant, initial=None, **values: float):
    vector = plant.layout.defaults()
    for key, value in values.items():
        vector[plant.layout.index[key.replace("__", ".")]] = value
    drive = Drive(TIME, {"flow": STEP}, initial or {})
    return plant.simulate(vector, drive, 1e-3)[:, 0]


def test_it_has_effects_on_its_signals_and_none_within(plant: Plant) -> None:
    assert isinstance(plant, SignalPlant)
    names = {effect.id for effect in plant.layout.effects}
    assert names == {"command_delay", "command_lag", "learned", "sensor_lag", "sensor_offset"}
    assert with_signals(plant, registered_effects()) is plant


def test_while_all_is_off_it_is_the_plant_itself(plant: Plant) -> None:
    own = Integrator().simulate(np.array([2.0]), Drive(TIME, {"flow": STEP}), 1e-3)
    assert np.array_equal(_run(plant), own[:, 0])


@pytest.mark.parametrize("delay", [0.03, 0.034])
def test_a_delayed_command_shifts_what_follows(plant: Plant, delay: float) -> None:
    expected = 2.0 * np.maximum(TIME - 0.2 - delay, 0.0)
    # what is held between samples arrives as a mean over each of them
    assert np.allclose(_run(plant, command_delay__delay=delay), expected, atol=1e-9 + 0.02 * 0.004)


def test_a_lagging_command_integrates_to_its_time_constant_less(plant: Plant) -> None:
    found = _run(plant, command_lag__time_constant=0.05)
    after = np.maximum(TIME - 0.2, 0.0)
    assert np.allclose(found, 2.0 * (after - 0.05 * (1.0 - np.exp(-after / 0.05))), atol=1e-9)


def test_an_offset_is_read_and_the_first_reading_has_it(plant: Plant) -> None:
    found = _run(plant, {"level": 0.5}, sensor_offset__offset=0.1)
    assert np.allclose(found, _run(plant, {"level": 0.5}))
    # where nothing was read first, it stands beside
    assert np.allclose(_run(plant, sensor_offset__offset=0.1), _run(plant) + 0.1)


def test_a_slow_sensor_follows_a_ramp_late(plant: Plant) -> None:
    found = _run(plant, sensor_lag__time_constant=0.05)
    after = np.maximum(TIME - 0.2, 0.0)
    assert np.allclose(found, 2.0 * (after - 0.05 * (1.0 - np.exp(-after / 0.05))), atol=1e-9)


@pytest.mark.parametrize(
    ("at", "variable", "more"),
    [("flow.drive", "time", 0.5 * 2.0 * TIME[-1]), ("level.sensor", "level", 0.5)],
)
def test_a_learned_curve_acts_on_a_signal(plant: Plant, at, variable, more) -> None:
    layout = plant.layout
    learned = layout.effect("learned")
    vector = layout.defaults()
    for name, value in {"scale": 1.0, "low": 0.0, "high": 1.0}.items():
        vector[layout.index[f"learned.{name}"]] = value
    vector[layout.index[f"learned.{AT}"]] = learned.parameter(AT).encode(at)
    vector[layout.index["learned.variable"]] = learned.parameter("variable").encode(variable)
    values = layout.index["learned.values"]
    vector[values : values + 24] = 0.5
    found = plant.simulate(vector, Drive(TIME, {"flow": STEP}), 1e-3)[:, 0]
    base = 2.0 * np.maximum(TIME - 0.2, 0.0)
    assert found[-1] == pytest.approx(base[-1] + more)


def test_a_session_gives_what_a_recording_gives(plant: Plant) -> None:
    vector = plant.layout.defaults()
    for key, value in {"command_delay.delay": 0.034, "sensor_lag.time_constant": 0.02}.items():
        vector[plant.layout.index[key]] = value
    session = Session(plant, vector, {}, step=1e-3)
    rows = [float(session.reading[0])]
    for k in range(TIME.size - 1):
        session.advance(TIME[k + 1], STEP[k])
        rows.append(float(session.reading[0]))
    whole = plant.simulate(vector, Drive(TIME, {"flow": STEP}), 1e-3)[:, 0]
    assert np.allclose(rows, whole, atol=1e-12)
