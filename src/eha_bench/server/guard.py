"""Who may ask, and what a browser may do with the answer."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE: Final = "eha_bench"
_METHODS: Final = ("GET", "HEAD")
_ALWAYS: Final = {
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
_NOTHING: Final = "default-src 'none'; frame-ancestors 'none'"


@dataclass(frozen=True)
class Rules:
    """Who may ask.

    Attributes:
        token: what a browser must show; "" where any process of this machine may ask.
        hosts: names by which the server may be called where there is no token: a page elsewhere
            must not reach it through another host name that resolves to it.
    """

    token: str = ""
    hosts: frozenset[str] = frozenset({"localhost", "127.0.0.1", "[::1]"})


class RequestGuard:
    """Lets through who may ask, only to read, and forbids browsers all that a page does not say."""

    def __init__(self, app: ASGIApp, rules: Rules) -> None:
        self._app = app
        self._rules = rules
        self._shown = hashlib.sha256(rules.token.encode()).hexdigest()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or pass on what may be asked."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # nothing here speaks anything else; the server closes the connection

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _ALWAYS.items():
                    headers[name] = value
                headers.setdefault("content-security-policy", _NOTHING)
            await send(message)

        refused = self._refusal(scope)
        await (refused or self._app)(scope, receive, guarded)

    def _refusal(self, scope: Scope) -> Response | None:
        """Return the answer to who may not ask so; None to who may."""
        if scope["method"] not in _METHODS:
            return PlainTextResponse("this server only reads\n", 405, {"allow": "GET, HEAD"})
        headers = Headers(scope=scope)
        if not self._rules.token:
            name = headers.get("host", "").lower()
            bare = name.rpartition(":")[0] if name.rpartition(":")[2].isdigit() else name
            if bare not in self._rules.hosts:
                return PlainTextResponse("unknown host name\n", 400)
            return None
        return self._by_token(scope, headers)

    def _by_token(self, scope: Scope, headers: Mapping[str, str]) -> Response | None:
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        given = [value for key, value in query if key == "token"]
        if given:
            if not self._right(given[-1]):
                return _unknown()
            rest = urlencode([(key, value) for key, value in query if key != "token"])
            # no longer in the address, where others would see it
            there = "/" + scope["path"].lstrip("/\\")
            answer = RedirectResponse(there + (f"?{rest}" if rest else ""), 303)
            answer.set_cookie(COOKIE, self._shown, httponly=True, samesite="lax", path="/")
            return answer
        kind, _, token = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and self._right(token.strip()):
            return None
        cookie = cookie_parser(headers.get("cookie", "")).get(COOKIE, "")
        return None if _alike(cookie, self._shown) else _unknown()

    def _right(self, token: str) -> bool:
        return _alike(token, self._rules.token)


def _alike(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode("utf-8", "replace"), other.encode("utf-8", "replace"))


def _unknown() -> Response:
    return PlainTextResponse(
        "this server asks for a token: add ?token=... to the address, as it was printed\n",
        401,
        {"www-authenticate": "Bearer"},
    )
