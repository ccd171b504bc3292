"""Finding a known signal in a recording that goes on before and after it."""

import numpy as np
import pytest

from eha_bench.metrics.search import best_lag

PERIOD = 1e-3


def chirp(time):
    held = np.clip(np.asarray(time, dtype=np.float64), 0.0, 2.0)
    return np.sin(2 * np.pi * (2.0 + 1.5 * held) * held)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5])
def test_what_moves_outside_of_the_signal_does_not_move_its_start(share):
    """Only where the signal lasts are the samples compared with it, to a part of a sample."""
    time = np.arange(6000) * PERIOD
    start = 2.0 + share * PERIOD
    since = time - start
    inside = (since >= 0.0) & (since < 2.0)
    sampled = np.where(inside, chirp(since), 3.0 * np.sin(2 * np.pi * 3.1 * time))
    found, likeness = best_lag(time, sampled, chirp, 2.0, PERIOD)
    assert found == pytest.approx(start, abs=0.02 * PERIOD)
    assert likeness > 0.99


def test_a_signal_of_few_samples_is_found_to_a_sample():
    time = np.arange(200) * PERIOD
    sampled = np.zeros(200)
    sampled[100:106] = (0.0, 1.0, 2.0, 3.0, 2.0, 1.0)

    def signal(at):
        return np.interp(at, np.arange(6) * PERIOD, (0.0, 1.0, 2.0, 3.0, 2.0, 1.0))

    found, _ = best_lag(time, sampled, signal, 6 * PERIOD, PERIOD)
    assert found == pytest.approx(0.1, abs=PERIOD)
