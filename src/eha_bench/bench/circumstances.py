"""When recordings were made and how warm the oil was, as a result's provenance says it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from eha_bench.core.moment import seconds_of
from eha_bench.core.recording import Recording

_SANE = datetime(1990, 1, 1, tzinfo=UTC).timestamp()


@dataclass
class Circumstances:
    """Collects from one recording after another; keeps no recording."""

    _instants: list[float] = field(default_factory=list)
    _temperatures: list[float] = field(default_factory=list)

    def add(self, recording: Recording) -> None:
        """Take what a recording says: when its run started, else its own clock; its oil."""
        instant = seconds_of(recording.metadata.get("started", ""))
        if math.isnan(instant) and recording.epoch_ns / 1e9 > _SANE:
            instant = recording.epoch_ns / 1e9
        if not math.isnan(instant):
            self._instants.append(instant)
        logged = recording.values.get("oil_temperature")
        if logged is not None and np.isfinite(logged).any():
            self._temperatures.append(float(np.nanmean(logged)))

    def recording_time(self) -> dict[str, str]:
        """Return `recorded`, the earliest instant as ISO 8601 in UTC; empty where unknown."""
        if not self._instants:
            return {}
        first = datetime.fromtimestamp(min(self._instants), UTC)
        return {"recorded": first.isoformat(timespec="seconds")}

    def oil(self) -> dict[str, str]:
        """Return `oil_temperature`, the mean over the recordings in K; empty where none has it."""
        if not self._temperatures:
            return {}
        mean = math.fsum(self._temperatures) / len(self._temperatures)
        return {"oil_temperature": f"{mean:.2f}"}
