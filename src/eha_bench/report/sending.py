"""Sends a history's summary on: to a webhook as JSON, or to a command as Markdown."""

from __future__ import annotations

import http
import json
import queue
import shlex
import subprocess
import threading
import urllib.error
import urllib.request
from collections.abc import Callable
from http.client import HTTPException
from typing import Any, Final

from eha_bench.core.errors import InputError
from eha_bench.report.causes_text import wear_sentence
from eha_bench.report.history_markdown import history_markdown
from eha_bench.report.trend_site import event_sentence, headline
from eha_bench.trends.history import History
from eha_bench.trends.nightly_file import Nightly, When, is_webhook

_PATIENCE_S: Final = 20.0
"""For a webhook as a whole, from its name to its answer, and for each wait within."""
_COMMAND_PATIENCE_S: Final = 60.0


def send_on(history: History, nightly: Nightly) -> str:
    """Send the summary where nightly.yaml says, if it is a night to send; return what was done.

    Raises:
        InputError: it could not be sent; says why.
    """
    if nightly.send is None:
        return ""
    if nightly.when is When.DRIFTED and history.status != "drifted":
        return ""
    destination = nightly.destination()
    if is_webhook(destination):
        _post(destination, _content(history))
        return "sent to the webhook"
    words = [
        word.replace("{status}", history.status).replace("{headline}", headline(history))
        for word in shlex.split(destination)
    ]
    _run(words, history_markdown(history))
    return f"sent with {words[0]}"


def _content(history: History) -> dict[str, Any]:
    """Return what a webhook gets: `text` is what chats show, the rest is for programs."""
    return {
        "text": history_markdown(history),
        "schema_version": 1,
        "folder": history.folder,
        "status": history.status,
        "headline": headline(history),
        "causes": [
            wear_sentence(wear)
            for wear in (history.causes.wear if history.causes is not None else ())
        ],
        "events": [event_sentence(event) for event in history.events if event.now],
        "drifted": [
            {"trial": trend.trial, "metric": trend.metric, "state": trend.state.value}
            for trend in history.drifted
        ],
    }


def _post(url: str, content: dict[str, Any]) -> None:
    body = json.dumps(content, ensure_ascii=False, allow_nan=False).encode()
    # no redirects: they could lead to anything but a web server
    opener = urllib.request.build_opener(_NoRedirect)

    def send() -> None:
        request = urllib.request.Request(
            url, data=body, method="POST", headers={"Content-Type": "application/json"}
        )
        with opener.open(request, timeout=_PATIENCE_S):
            pass

    try:
        _within(_PATIENCE_S, send)
    except urllib.error.HTTPError as error:
        with error:  # which is the answer, and holds the connection
            raise _unsent(f"the webhook answered {_status(error.code)}") from None
    except OSError as error:
        reason = getattr(error, "reason", error)
        raise _unsent(f"the webhook did not answer ({reason})") from None
    except (HTTPException, ValueError):  # their words may repeat the address, which is secret
        raise _unsent("the webhook's answer is not HTTP") from None


def _within(seconds: float, work: Callable[[], None]) -> None:
    """Do work that may wait for others, for so long at most; then it is left behind.

    Time limits of sockets hold for one wait alone: an answer that comes byte by byte, or a name
    that is looked up, takes as long as it likes.

    Raises:
        TimeoutError: it took longer. Else whatever the work raises.
    """
    ended: queue.SimpleQueue[Exception | None] = queue.SimpleQueue()

    def do() -> None:
        try:
            work()
        except Exception as error:
            ended.put(error)
        else:
            ended.put(None)

    threading.Thread(target=do, daemon=True).start()
    try:
        error = ended.get(timeout=seconds)
    except queue.Empty:
        raise TimeoutError(f"not within {seconds:g} s") from None
    if error is not None:
        raise error


def _status(code: int) -> str:
    """Return a status in HTTP's own words: the server's may repeat the address."""
    try:
        return f"{code} {http.HTTPStatus(code).phrase}"
    except ValueError:
        return str(code)


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_: Any) -> None:
        return None


def _run(words: list[str], text: str) -> None:
    try:
        done = subprocess.run(
            words, input=text, text=True, capture_output=True, timeout=_COMMAND_PATIENCE_S,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise _unsent(f"{words[0]} did not end within {_COMMAND_PATIENCE_S:g} s") from error
    except OSError as error:
        raise _unsent(f"{words[0]} cannot be run ({error.strerror})") from error
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["without a reason"])[-1]
        raise _unsent(f"{words[0]} exited with {done.returncode} ({last[:200]})")


def _unsent(why: str) -> InputError:
    return InputError(f"the summary was not sent: {why}", hint="see 'send' in nightly.yaml")
