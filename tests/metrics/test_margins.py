"""Margins and resonance of known loops, by theory and by python-control."""

import math

import numpy as np
import pytest

import control
from eha_bench.core.signal import Lines
from eha_bench.metrics.bandwidth import ResonanceFrequency, ResonancePeak
from eha_bench.metrics.frequency_response import FrequencyResponse
from eha_bench.metrics.margins import GainMargin, PhaseMargin, sign_changes
from eha_bench.metrics.metric import NotScored
from eha_bench.metrics.response_point import ResponsePoint

S = control.tf("s")
LOOPS = {
    "third order": 2.0 / (S * (S + 1) * (S + 2)),
    "near instability": 5.0 / (S * (S + 1) * (S + 2)),
    "well damped": 0.5 / (S * (S + 1) * (S + 2)),
    "with a zero": 3.0 * (1 + 0.3 * S) / (S * (S + 1) * (S + 3) * (1 + 0.05 * S)),
}


def measured(loop, frequency, *, relative=0.0, rng=None):
    """Closed-loop points of a loop at frequencies in Hz, with noise of a relative sd."""
    response = control.feedback(loop)(2j * np.pi * frequency)
    sd = relative * np.abs(response)
    if rng is not None:
        response = response + sd * (rng.normal(size=sd.size) + 1j * rng.normal(size=sd.size))
    points = tuple(
        ResponsePoint(f, complex(r), 2.0 * s**2, 40.0, 1.0)
        for f, r, s in zip(frequency.tolist(), response.tolist(), sd.tolist(), strict=True)
    )
    return FrequencyResponse(points, (), "test", "")


GRID = np.geomspace(0.01, 2.0, 40)


@pytest.mark.parametrize("name", LOOPS)
def test_margins_are_those_of_python_control(name):
    gain, phase, _, _ = control.margin(LOOPS[name])
    response = measured(LOOPS[name], GRID)
    for metric, truth in ((GainMargin(), gain), (PhaseMargin(), math.radians(phase))):
        found = metric.of(response)
        assert found.value == pytest.approx(truth, rel=5e-3)
        assert "the least of" not in found.reason  # there is one crossover


@pytest.mark.parametrize("damping", [0.3, 0.5, 0.9])
def test_phase_margin_of_a_second_order_loop(damping):
    loop = 1 / (S * (S + 2 * damping))
    crossover = math.sqrt(math.sqrt(4 * damping**4 + 1) - 2 * damping**2)
    found = PhaseMargin().of(measured(loop, GRID))
    assert found.value == pytest.approx(math.atan(2 * damping / crossover), rel=2e-3)
    assert f"{crossover / (2 * math.pi):.4g} Hz" in found.reason


def test_a_margin_for_less_gain_is_none_for_more():
    # two integrations: the lag is 180 deg at 0.3 rad/s as well, where the gain is large
    loop = 3.0 * (S + 0.3) ** 2 / (S**3 * (1 + 0.1 * S) * (1 + 0.02 * S)) * S / (S + 0.01)
    response = measured(loop, np.geomspace(0.02, 20.0, 80))
    # control.stability_margins(loop, returnall=True): 0.0503 at 0.3009, 18.587 at 21.55 rad/s
    assert GainMargin().of(response).value == pytest.approx(18.587, rel=1e-2)
    low = measured(loop, np.geomspace(0.005, 0.3, 40))
    with pytest.raises(NotScored, match=r"not excited where it crosses over"):
        GainMargin().of(low)


def test_an_unstable_loop_has_a_negative_phase_margin():
    # T = L / (1 + L) exists on the axis although the loop oscillates
    response = measured(9.0 / (S * (S + 1) * (S + 2)), GRID)
    assert PhaseMargin().of(response).value < 0.0


def test_margins_are_not_guessed_where_the_loop_was_not_excited():
    slow = measured(LOOPS["third order"], np.geomspace(0.01, 0.05, 12))
    for metric in (GainMargin(), PhaseMargin()):
        with pytest.raises(NotScored, match=r"not excited where it crosses over"):
            metric.of(slow)
    with pytest.raises(NotScored, match=r"not excited"):  # a second-order loop never lags by 180
        GainMargin().of(measured(1 / (S * (S + 1)), GRID))


@pytest.mark.parametrize(
    "metric",
    [
        GainMargin,
        pytest.param(PhaseMargin, marks=pytest.mark.slow),
        pytest.param(ResonancePeak, marks=pytest.mark.slow),
        pytest.param(ResonanceFrequency, marks=pytest.mark.slow),
    ],
)
def test_intervals_hold_the_truth(metric):
    loop, rng = LOOPS["third order"], np.random.default_rng(5)
    truth = metric().of(measured(loop, np.geomspace(0.01, 2.0, 400))).value
    found = [metric().of(measured(loop, GRID, relative=0.02, rng=rng)) for _ in range(300)]
    assert 0.91 <= np.mean([item.low <= truth <= item.high for item in found]) <= 0.99
    # and by their width, not by chance; a place of a peak is interpolated, which widens it
    scatter = 2.0 * 1.96 * np.std([item.value for item in found])
    assert np.median([item.high - item.low for item in found]) == pytest.approx(scatter, rel=0.35)


@pytest.mark.parametrize("damping", [0.2, 0.4, 0.6])
def test_resonance_lies_between_the_points(damping):
    loop = 1 / (S * (S + 2 * damping))  # closed: 1 / (s^2 + 2 zeta s + 1)
    response = measured(loop, np.geomspace(0.02, 1.0, 14))
    peak = 1 / (2 * damping * math.sqrt(1 - damping**2))
    place = math.sqrt(1 - 2 * damping**2) / (2 * math.pi)
    assert ResonancePeak().of(response).value == pytest.approx(peak, rel=2e-3)
    assert ResonanceFrequency().of(response).value == pytest.approx(place, rel=5e-3)


def test_no_resonance_is_said():
    response = measured(1 / (S * (S + 2)), GRID)
    with pytest.raises(NotScored, match="no resonance"):
        ResonanceFrequency().of(response)
    assert ResonancePeak().of(response).value == pytest.approx(1.0, abs=2e-3)


def test_noise_around_zero_is_no_crossover():
    values = np.array([-1.0, -0.5, 0.01, -0.01, 0.02, 0.6, 1.0, -1.0])
    assert sign_changes(values, np.full(8, 0.05)).tolist() == [2, 7]
    assert sign_changes(values, np.zeros(8)).tolist() == [2, 3, 4, 7]


@pytest.mark.parametrize(("sizes", "counts"), [(1.9, False), (2.1, True)])
def test_two_standard_deviations_are_a_sign(sizes, counts):
    values = np.array([-1.0, -1.0, 0.05 * sizes])
    assert sign_changes(values, np.full(3, 0.05)).tolist() == ([2] if counts else [])


def test_margins_need_the_channel_that_the_reference_asks_for(kit):
    class Periodic(kit.Steps):
        edges = ()

        @property
        def lines(self):
            return (Lines(0.0, 2.0, 1.0, (1, 3)),)

    recording, _ = kit.step(lambda t: 1 - np.exp(-t), hold=2.0)
    signal = Periodic((0.0,), (0.0, 1.0), 2.0)
    other = recording.with_values({"current": recording[kit.channel]})
    found = kit.measure("phase_margin", other, kit.trial(signal, 2.0), "current")
    assert "not what the reference asks for" in found.reason


def test_the_margin_nearest_to_instability_counts():
    metric = GainMargin()
    assert metric.distance(1.5) < metric.distance(3.0)
    assert [metric.counts(value) for value in (1.0, 1.01, math.inf, 0.5)] == [
        False, True, False, False,
    ]  # fmt: skip
