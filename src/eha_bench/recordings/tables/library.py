"""Reading with a third-party library: its errors become a sentence, its time is limited."""

from __future__ import annotations

import io
import logging
import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

from eha_bench.core.errors import EhaBenchError, Place, RecordingError
from eha_bench.core.extras import way_to_install
from eha_bench.recordings.budget import budget


@contextmanager
def reading_with(library: str, extra: str, path: str) -> Iterator[None]:
    """Run a library on a file that is not trusted.

    Args:
        library: its name, for messages.
        extra: the extra of eha-bench that installs it.
        path: the file.

    Raises:
        RecordingError: the library is not installed, or cannot read the file.
        OverBudget: it takes longer than the file may take.
    """
    try:
        with _quiet(library), _in_time():
            yield
    except (EhaBenchError, MemoryError):
        raise
    except ImportError as error:
        raise _missing(library, extra, path, error) from error
    except Exception as error:  # a library meets what its authors never thought of
        raise RecordingError(
            f"the file is damaged, or {library} does not read its kind ({_reason(error)})",
            where=Place(file=path),
            hint="record or export it again",
        ) from error


@contextmanager
def writing_with(library: str, extra: str, path: str) -> Iterator[None]:
    """Run a library that writes a file of ours; an OSError is that of the disk.

    Raises:
        RecordingError: the library is not installed, or cannot write what it is given.
        OSError: the file cannot be written.
    """
    try:
        with _quiet(library):
            yield
    except (EhaBenchError, MemoryError, OSError):
        raise
    except ImportError as error:
        raise _missing(library, extra, path, error) from error
    except Exception as error:  # as above
        raise RecordingError(
            f"{library} cannot write it ({_reason(error)})",
            where=Place(file=path),
            hint="export it to .parquet",
        ) from error


@contextmanager
def _quiet(library: str) -> Iterator[None]:
    """Keep what a library logs, prints and warns of to itself."""
    chatty = logging.getLogger(library.lower())
    level = chatty.level
    chatty.setLevel(logging.CRITICAL)
    try:
        with redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        chatty.setLevel(level)


def _missing(library: str, extra: str, path: str, error: ImportError) -> RecordingError:
    return RecordingError(
        f"this kind of file needs {library} ({error})",
        where=Place(file=path),
        hint=way_to_install(extra),
    )


def _reason(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


@contextmanager
def _in_time() -> Iterator[None]:
    """Interrupt what loops: a timer of processor time, where nothing else uses it."""
    allowed = budget()
    free = (
        threading.current_thread() is threading.main_thread()
        and hasattr(signal, "SIGPROF")
        and signal.getsignal(signal.SIGPROF) is signal.SIG_DFL
    )
    if not free:
        yield
        return

    def look(*_: object) -> None:
        allowed.tick()

    signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, _EVERY, _EVERY)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)


_EVERY = 0.25
"""Seconds of processor time between two looks."""
