"""What a transient that decays still adds to the settled periods of a tone.

After a change of the command a linear system rings with its own poles: from period to period what
that adds to the phasor falls by the same complex factor,

    phi_k = phi + c l^k,    phi_{k+1} - phi_k = c (l - 1) l^k.

Near a resonance its spectrum peaks under the tone itself, where the lines between the harmonics
hardly show it; the periods that are left out at the start show it far above their noise (R. Prony's
method; S. L. Marple, Digital Spectral Analysis, 1987, chapter 11).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eha_bench.core.arrays import ComplexArray

_SEEN = 4.0  # times the scatter of later periods: what the first change must be
_SLOWEST = 0.8  # of a period's transient that the next has; more is no matter of few periods
_KNOWN = 0.3  # of the transient: what one pole leaves of it, among others
_FEWEST = 4  # periods


@dataclass(frozen=True)
class Ringing:
    """A transient's phasor over the settled periods, and the standard deviation of each part."""

    phasor: complex = 0j
    sd: float = 0.0


def ringing(phasors: ComplexArray, settled: int) -> Ringing:
    """Return what rings on in the last `settled` of (n,) periods' phasors, in order of time.

    The first period is not used: a delay may end within it. Where no decay is seen beyond the
    noise, none is returned.
    """
    if phasors.size < _FEWEST or settled >= phasors.size:
        return Ringing()
    changes = np.diff(phasors[1:])
    first = abs(changes[0])
    scatter = float(np.median(np.abs(changes[changes.size // 2 :])))
    if not first > _SEEN * scatter > 0.0:
        return Ringing()
    factor = np.sum(changes[1:] * changes[:-1].conj()) / np.sum(np.abs(changes[:-1]) ** 2)
    if not abs(factor) < _SLOWEST:
        return Ringing()
    periods = np.arange(phasors.size - settled, phasors.size) - 1.0
    left = changes[0] / (factor - 1.0) * np.mean(factor**periods)
    # what the noise of the factor makes of its power
    known = _KNOWN + float(periods[0]) * scatter / first / max(abs(factor), 1e-3)
    return Ringing(complex(left), min(known, 1.0) * abs(left))
