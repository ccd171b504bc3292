"""Keeps the history of a folder up to date for the pages, in a separate folder."""

from __future__ import annotations

import json
import logging
import shutil
import threading
import time
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from eha_bench.core.atomic_file import write_text
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.temporary_folder import TemporaryFolder
from eha_bench.report.history_markdown import history_markdown
from eha_bench.report.trend_site import write_site
from eha_bench.server.runs_on import FolderScan, look
from eha_bench.trends.history import History, history_of
from eha_bench.trends.index import update
from eha_bench.trends.wear import Causes, causes_from

SITE: Final = "history"
"""The folder that the site of a history has, below the one that is watched."""

_INDEX: Final = "index.sqlite"
_PAUSE: Final = 2.0  # s between two looks at least ...
_SHARE: Final = 20.0  # ... and times what a look takes, so that a slow disk is left in peace
_LOG = logging.getLogger("eha_bench")


@dataclass(frozen=True)
class FolderState:
    """What is known of the folder at an instant.

    Attributes:
        seen: results and runs that are on.
        history: of the results; None before it has been worked out, or where there is none.
        site: the folder of its pages, likewise.
        problem: why there is no history, as a sentence; "" while it is being worked out.
    """

    seen: FolderScan = field(default_factory=lambda: FolderScan((), ()))
    history: History | None = None
    site: Path | None = None
    problem: str = ""


class Watch:
    """Looks at a folder again and again, and works its history out where a result is new.

    Nothing is written into the folder: index and pages are in a temporary one, made from the
    index that `eha-bench history` left where there is one.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._state = FolderState()
        self._own = TemporaryFolder("eha-bench-serve-")
        self._stop = threading.Event()
        self._done: tuple[tuple[str, int, int], ...] | None = None
        self._made = 0
        with suppress(OSError):
            shutil.copyfile(folder / SITE / _INDEX, self._own.path / _INDEX)
        self._thread: threading.Thread | None = None

    @property
    def state(self) -> FolderState:
        """What is known now; never waits."""
        return self._state

    def __enter__(self) -> Self:
        """Begin to watch."""
        self._thread = threading.Thread(target=self._go_on, daemon=True, name="watch")
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End, and leave nothing behind."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self._own.remove()

    def _go_on(self) -> None:
        while not self._stop.is_set():
            began = time.monotonic()
            try:
                self.refresh()
            except Exception as error:  # a page that is a little old is better than none
                _LOG.warning("note: the folder could not be read again (%s)", error)
            took = time.monotonic() - began
            self._stop.wait(max(_PAUSE, min(_SHARE * took, 60.0)))

    def refresh(self) -> None:
        """Look once; work the history out where the results are not those of before."""
        seen = look(self._folder)
        last = self._state
        self._state = FolderState(seen, last.history, last.site, last.problem)
        if seen.finished_results == self._done:
            return
        try:
            history, site = self._history_and_folder(seen.unfinished_results)
            self._state = FolderState(seen, history, site)
        except EhaBenchError as error:
            self._state = FolderState(seen, last.history, last.site, error.what)
        self._done = seen.finished_results
        if last.site is not None and self._state.site != last.site:
            shutil.rmtree(last.site, ignore_errors=True)

    def _history_and_folder(self, unfinished: Collection[str]) -> tuple[History, Path]:
        file = self._own.path / _INDEX
        try:
            index = update(file, self._folder)
        except EhaBenchError:  # what was left behind is not an index of this version
            file.unlink(missing_ok=True)
            index = update(file, self._folder)
        history = history_of(index.without(unfinished), self._folder.resolve().name)
        history = replace(history, causes=_stored_causes(self._folder, history))
        self._made += 1
        site = self._own.path / f"site-{self._made}"
        site.mkdir()
        history.write(site / "history.json")
        write_text(site / "history.md", history_markdown(history))
        write_site(site, history, self._folder, seen_at=self._folder / SITE)
        return history, site


def _stored_causes(folder: Path, history: History) -> Causes | None:
    """Return the causes that `eha-bench history --diagnose` left; None where it left none.

    Estimating them takes seconds a night: serving only shows what was found.
    """
    try:
        data = json.loads((folder / SITE / "history.json").read_text(encoding="utf-8"))
        found = data["causes"]
        return None if found is None else causes_from(found, history.nights)
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return None
