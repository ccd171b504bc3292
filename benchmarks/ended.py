"""A dataset whose recordings end early: small versions of benchmarks diagnose these."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml


def ended(path: Path, until: str) -> dict[str, Any]:
    """Return what a dataset's file holds, with its recordings up to a time such as "8 s"."""
    content: dict[str, Any] = yaml.safe_load(path.read_text())
    for part in (content, *content["runs"]):
        for key in ("model", "channels", "log"):
            if key in part:
                part[key] = str(path.parent / part[key])
    for run in content["runs"]:
        run["to"] = until
    return content
