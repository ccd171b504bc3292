"""The rig's own log: what happened to the torque, and when, by the rig's own clock."""

from __future__ import annotations

import json
from pathlib import Path
from typing import IO


class RigLog:
    """JSON lines, each written at once; `t` is s on the drive's clock."""

    def __init__(self, path: Path | None) -> None:
        """Begin a new log, or keep none."""
        self._stream: IO[str] | None = None
        if path is not None:
            self._stream = path.open("w", encoding="utf-8")

    def write(self, t: float, event: str, **facts: object) -> None:
        """Note an event."""
        if self._stream is not None:
            self._stream.write(json.dumps({"t": round(t, 6), "event": event, **facts}) + "\n")
            self._stream.flush()

    def close(self) -> None:
        """Close the file."""
        if self._stream is not None:
            self._stream.close()
