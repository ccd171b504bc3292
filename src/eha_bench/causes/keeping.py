"""What is kept of every night next to the history, so that only new nights are estimated."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from eha_bench.causes.evidence import NightEvidence, Reference
from eha_bench.core.atomic_file import write_text
from eha_bench.core.finite import finite_or_none

FOLDER: Final = "causes"
_T = TypeVar("_T")


class Kept:
    """Estimates by what they were made of, one JSON file each."""

    def __init__(self, site: Path, digest: str) -> None:
        self._folder = site / FOLDER
        self._digest = digest

    def evidence(self, made_of: str) -> NightEvidence | None:
        """Return a night's evidence, if it is kept and can be read."""
        return self._read("night", made_of, NightEvidence.from_dict)

    def keep_evidence(self, made_of: str, found: NightEvidence) -> None:
        """Keep a night's evidence."""
        self._write("night", made_of, found.to_dict())

    def reference(self, made_of: str) -> Reference | None:
        """Return the machine as it was first, if it is kept and can be read."""
        return self._read("healthy", made_of, _reference)

    def keep_reference(self, made_of: str, found: Reference) -> None:
        """Keep the machine as it was first."""
        self._write(
            "healthy",
            made_of,
            {
                "vector": found.vector.tolist(), "noise": dict(found.noise),
                "soft": found.soft, "level": found.level, "differences": dict(found.differences),
            },
        )  # fmt: skip

    def metrics(self, made_of: str) -> Mapping[str, float] | None:
        """Return the metrics of a simulated suite, if they are kept and can be read."""
        return self._read("suite", made_of, _metrics)

    def keep_metrics(self, made_of: str, values: Mapping[str, float]) -> None:
        """Keep the metrics of a simulated suite."""
        known = {name: finite_or_none(value) for name, value in values.items()}
        self._write("suite", made_of, known)

    def _path(self, kind: str, made_of: str) -> Path:
        digest = hashlib.sha256(f"{self._digest}\0{made_of}".encode()).hexdigest()
        return self._folder / f"{kind}-{digest[:32]}.json"

    def _read(self, kind: str, made_of: str, made: Callable[[Mapping[str, Any]], _T]) -> _T | None:
        try:
            text = self._path(kind, made_of).read_text(encoding="utf-8")
            return made(json.loads(text))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None  # it is estimated again

    def _write(self, kind: str, made_of: str, content: Mapping[str, Any]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(content, ensure_ascii=False, allow_nan=False)
        write_text(self._path(kind, made_of), text + "\n")


def _metrics(data: Mapping[str, Any]) -> dict[str, float]:
    return {str(key): math.nan if value is None else float(value) for key, value in data.items()}


def _reference(data: Mapping[str, Any]) -> Reference:
    return Reference(
        np.array(data["vector"], dtype=np.float64),
        {str(key): float(value) for key, value in data["noise"].items()},
        float(data["soft"]),
        float(data["level"]),
        {str(key): float(value) for key, value in data["differences"].items()},
    )
