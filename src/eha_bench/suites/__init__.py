"""YAML becomes suites: signals, matrices and acceptance limits, checked and in SI."""

from typing import TYPE_CHECKING

from eha_bench.core.lazy import lazy_names

if TYPE_CHECKING:
    from eha_bench.suites.load import load_suite
    from eha_bench.suites.suite import Suite
    from eha_bench.suites.trial_source import trial_from_source

__all__ = ["Suite", "load_suite", "trial_from_source"]

__getattr__ = lazy_names(
    __name__,
    {
        "Suite": "eha_bench.suites.suite",
        "load_suite": "eha_bench.suites.load",
        "trial_from_source": "eha_bench.suites.trial_source",
    },
)
