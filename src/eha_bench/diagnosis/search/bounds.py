"""Whether what was fitted stands at a bound: it is refused in the end, however much it explains."""

from __future__ import annotations

from collections.abc import Sequence

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.fit.candidates import Start
from eha_bench.diagnosis.search.state import Search


def are_inside(search: Search, starts: Sequence[Start], vector: FloatArray) -> bool:
    """Return whether candidates stand at no bound of theirs, nor of the recordings."""
    places = search.problem.places
    return all(
        start.bound_met(vector) is None and places.bound_met(start.keys, vector) is None
        for start in starts
    )
