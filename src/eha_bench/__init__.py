"""eha_bench: test, score and understand electro-hydrostatic actuators.

The names here are the public Python face; each is imported when first used, so that
`import eha_bench` stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eha_bench.api import (
        diagnose,
        next_experiment,
        probability,
        run,
        score_files,
        sweep,
        tune,
    )
    from eha_bench.comparison_api import ab, compare, history
    from eha_bench.core.recording import Recording
    from eha_bench.core.result import Result
    from eha_bench.diagnosis.calibrate import calibrate
    from eha_bench.diagnosis.replay.prediction import predict
    from eha_bench.metrics import score
    from eha_bench.recordings import read, write
    from eha_bench.suites import load_suite

__version__ = "0.1.0"

_HOME = {
    "Recording": "eha_bench.core.recording",
    "read": "eha_bench.recordings",
    "write": "eha_bench.recordings",
    "calibrate": "eha_bench.diagnosis.calibrate",
    "diagnose": "eha_bench.api",
    "ab": "eha_bench.comparison_api",
    "compare": "eha_bench.comparison_api",
    "history": "eha_bench.comparison_api",
    "predict": "eha_bench.diagnosis.replay.prediction",
    "load_suite": "eha_bench.suites",
    "next_experiment": "eha_bench.api",
    "Result": "eha_bench.core.result",
    "run": "eha_bench.api",
    "score_files": "eha_bench.api",
    "probability": "eha_bench.api",
    "sweep": "eha_bench.api",
    "tune": "eha_bench.api",
    "score": "eha_bench.metrics",
}

__all__ = [
    "Recording",
    "Result",
    "__version__",
    "ab",
    "calibrate",
    "compare",
    "diagnose",
    "history",
    "load_suite",
    "next_experiment",
    "predict",
    "probability",
    "read",
    "run",
    "score",
    "score_files",
    "sweep",
    "tune",
    "write",
]


def __getattr__(name: str) -> Any:
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module 'eha_bench' has no attribute '{name}'")
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    """Return the public names, those not imported yet included: completion shows them."""
    return sorted(__all__)
