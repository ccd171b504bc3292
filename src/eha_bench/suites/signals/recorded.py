"""The reference as a foreign log holds it."""

from __future__ import annotations

from typing import Literal

from eha_bench.core.signal import FromRecording
from eha_bench.suites.signals.signal_model import SignalModel


class Recorded(SignalModel, FromRecording):
    """Whatever the recording's `reference` channel did: its jumps, or its sine.

    For scoring logs whose commands no suite describes; it cannot be run.
    """

    kind: Literal["recorded"]
