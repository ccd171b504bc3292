"""Intermediate results shared by metrics: one step analysis serves ten of them."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from eha_bench.core.recording import Recording
from eha_bench.core.trial import Trial
from eha_bench.metrics.metric import NotScored

T = TypeVar("T")

# Recordings hold mappings and cannot be hashed, so the identity is the key; it is forgotten
# together with the recording, and the trial is kept so that its identity cannot be reused before.
_stores: dict[int, dict[Hashable, tuple[Trial, Any]]] = {}


def remembered(recording: Recording, trial: Trial, key: Hashable, compute: Callable[[], T]) -> T:
    """Return `compute()`, or what it returned (or raised as NotScored) for this pair and key."""
    identity = id(recording)
    if identity not in _stores:
        _stores[identity] = {}
        weakref.finalize(recording, _stores.pop, identity, None)
    store = _stores[identity]
    full_key = (id(trial), key)
    if full_key not in store:
        try:
            found: Any = compute()
        except NotScored as reason:
            found = reason
        store[full_key] = (trial, found)
    result = store[full_key][1]
    if isinstance(result, NotScored):
        raise type(result)(result.reason)
    kept: T = result
    return kept
