"""Whether what a fit leaves of a channel swings, as noise does not.

Means of blocks tell an error that is slow. A resonance that a model lacks (a soft gear, a shaft)
leaves an error that swings: over any block its mean is nothing. Its power stands at one frequency,
where that of white noise of the same size is the same at all. The mean of B blocks' periodograms
scatters by B^(-1/2) of itself (Bartlett, Biometrika 37 (1950) 1, doi:10.2307/2332141).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eha_bench.core.arrays import FloatArray

LOUD = 1.2
"""Mean square, in the noise's, from which a channel is asked: what is less is a colour of noise."""
_LENGTHS = (32, 128)
_FEWEST = 8
"""Least number of blocks: of fewer, chance makes peaks."""


def oscillation(parts: Sequence[FloatArray]) -> float:
    """Return how surely a channel's residual swings, in standard deviations; 0 where it is small.

    Args:
        parts: of it, each (n,) of samples that follow one another, in the noise.
    """
    size = sum(part.size for part in parts)
    square = sum(float(part @ part) for part in parts) / max(size, 1)
    if square < LOUD:
        return 0.0
    surest = 0.0
    for length in _LENGTHS:
        whole = [part[: part.size // length * length].reshape(-1, length) for part in parts]
        blocks = np.concatenate(whole) if whole else np.zeros((0, length))
        if len(blocks) < _FEWEST:
            continue
        power = np.mean(np.abs(np.fft.rfft(blocks, axis=1)) ** 2, axis=0) / (length * square)
        # of no frequency and of the highest there is one number, not two
        above = float(np.max(power[1:-1])) - 1.0
        surest = max(surest, above * float(np.sqrt(len(blocks))))
    return surest
