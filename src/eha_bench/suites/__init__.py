"""YAML becomes suites: signals, matrices and acceptance limits, checked and in SI."""

from eha_bench.suites.load import load_suite
from eha_bench.suites.suite import Suite
from eha_bench.suites.trial_source import trial_from_source

__all__ = ["Suite", "load_suite", "trial_from_source"]
