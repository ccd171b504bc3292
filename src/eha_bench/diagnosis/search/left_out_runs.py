"""Takes up again the runs of which a calibrated model explains nothing.

A valve that opens in one run of five may be all of what happens there. Calibrated on all of them,
the parameters bend to that run, and what is missing is found no more; so the search begins with the
parameters that the other runs gave.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eha_bench.core.progress import ProgressHook
from eha_bench.diagnosis.fit.baseline import Baseline, calibrated_baseline
from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, excess
from eha_bench.diagnosis.fit.least_squares import levenberg_marquardt
from eha_bench.diagnosis.fit.outlier_runs import outlier_runs
from eha_bench.diagnosis.fit.problem import soften
from eha_bench.diagnosis.search.state import Search, begin


def search_in_all_runs(
    base: Baseline, search: Search, progress: ProgressHook
) -> tuple[Baseline, Search]:
    """Return a calibration on all runs, and a search in them from what the others gave.

    Args:
        base: with runs left out. search: finished there, nothing found.
        progress: called with the stage and the fraction of it done.
    """
    whole = calibrated_baseline(base.dataset, progress, kept=base.left_out)
    found = begin(whole, search.thresholds)
    problem, vector = whole.problem, whole.fit.vector.copy()
    others = search.problem.places.index
    # nothing is added yet in all runs
    added = {key for item in search.accepted for key in item.start.keys}
    for key, place in problem.places.index.items():
        if key in others and key not in added:
            vector[place] = search.fit.vector[others[key]]
    problem.prepare(vector)
    problem.scale_to(problem.residual(vector))
    fit = levenberg_marquardt(problem, vector, whole.fit.free, iterations=0)
    left = excess(problem, fit)
    return whole, replace(
        found, base=fit, fit=fit, declared_vector=vector, excess_base=left, excess_left=left
    )


def explains_all_runs(search: Search, base: Baseline) -> bool:
    """Whether a finished search explains something of every run, and of the others no less.

    Args:
        search: in all runs. base: with runs left out, of whose others nothing is missing.
    """
    if outlier_runs(search.problem, [search.fit.residual]):
        return False
    problem, residual = search.problem, search.fit.residual
    others = [
        residual[piece.rows]
        for piece in problem.pieces
        if problem.windows[piece.window].measured.run.name not in base.left_out
    ]
    cost = SOFT_MEAN * sum(item.size for item in others)
    left = sum(float(np.sum(soften(item)[0] ** 2)) for item in others)
    return left < (1.0 + search.thresholds.bursts) * cost
