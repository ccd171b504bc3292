"""What the command line says to people: on standard error, without tracebacks."""

from __future__ import annotations

import errno
import logging
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import NoReturn

from eha_bench.core.errors import BUG, EhaBenchError

INTERRUPTED = 130

_NEAR = 20
"""Letters on either side of one that cannot be written which tell where it is."""


_SECONDS_A_LINE = 30.0
"""Time between two lines of progress where there is no terminal."""
_MOST = 5
"""Mistakes of one input that are listed before the rest is counted."""

_NO_ROOM = "; make room, or name a folder on another disk"
_WAYS_OUT = {
    errno.ENOSPC: _NO_ROOM,
    errno.EDQUOT: _NO_ROOM,
    errno.EFBIG: _NO_ROOM,
    errno.EROFS: "; name a folder that can be written to",
}
"""What to do about an error of the disk, by its number."""


def say(text: str) -> None:
    """Print a line for people."""
    print(text, file=sys.stderr)


class _ToPeople(logging.Handler):
    """Passes log lines on to people."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print the line."""
        say(record.getMessage())


def say_what_the_product_logs() -> None:
    """Show what eha_bench logs (that a kernel is being compiled), and no other library's lines."""
    logger = logging.getLogger("eha_bench")
    if not logger.handlers:
        logger.addHandler(_ToPeople())
        logger.setLevel(logging.INFO)


@contextmanager
def errors_as_sentences() -> Iterator[None]:
    """Turn what a user can put right into one sentence and an exit status.

    Anything else is a bug and keeps its traceback, as does one that a worker came upon; it leaves
    with its own status.
    """
    try:
        yield
    except EhaBenchError as error:
        if error.trace:
            say(error.trace.rstrip())
        for mistake in error.each[:_MOST]:
            say(f"eha-bench: {mistake.sentence}")
        if len(error.each) > _MOST:
            say(f"... and {len(error.each) - _MOST} more: eha-bench validate lists all of a file")
        raise SystemExit(error.exit_status) from error
    except KeyboardInterrupt as error:
        leave_interrupted(error)
    except BrokenPipeError as error:
        # the reader of our output went away: not our fault, and nothing left to say
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(0) from error
    except UnicodeEncodeError as error:
        near = error.object[max(0, error.start - _NEAR) : error.end + _NEAR]
        if not any("\ud800" <= letter <= "\udfff" for letter in near):
            _leave_with_a_bug(error)
        # so Python holds the bytes of a file name that are not letters: no JSON can
        shown = " ".join(near.encode("utf-8", "backslashreplace").decode().split())
        say(f"eha-bench: a file name is not UTF-8 ('{shown}') and cannot be written; rename it")
        raise SystemExit(2) from error
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        way_out = _WAYS_OUT.get(error.errno or 0, "")
        say(f"eha-bench: {name}{error.strerror or error}{way_out}")
        raise SystemExit(2) from error
    except Exception as error:
        _leave_with_a_bug(error)


def leave_interrupted(error: KeyboardInterrupt) -> NoReturn:
    """Say that the work was interrupted, and how it goes on if the error knows, and leave."""
    say("; ".join(("eha-bench: interrupted", *map(str, error.args))))
    raise SystemExit(INTERRUPTED) from error


def _leave_with_a_bug(error: Exception) -> NoReturn:
    say("".join(traceback.format_exception(error)).rstrip())
    say("eha-bench: this is a bug in eha-bench or in a plug-in of yours; please report it")
    raise SystemExit(BUG) from error


def write_out(out: Path, text: str) -> None:
    """Write the file of `--out`, its folder too, or say that another one must be named.

    Raises:
        InputError: it cannot be written.
    """
    from eha_bench.core.atomic_file import write_text, writing_to

    with writing_to(out, hint="name another file with --out"):
        out.parent.mkdir(parents=True, exist_ok=True)
        write_text(out, text)


class _ProgressLines:
    """A line now and then of where long work is, for a log that is read while it goes on."""

    def __init__(self) -> None:
        self._began = self._told = monotonic()

    def __call__(self, done: int, total: int, what: str) -> None:
        """Say that `done` of `total` pieces are done and `what` is next, if it is time."""
        now = monotonic()
        if now - self._told >= _SECONDS_A_LINE:
            self._told = now
            say(f"{what}: {done} of {total} after {now - self._began:.0f} s")


class TerminalProgress:
    """A progress bar on a terminal; without one (CI, a pipe) a line every half minute."""

    def __init__(self) -> None:
        self._bar = None
        self._lines = _ProgressLines()
        if sys.stderr.isatty() and not os.environ.get("CI"):
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

            self._bar = Progress(
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                TextColumn("{task.completed}/{task.total}"),
                TimeElapsedColumn(),
                console=Console(stderr=True),
                transient=True,
            )
            self._task = self._bar.add_task("starting", total=None)

    def __call__(self, done: int, total: int, what: str) -> None:
        """Show that `done` of `total` pieces are done and `what` is next."""
        if self._bar is None:
            self._lines(done, total, what)
        else:
            self._bar.update(self._task, completed=done, total=total, description=what)

    def __enter__(self) -> TerminalProgress:
        """Start drawing."""
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()
