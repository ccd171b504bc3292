"""Packages of extras that the lock has: a test without one is skipped, but fails in CI."""

from __future__ import annotations

import importlib
import os
from types import ModuleType

import pytest


def in_ci() -> bool:
    """Whether a continuous-integration job is running the tests."""
    return os.environ.get("CI", "").lower() in {"1", "true", "yes"}


def locked(module: str, extra: str) -> ModuleType:
    """Return a module that an extra brings; without it the test is skipped, in CI it fails."""
    if in_ci():
        return importlib.import_module(module)
    return pytest.importorskip(module, reason=f"not installed: pip install 'eha-bench[{extra}]'")
