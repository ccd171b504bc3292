"""`--max-memory` and `--max-time`: what reading a recording may take."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer

MaxMemory = Annotated[
    str | None,
    typer.Option(
        "--max-memory",
        help="Memory that reading a file may take, e.g. 8GB (default: by the size of the file).",
    ),
]
MaxTime = Annotated[
    str | None,
    typer.Option(
        "--max-time",
        help="Processor time that reading a file may take, e.g. 60s (default: by its size).",
    ),
]

_SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([kMGT]?)(i?)B?\s*")
_POWERS = {"": 0, "k": 1, "M": 2, "G": 3, "T": 4}


@contextmanager
def reading_limits(memory: str | None, seconds: str | None) -> Iterator[None]:
    """Allow every recording that is read in this context so much.

    Raises:
        InputError: a size or a time is not one.
    """
    from eha_bench.core.units import positive
    from eha_bench.recordings.budget import reading_budget

    time = None if seconds is None else positive("--max-time", seconds, "s")
    with reading_budget(None if memory is None else _bytes(memory), time):
        yield


def _bytes(text: str) -> int:
    from eha_bench.core.errors import InputError

    match = _SIZE.fullmatch(text)
    size = int(float(match[1]) * (1024 if match[3] else 1000) ** _POWERS[match[2]]) if match else 0
    if not 0 < size < 2**62:
        raise InputError(f"--max-memory '{text}' is not a size", hint="write it as 500MB or 8GB")
    return size
