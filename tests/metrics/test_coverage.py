"""A small run of the coverage benchmark: 95 % intervals hold the truth as often as they say."""

import importlib.util
import sys
from dataclasses import replace

import pytest
from scipy.stats import binom


@pytest.fixture(scope="module")
def coverage(repository):
    path = repository / "benchmarks" / "coverage.py"
    specification = importlib.util.spec_from_file_location("coverage_benchmark", path)
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["steps", "sines", "multisines"])
@pytest.mark.parametrize("level", [0, 1])
def test_intervals_hold_the_truth(coverage, kind, level):
    noise = coverage.Noise("white", coverage.WHITE[kind][level])
    for line in coverage.cover(coverage.MAKERS[kind], noise, 300, 11):
        # The benchmark itself holds 93 to 97 %; here 300 recordings may not refute it. From below
        # the bound is the sharper one: an interval that promises too much is the worse fault.
        held = round(line.coverage * line.scored)
        assert line.coverage >= 0.90, line
        assert binom.sf(held - 1, line.scored, 0.97) > 1e-3, line
        assert line.scored >= 0.9 * line.recordings or line.metric == "peak_time", line


def test_truths_are_right_without_noise(coverage):
    silent = coverage.Noise("none", 0.0)
    for make in coverage.MAKERS.values():
        for recording, trial, truths, _ in make(3, 1):
            for name, truth in truths.items():
                found = coverage.measure_safely(
                    coverage.metric(name), recording, trial, coverage.CHANNEL
                )
                assert found.value == pytest.approx(truth, rel=3e-3), (name, found)
    assert silent.level == 0.0


@pytest.mark.slow
def test_few_samples_a_rise_cost_width_and_not_coverage(coverage):
    cases = {case.name: case for case in coverage.CASES}
    (line,) = coverage.cover_case(cases["4-8 a rise"], 250, 5)[1:]
    assert line.metric == "delay_time"
    assert line.coverage >= 0.90, line


@pytest.mark.slow
@pytest.mark.parametrize("name", ["1-2 a rise 0.5 %", "2-3 a rise 0.3 %"])
def test_settling_in_few_samples_is_held(coverage, name):
    """One excursion more, and what lies between the last two samples, is in the interval."""
    (case,) = (case for case in coverage.CASES if case.name == name)
    (line,) = coverage.cover_case(replace(case, metrics=("settling_time",)), 300, 6)
    assert line.coverage >= 0.92, line  # 91 % before, standard error 1.5 %
    assert line.refused <= 0.02, line
