"""What sensors add: white noise, counts, and an error that changes slowly."""

import numpy as np
import pytest

from eha_bench.core.errors import InputError, Place, UnitError
from eha_bench.targets.sensors import SensorNoise, SimulatedSensor, check_sensors

N, PERIOD = 80_000, 1e-3


def read(sensor: SimulatedSensor, seed: int = 1) -> np.ndarray:
    noise = SensorNoise({"current": sensor}, ("current",), N, [seed], {}, PERIOD)
    return np.array([noise.read(tick, np.zeros(1))[0] for tick in range(N)])


def test_a_slow_error_has_its_size_and_its_memory() -> None:
    found = read(SimulatedSensor(wander="20 mA", memory=0.02))
    assert found.std() == pytest.approx(0.02, rel=0.05)
    for lag, expected in ((1, np.exp(-0.05)), (20, np.exp(-1.0)), (200, 0.0)):
        alike = np.corrcoef(found[lag:], found[:-lag])[0, 1]
        assert alike == pytest.approx(expected, abs=0.03)
    assert abs(found[0]) > 0.0


def test_it_comes_beside_the_noise_and_changes_none_of_it() -> None:
    plain, slow = read(SimulatedSensor(noise=0.05)), read(SimulatedSensor(noise=0.05, wander=0.02))
    assert slow.std() == pytest.approx(np.hypot(0.05, 0.02), rel=0.03)
    assert abs(np.corrcoef(slow - plain, plain)[0, 1]) < 0.03
    assert np.array_equal(slow, read(SimulatedSensor(noise=0.05, wander=0.02)))


def test_it_cannot_be_negative() -> None:
    with pytest.raises(UnitError, match="cannot be negative"):
        SimulatedSensor(wander=-1.0).in_si("current")


@pytest.mark.parametrize(
    ("channel", "noise", "said"),
    [
        ("motor_spee", "3 rpm", "'motor_spee'.*did you mean 'motor_speed'"),
        ("motor_speed", "3 MPa", "wrong dimension"),
    ],
)
def test_a_sensor_of_nothing_or_in_another_unit_is_refused(
    channel: str, noise: str, said: str
) -> None:
    sensors = {channel: SimulatedSensor(noise=noise)}
    units = {"motor_speed": "rad/s"}
    with pytest.raises(InputError, match=said):
        check_sensors(sensors, units, units, lambda name: Place(file="target.yaml", key=name))
