"""Where a cause meets a limit: known answers, from curves that stand in for the simulator."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from eha_bench.causes.cause import causes_of
from eha_bench.causes.correction import Metered, correction_of
from eha_bench.causes.limits import CauseLimits
from eha_bench.plants.model import load_model
from eha_bench.suites import load_suite
from eha_bench.sweeps.case import Case

SUITE = """\
name: nightly
trials:
  - id: steps
    mode: pressure
    setup: {piston: locked}
    duration: 1 s
    signal: {kind: step, final: 10 MPa, at: 50 ms}
    accept: {response_time: <= 50 ms, holding_current: 15 A .. 20 A}
"""


class Curves:
    """Metrics that are known for every vector, as if they were simulated already."""

    def __init__(self, place, response, current=lambda _: 18.0):
        self.place, self.response, self.current, self.asked = place, response, current, []

    def metrics(self, key):
        leak = json.loads(key.rsplit("\0", 1)[1])[self.place]
        self.asked.append(leak)
        return {
            "steps.response_time": self.response(leak),
            "steps.holding_current": self.current(leak),
        }


def interval(found):
    """Return the 95 % interval of where a limit is met."""
    return np.quantile(found.drawn, [0.025, 0.975], method="inverted_cdf")


@pytest.fixture
def leak(tmp_path):
    """Return a function: curves -> limits of a machine without a leak, and the leak as a cause."""
    (tmp_path / "suite.yaml").write_text(SUITE, encoding="utf-8")
    (tmp_path / "model.yaml").write_text("model: eha_knee\ncalibrate: [leakage]\n", "utf-8")
    suite, model = load_suite(tmp_path / "suite.yaml"), load_model(tmp_path / "model.yaml")
    cause = replace(causes_of(model, ["leakage"])[0], low=0.0, high=1.0, step=0.01)
    healthy = model.vector()
    healthy[cause.place] = 0.0

    def made(response, metered=None, **others):
        curves = Curves(cause.place, response, **others)
        case = Case(suite, None)  # nothing is simulated
        return CauseLimits(case, model, healthy, metered or {}, curves), cause, curves

    return made


def test_a_curved_metric_meets_its_limit_where_it_does(leak):
    limits, cause, _ = leak(lambda size: 0.04 + size**2)
    found = limits.first(cause, np.full(9, np.nan), 1.0)
    # 0.04 + x^2 = 0.05, by a line between places a factor of the root of two apart
    assert found.value == pytest.approx(0.1, rel=0.02)
    assert (found.metric, found.limit) == ("response_time", "<= 50 ms")


@pytest.mark.slow
@pytest.mark.parametrize("size", [2e-4, 1e-3])
def test_a_rough_metric_is_no_surer_than_its_roughness(leak, size):
    held, many = 0, 30
    for seed in range(many):
        jag = np.random.default_rng(seed).normal(0.0, size, 40)
        seen = {}

        def response(at, jag=jag, seen=seen):
            return 0.04 + 0.1 * at + seen.setdefault(at, jag[len(seen)])

        limits, cause, _ = leak(response)
        found = limits.first(cause, np.full(9, np.nan), 1.0)
        low, high = interval(found) if found is not None else (math.nan, math.nan)
        held += low < 0.1 < high
    assert held >= 0.9 * many


def test_a_metric_that_is_wild_at_one_place_has_hardly_met_its_limit(leak):
    def response(size):
        return 0.052 if 0.009 < size < 0.011 else 0.04 + 0.1 * size

    limits, cause, curves = leak(response)
    found = limits.first(cause, np.full(9, np.nan), 1.0)
    assert any(0.009 < place < 0.011 for place in curves.asked)
    assert found.value == pytest.approx(0.1, rel=0.03)
    assert np.mean(found.drawn < 0.05) < 0.25


def test_a_metric_that_grazes_its_limit_has_met_it_in_as_many_draws_as_it_may(leak):
    nights = np.zeros(12)
    metered = {"steps.response_time": Metered(0.04 + 0.001 * np.resize([-1.0, 0.0, 1.0], 12), 12)}

    def response(size):  # 0.04 at none, 0.05 at 0.1, 0.06 at 1
        return (
            0.04
            + 0.01 * math.exp(-(((math.log10(size + 1e-12) + 1.0) / 0.3) ** 2))
            + (0.02 * max(0.0, size - 0.5))
        )

    limits, cause, _ = leak(response, metered)
    found = limits.first(cause, nights, 1.0)
    grazed = np.mean(found.drawn < 0.3)
    assert 0.35 < grazed < 0.65
    low, high = interval(found)
    assert low < 0.1
    assert high > 0.9


def test_two_limits_that_lie_close_come_sooner_than_each(leak):
    apart = 0.001 * np.resize([-1.0, 0.0, 1.0], 12)
    metered = {
        "steps.response_time": Metered(0.04 + apart, 12),
        "steps.holding_current": Metered(18.0 + 200.0 * apart, 12),
    }
    limits, cause, _ = leak(
        lambda size: 0.04 + 0.1 * size, metered, current=lambda size: 18.0 + 20.0 * size
    )
    found = limits.first(cause, np.zeros(12), 1.0)
    assert 0.08 < found.value < 0.098


def test_the_first_of_two_limits_is_the_one(leak):
    limits, cause, _ = leak(lambda size: 0.04 + 0.1 * size, current=lambda size: 18.0 + 40.0 * size)
    found = limits.first(cause, np.full(9, np.nan), 1.0)
    assert found.metric == "holding_current"
    assert found.value == pytest.approx(0.05, rel=1e-3)


def test_a_metric_that_can_no_longer_be_scored_is_a_limit(leak):
    limits, cause, _ = leak(lambda size: 0.04 if size < 0.06 else math.nan)
    found = limits.first(cause, np.full(9, np.nan), 1.0)
    low, high = interval(found)
    assert low < 0.06 < high < low + 0.03


def test_what_meets_no_limit_within_its_bounds_meets_none(leak):
    limits, cause, _ = leak(lambda size: 0.04 + 0.001 * size)
    assert limits.first(cause, np.full(9, np.nan), 1.0) is None


def test_the_measured_metric_meets_it_and_not_the_simulated_one(leak):
    nights = np.linspace(0.0, 0.02, 12)
    metered = {"steps.response_time": Metered(0.042 + 0.1 * nights, 8)}
    limits, cause, _ = leak(lambda size: 0.04 + 0.1 * size, metered)
    found = limits.first(cause, nights, 1.0)
    assert found.value == pytest.approx(0.08, rel=0.01)
    # 8 % of what it changes by, and a third of what the model is off by, over its slope
    expected = math.hypot(0.08 * 0.008, 0.002 / 3.0) / 0.1
    low, high = interval(found)
    assert high - low == pytest.approx(2.0 * 1.96 * expected, rel=0.05)


def test_a_wild_night_moves_no_correction():
    simulated = np.full(15, 1.0)
    values = simulated + 0.1 + 0.01 * np.resize([-1.0, 0.0, 1.0], 15)
    calm = correction_of(Metered(values, 8), simulated, 1.0)
    values[4] = 50.0
    wild = correction_of(Metered(values, 8), simulated, 1.0)
    assert wild.measured_metric(2.0) == pytest.approx(calm.measured_metric(2.0), abs=0.01)
    assert wild.spread < 2.0 * calm.spread


def test_a_spread_of_few_nights_is_itself_not_known():
    generator = np.random.default_rng(3)
    held, many = 0, 400
    for _ in range(many):
        values = 1.0 + 0.1 * generator.standard_normal(12)
        found = correction_of(Metered(values, 12), np.ones(12), 1.0)
        drawn = found.metric_draws(np.ones(1), np.zeros(1), generator, 2000)
        low, high = np.quantile(drawn, [0.025, 0.975])
        held += low < 1.0 + 0.1 * generator.standard_normal() < high
    assert 0.92 < held / many < 0.99


def test_nights_without_the_metric_leave_its_healthy_level():
    found = correction_of(Metered(np.array([1.2]), 1), np.full(5, np.nan), 1.0)
    assert found.measured_metric(3.0) == pytest.approx(3.2)
