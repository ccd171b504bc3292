"""Files as they are sent: what they may be, and what a stored page may do in a browser."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from starlette.responses import FileResponse, HTMLResponse, Response

SHOWN: Final = {
    ".html": "text/html",
    ".json": "application/json",
    ".xml": "text/plain",
    ".md": "text/plain",
    ".png": "image/png",
}
"""What a browser shows, by suffix; XML as text, as it may hold scripts."""

KEPT: Final = (".mcap", ".csv", ".parquet", ".mf4")
"""What a browser keeps as a file."""

_HEAD: Final = 200_000
_DIGESTS: Final = r"(?:'none'|'sha256-[A-Za-z0-9+/=]+'(?: 'sha256-[A-Za-z0-9+/=]+')*)"
_OWN: Final = re.compile(
    r'<meta http-equiv="Content-Security-Policy" content="('
    rf"default-src 'none'; script-src {_DIGESTS}; style-src {_DIGESTS}; "
    r"img-src data:; base-uri 'none'; form-action 'none')\">"
)
_NO_SCRIPT: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"


def policy_of(page: str) -> str:
    """Return the content security policy of one of our pages, which no other page may frame.

    A page that declares none of ours is shown without scripts.
    """
    # attributes are escaped, as everything in a template is
    head = page[:_HEAD].replace("&#39;", "'")
    found = _OWN.search(head)
    return f"{found[1] if found else _NO_SCRIPT}; frame-ancestors 'none'"


def page(text: str, status: int = 200, *, again: float = 0.0) -> Response:
    """Return a page that was just made; it is asked for again after some seconds, 0 for never."""
    headers = {"content-security-policy": policy_of(text)}
    if again:
        headers["refresh"] = f"{again:.0f}"
    return HTMLResponse(text, status, headers)


def stored_file(path: Path, *, own: bool = False) -> Response | None:
    """Return a file as an answer; None for a kind of file that is not shown.

    Args:
        path: where it is.
        own: whether this server has made it. Of others even a page of ours is kept apart, in a
            sandbox: what is in the folder may have come from anywhere.
    """
    suffix = path.suffix.lower()
    if not path.is_file():
        return None
    if suffix in KEPT:
        return FileResponse(path, media_type="application/octet-stream", filename=path.name)
    if suffix not in SHOWN:
        return None
    if suffix != ".html":
        return FileResponse(path, media_type=SHOWN[suffix])
    text = path.read_text(encoding="utf-8", errors="replace")
    policy = policy_of(text)
    if not own and "sandbox" not in policy:
        policy += "; sandbox allow-scripts allow-downloads"
    return HTMLResponse(text, headers={"content-security-policy": policy})
