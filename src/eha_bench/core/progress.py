"""How long work reports its progress."""

from __future__ import annotations

from collections.abc import Callable

ProgressHook = Callable[[str, float], None]
"""A function that is called with the present stage, in words, and the share done, 0 to 1."""
