"""Make matplotlib's SVG fit to stand inside a page: small, in the page's colours, with own ids.

A strict content security policy forbids `style` attributes and foreign `<style>` elements, so
styles become presentation attributes, and the colours of `SHADES` become the page's variables:
the same drawing serves light, dark and paper.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

import numpy as np
from markupsafe import Markup, escape

SHADES: Final = {
    "text": "#010101",
    "muted": "#010102",
    "axis": "#010103",
    "grid": "#010104",
    "paper": "#010105",
    "good": "#010106",
    "limit": "#010107",
    "safety": "#010108",
    "reference": "#010109",
    "blue": "#01010a",
    "vermilion": "#01010b",
    "green": "#01010c",
    "purple": "#01010d",
    "sky": "#01010e",
    "orange": "#01010f",
}
"""Colours to draw with, by name; in the page each becomes the variable `--<name>`."""

_VARIABLES: Final = {colour: f"var(--{name})" for name, colour in SHADES.items()}
_SHADE: Final = re.compile("|".join(_VARIABLES))
_STYLE: Final = re.compile(r' style="([^"]*)"')
_FONT: Final = re.compile(r"^(?:(?:italic|normal) )?(?:(bold|\d+) )?([\d.]+)px .*$")
_NUMBER: Final = re.compile(r"-?\d+\.\d+")
_PATH: Final = re.compile(r'( d=")([^"]*)(")')
_GROUP: Final = re.compile(r"(<g>|<g [^>]*>|</g>)")
_PLAIN_PATH: Final = re.compile(r"(?:[ML] -?[\d.]+ -?[\d.]+ ?)+$")
_DEFAULTS: Final = {
    ("stroke-linejoin", "round"),
    ("stroke-linecap", "butt"),
    ("stroke-width", "1"),
    ("text-anchor", "start"),
    ("stroke-linejoin", "miter"),
    ("stroke-linecap", "square"),
}


def embed_svg(svg: str, key: str, *, title: str) -> Markup:
    """Return an SVG document of matplotlib as an element for an HTML page."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", body, flags=re.DOTALL)
    body = re.sub(r"<!--.*?-->", "", body, flags=re.DOTALL)
    body = _STYLE.sub(_attributes, body)
    body = _PATH.sub(_compact_path, body)
    body = _own_ids(body, key)
    body = _SHADE.sub(lambda match: _VARIABLES[match[0]], body)
    body = re.sub(r">\s+<", "><", body)
    body = re.sub(r"\s*\n\s*", " ", body)
    body = _without_plain_groups(body)
    box = re.search(r'viewBox="([^"]*)"', body)
    opening = (
        f'<svg viewBox="{box[1] if box else "0 0 1 1"}" role="img" aria-labelledby="{key}-title">'
        f'<title id="{key}-title">{escape(title)}</title>'
    )
    return Markup(opening + body[body.index(">") + 1 :].strip())


def _attributes(match: re.Match[str]) -> str:
    found = []
    for declaration in match[1].split(";"):
        name, _, value = (part.strip() for part in declaration.partition(":"))
        if not value or (name, value) in _DEFAULTS:
            continue
        if name == "font":
            font = _FONT.match(value)
            if font:
                found.append(f' font-size="{font[2]}"')
                found += [f' font-weight="{font[1]}"'] if font[1] else []
        elif name not in ("font-family", "white-space"):
            found.append(f' {name}="{value}"')
    return "".join(found)


def _compact_path(match: re.Match[str]) -> str:
    path = " ".join(match[2].split())
    if not _PLAIN_PATH.match(path):
        return match[1] + _NUMBER.sub(lambda n: f"{float(n[0]):.2f}", path) + match[3]
    # Whole tenths of a point, each relative to the last: shorter, and no rounding adds up.
    words = path.split()
    places = np.rint(10.0 * np.array([words[1::3], words[2::3]], dtype=np.float64)).astype(np.int64)
    steps = np.diff(places, axis=1, prepend=0)
    parts: list[str] = []
    for command, x, y, dx, dy in zip(words[::3], *places.tolist(), *steps.tolist(), strict=True):
        if command == "M":
            parts.append(f"M{_tenths(x)} {_tenths(y)}")
        elif dx or dy:
            parts.append(
                f"l{_tenths(dx)}{_tenths(dy)}" if dy < 0 else f"l{_tenths(dx)} {_tenths(dy)}"
            )
    return match[1] + "".join(parts) + match[3]


@lru_cache(maxsize=65536)
def _tenths(value: int) -> str:
    whole, tenth = divmod(abs(value), 10)
    text = f"{whole or ''}.{tenth}" if tenth else f"{whole}"
    return f"-{text}" if value < 0 else text


def _without_plain_groups(body: str) -> str:
    """Drop groups that say nothing: matplotlib makes several of every tick."""
    parts: list[str] = []
    kept: list[bool] = []
    for piece in _GROUP.split(body):
        if piece == "</g>":
            if kept.pop():
                parts.append(piece)
        elif piece == "<g>" or (piece.startswith("<g ") and piece.endswith(">")):
            kept.append(piece != "<g>")
            if kept[-1]:
                parts.append(piece)
        else:
            parts.append(piece)
    return "".join(parts)


def _own_ids(body: str, key: str) -> str:
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', body))

    def rename(match: re.Match[str]) -> str:
        return f' id="{key}-{match[1]}"' if match[1] in used else ""

    body = re.sub(r' id="([^"]*)"', rename, body)
    body = re.sub(r'(url\(#|xlink:href="#)', lambda match: f"{match[1]}{key}-", body)
    return body.replace("xlink:href", "href")
