"""The pages of a folder as an ASGI application."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import lru_cache
from pathlib import Path
from time import monotonic
from typing import Final

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from eha_bench.core.errors import EhaBenchError
from eha_bench.server.guard import RequestGuard, Rules
from eha_bench.server.inside import inside
from eha_bench.server.pages import compare_page, live_page, message_page, start_page
from eha_bench.server.runs_on import RunOn
from eha_bench.server.stored import page, stored_file
from eha_bench.server.watch import SITE, Watch

_AGAIN: Final = 2.0
"""Seconds after which a page that changes is asked for again, at least."""

_SHARE: Final = 5.0
"""Times what reading a recording takes: so much of the machine may go to watching a run."""

_KEPT: Final = 16
"""Comparisons that are kept."""


def application(folder: Path, rules: Rules, watch: Watch) -> ASGIApp:
    """Return the application.

    Args:
        folder: the results; only read.
        rules: who may ask.
        watch: of the same folder; started and stopped with the application.
    """
    pages = _Pages(folder, watch)

    @asynccontextmanager
    async def life(_: Starlette) -> AsyncIterator[None]:
        with watch:
            yield

    def route(path: str, answer: Callable[[Request], Response]) -> Route:
        return Route(path, answer, methods=["GET"])

    app = Starlette(
        routes=[
            route("/", pages.start),
            route("/status.json", pages.status),
            route("/compare", pages.compare),
            route("/live/{name:path}", pages.live),
            route("/files/{name:path}", pages.file),
        ],
        exception_handlers={HTTPException: _missing, Exception: _failure_page},
        lifespan=life,
    )
    return RequestGuard(app, rules)  # around everything: messages about a fault are guarded, too


class _Pages:
    """Answers; each is worked out on its own thread, the heavy ones one at a time."""

    def __init__(self, folder: Path, watch: Watch) -> None:
        self._folder = folder
        self._watch = watch
        self._reading = threading.Lock()
        self._compared = lru_cache(_KEPT)(self._compare)

    def start(self, request: Request) -> Response:
        """Return the start page."""
        state = self._watch.state
        text = start_page(
            self._folder,
            state,
            first=_number(request.query_params.get("from", "")),
            baseline=request.query_params.get("baseline"),
        )
        waiting = state.history is None and not state.problem
        return page(text, again=_AGAIN if waiting else 0.0)

    def status(self, _: Request) -> Response:
        """Return what is on and what the history says, for programs."""
        state = self._watch.state
        history = state.history
        return JSONResponse(
            {
                "schema_version": 1,
                "status": history.status if history is not None else "",
                "problem": state.problem,
                "runs": len(state.seen.results),
                "running": [run.name for run in state.seen.runs_on],
            }
        )

    def compare(self, request: Request) -> Response:
        """Return two runs compared."""
        asked = request.query_params
        names = (asked.get("baseline"), asked.get("candidate"))
        if None in names:
            return page(message_page("Two runs are needed", "Choose them on the first page."), 400)
        stamps = self._watch.state.seen.results
        try:
            with self._reading:
                return page(self._compared(str(names[0]), str(names[1]), hash(stamps)))
        except EhaBenchError as error:
            return page(message_page("These cannot be compared", str(error)), 404)

    def _compare(self, baseline: str, candidate: str, _stamp: int) -> str:
        return compare_page(self._folder, baseline, candidate)

    def live(self, request: Request) -> Response:
        """Return a run that is on."""
        name = request.path_params["name"]
        run = self._run_on(name)
        if run is None:
            what = "No such run is in progress"
            return page(message_page(what, "Its report is among the runs once it has ended."), 404)
        began = monotonic()
        try:
            with self._reading:
                text = live_page(run)
        except EhaBenchError as error:
            text = message_page("Nothing to show yet", str(error))
        return page(text, again=max(_AGAIN, _SHARE * (monotonic() - began)))

    def _run_on(self, name: str) -> RunOn | None:
        return next((run for run in self._watch.state.seen.runs_on if run.name == name), None)

    def file(self, request: Request) -> Response:
        """Return a page of the history, or a file of the folder."""
        name = request.path_params["name"]
        area, _, rest = name.partition("/")
        site = self._watch.state.site
        answer: Response | None = None
        if area == SITE and site is not None:
            made = inside(site, rest)
            answer = None if made is None else stored_file(made, own=True)
        if answer is None:
            found = inside(self._folder, name)
            answer = None if found is None else stored_file(found)
        if answer is None and area == SITE and site is None:
            return page(message_page("The trends are being computed"), 503, again=_AGAIN)
        if answer is None:
            raise HTTPException(404)
        return answer


def _number(text: str) -> int:
    return int(text) if text.isascii() and text.isdigit() and len(text) < 10 else 0


def _missing(_: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 404
    return page(message_page("Page not found"), status)


def _failure_page(_: Request, error: Exception) -> Response:
    what = f"{type(error).__name__}: {error}"
    return page(message_page("This page could not be made", what), 500)
