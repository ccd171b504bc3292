"""The shell of every page: one self-contained HTML file that asks nothing of the network.

A content security policy in the page allows only the styles and scripts that stand in it, by
their digests. Templates escape all that they are given; a name is never markup.

Another kind of page is a template that extends `base.html.j2` (blocks `masthead`, `main`, `foot`)
and a call of `write_page`. It shares the macros of `templates/parts`: `badge` and `verdict`
(status), `score_table`, `score_list` and `fact_list` (tables), `plot` (figure). What `plot` shows
is a `FigureView`: from `figure_of` for curves over time, or `FigureView(key, render_svg(...))` for
any figure drawn within `plot_style` in the colours of `SHADES`.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from eha_bench.core.atomic_file import write_text

_STYLES: Final = ("uPlot.min.css", "report.css")
_EARLY_SCRIPTS: Final = ("guard.js",)
_SCRIPTS: Final = (
    "uPlot.iife.min.js", "unpack.js", "pinch.js", "drawing.js", "export.js", "charts.js", "bode.js",
    "contents.js",
)  # fmt: skip


@dataclass(frozen=True)
class Fact:
    """A name and a value that the foot of a page lists, e.g. a revision."""

    name: str
    value: str
    code: bool = False


@cache
def environment() -> Environment:
    """Return the Jinja environment: everything escaped, an unknown name an error."""
    return Environment(
        loader=PackageLoader("eha_bench.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@cache
def _asset(name: str) -> Markup:
    text = (files("eha_bench.report") / "assets" / name).read_text(encoding="utf-8").strip()
    if "</style" in text.lower() or "</script" in text.lower():
        raise ValueError(f"asset {name} would end its own element")
    return Markup(text)


def _digest(text: str) -> str:
    return "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"


def content_security_policy(styles: Sequence[str], scripts: Sequence[str]) -> str:
    """Return the policy that allows these inline blocks and nothing from anywhere else."""
    return "; ".join(
        (
            "default-src 'none'",
            "script-src " + (" ".join(map(_digest, scripts)) or "'none'"),
            "style-src " + (" ".join(map(_digest, styles)) or "'none'"),
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )


def render_page(
    template: str, content: Mapping[str, Any], *, title: str, scripts: Sequence[str] = ()
) -> str:
    """Render a template that extends `base.html.j2` into a whole page.

    Args:
        template: name within `report/templates`.
        content: what the template shows; text is escaped.
        title: of the window.
        scripts: names within `report/assets` of what this page alone needs.
    """
    styles = [_asset(name) for name in _STYLES]
    early = [_asset(name) for name in _EARLY_SCRIPTS]
    late = [_asset(name) for name in (*_SCRIPTS, *scripts)]
    return (
        environment()
        .get_template(template)
        .render(
            {
                **content,
                "title": title,
                "styles": styles,
                "early_scripts": early,
                "scripts": late,
                "policy": content_security_policy(styles, [*early, *late]),
                "version": version("eha-bench"),
            }
        )
    )


def write_page(
    path: Path,
    template: str,
    content: Mapping[str, Any],
    *,
    title: str,
    scripts: Sequence[str] = (),
) -> Path:
    """Render a page and write it whole or not at all; return its path."""
    write_text(path, render_page(template, content, title=title, scripts=scripts))
    return path
