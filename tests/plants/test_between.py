"""A measured speed between its samples: parabolas exactly, sines far better than straight lines."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.core.arrays import FloatArray
from eha_bench.plants.network.between import bows
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.network.plant import NetworkPlant
from eha_bench.plants.plant import AT_ONCE, Drive

SPAN = 5e-3
TURNED = """\
plant: turned
nodes:
  shaft: {kind: rotation, inertia: 1 kg*m^2}
elements:
  drag: {kind: friction, on: shaft, viscous: 1 N*m*s/rad}
channels: {shaft_speed: shaft.speed, shaft_angle: shaft.angle}
"""


def moved(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the area of each span."""
    straight = 0.5 * (values[1:] + values[:-1])
    return np.asarray((straight + bows(time, values)[:-1] / 6.0) * np.diff(time))


@pytest.mark.parametrize("irregular", [0.0, 0.1])
def test_a_parabola_is_followed_exactly_to_both_ends(irregular: float) -> None:
    generator = np.random.default_rng(0)
    time = SPAN * (np.arange(20) + irregular * generator.uniform(-1.0, 1.0, 20))
    found = moved(time, 3.0 + 40.0 * time - 700.0 * time**2)
    exact = np.diff(3.0 * time + 20.0 * time**2 - 700.0 / 3.0 * time**3)
    np.testing.assert_allclose(found, exact, rtol=1e-12)


def test_a_sine_of_a_fifth_of_the_rate_is_off_by_a_quarter_of_what_straight_lines_are() -> None:
    time = SPAN * np.arange(101)
    rate = 2.0 * np.pi * 0.2 / SPAN
    values = np.sin(rate * time)
    exact = np.diff(-np.cos(rate * time)) / rate
    inner = slice(1, -1)
    straight = 0.5 * (values[1:] + values[:-1]) * SPAN
    # by hand: half a span is 0.2 pi of the sine, 0.2 pi / tan(0.2 pi) = 0.8648
    np.testing.assert_allclose(straight[inner], 0.8648 * exact[inner], atol=2e-4 * SPAN)
    # times 1 + (2 - 2 cos(0.4 pi)) / 12 = 1.1152
    np.testing.assert_allclose(moved(time, values)[inner], 0.9644 * exact[inner], atol=2e-4 * SPAN)


def test_what_a_jump_adds_before_it_takes_away_behind() -> None:
    found = bows(SPAN * np.arange(8), np.repeat([0.0, 10.0], 4))
    np.testing.assert_allclose(found, [0.0, 0.0, -2.5, 0.0, 2.5, 0.0, 0.0, 0.0], atol=1e-12)


def test_nothing_bends_across_a_gap_nor_by_what_is_remembered_of_long_before() -> None:
    time = SPAN * np.array([0.0, 1.0, 2.0, 6.0, 7.0, 8.0])
    found = bows(time, np.array([0.0, 1.0, 4.0, 36.0, 49.0, 64.0]))
    np.testing.assert_allclose(found, [-1.0, -1.0, 0.0, -1.0, -1.0, 0.0])
    remembered = SPAN * np.arange(6.0)
    remembered[0] = remembered[1] - AT_ONCE
    found = bows(remembered, np.array([70.0, 1.0, 4.0, 9.0, 16.0, 25.0]))
    np.testing.assert_allclose(found, [0.0, -1.0, -1.0, -1.0, -1.0, 0.0])


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0]])
def test_two_readings_are_a_straight_line(values: list[float]) -> None:
    assert not bows(SPAN * np.arange(len(values)), np.array(values)).any()


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> NetworkPlant:
    path = tmp_path_factory.mktemp("plant") / "turned.yaml"
    path.write_text(TURNED, encoding="utf-8")
    return load_plant(path)


@pytest.mark.parametrize("step", [SPAN, 0.5 * SPAN, 0.03 * SPAN])
def test_a_shaft_turns_as_far_as_its_speed_bends_by_steps_of_any_length(
    turned: NetworkPlant, step: float
) -> None:
    time = SPAN * np.arange(81)
    rate = 2.0 * np.pi * 20.0
    speed = 10.0 * np.sin(rate * time + 0.3)
    exact = -10.0 / rate * (np.cos(rate * time + 0.3) - np.cos(0.3))
    model = turned.at(turned.layout.defaults())
    found = model.simulate(Drive(time, {"shaft_speed": speed}), {"shaft_angle": 0.0}, step)
    at = turned.outputs.index("shaft_angle")
    summed = np.concatenate([[0.0], np.cumsum(moved(time, speed))])
    np.testing.assert_allclose(found[:, at], summed, atol=1e-12)
    straight = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * SPAN)])
    off, before = np.ptp(found[:, at] - exact), np.ptp(straight - exact)
    assert off < 0.1 * before
