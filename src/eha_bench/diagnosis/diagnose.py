"""`diagnose`: the whole way from a dataset to a verdict and a revised model."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.interruption import Interruption, checkpoints
from eha_bench.core.output_folder import spare_inputs, writable
from eha_bench.core.progress import ProgressHook, live_progress
from eha_bench.core.workers import IN_PROCESS, Workers
from eha_bench.diagnosis.conclusion import Conclusion
from eha_bench.diagnosis.data.dataset import Dataset, load_dataset
from eha_bench.diagnosis.ended_runs import baseline_up_to_jumps
from eha_bench.diagnosis.fit.baseline import CalibrationInterrupted, no_progress
from eha_bench.diagnosis.fit.effort import count_simulated_time
from eha_bench.diagnosis.fit.side_by_side import fits_by, one_thread_of_algebra
from eha_bench.diagnosis.fit.thresholds import DEFAULT, Thresholds
from eha_bench.diagnosis.outcome.diagnosis import WRITTEN, Diagnosis
from eha_bench.diagnosis.points import diagnose_points
from eha_bench.plants.static_plant import StaticPlant


def diagnose(
    dataset: Dataset | str | Path | Mapping[str, Any],
    out: str | Path | None = None,
    progress: ProgressHook = no_progress,
    workers: Workers = IN_PROCESS,
    thresholds: Thresholds = DEFAULT,
) -> Diagnosis:
    """Close the loop: residual, cause, revised model, errors before and after.

    Runs for holdout are read only when everything is decided. Ctrl-C ends the search and keeps what
    was found until then (`complete` is False); pressed again it leaves the errors out.

    Args:
        dataset: dataset.yaml, a dict of what it would hold, or as loaded.
        out: folder that gets diagnosis.json, revised.yaml and recalibrated.yaml.
        progress: called with the stage and the fraction of it done, every second or two.
        workers: do the fits that are independent; this process does so on threads.
        thresholds: of the verdict.

    Raises:
        InputError: a file is wrong or missing, nothing can be compared, or `out` cannot be used.
        WorkError: a worker could not do what it was given.
    """
    started = time.perf_counter()
    loaded = dataset if isinstance(dataset, Dataset) else load_dataset(dataset)
    if out is not None:
        folder = writable(Path(out))
        spare_inputs((folder / name for name in WRITTEN), loaded.files)
    if isinstance(loaded.model.plant, StaticPlant):
        found = replace(diagnose_points(loaded, progress), seconds=time.perf_counter() - started)
        found.keep(out)
        return found
    with (
        one_thread_of_algebra(),
        Interruption() as asked,
        count_simulated_time() as spent,
        live_progress(progress) as live,
    ):
        live("calibrate", 0.0)
        try:
            with checkpoints(asked), fits_by(workers):
                base, interrupted = baseline_up_to_jumps(loaded, live), False
        except CalibrationInterrupted as stop:
            base, interrupted = stop.baseline, True
        conclusion = Conclusion(base.dataset, base, out, live, thresholds)
        conclusion.keep(complete=False)
        try:
            found = conclusion.interrupted() if interrupted else conclusion.whole(asked, workers)
        except Exception as error:
            found = conclusion.failed(error)
            if isinstance(error, EhaBenchError):
                replace(found, seconds=time.perf_counter() - started).keep(out)
                raise
    found = replace(
        found,
        seconds=time.perf_counter() - started,
        # exactly, as threads end in any order
        simulations=math.fsum(spent) / sum(float(item.time[-1]) for item in base.measured),
    )
    found.keep(out)
    progress("done", 1.0)
    return found
