"""Hooks of mkdocs: equations as MathML (no script, works offline), lists made from the product."""

from __future__ import annotations

import html
import re
import shutil
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert

_MATH = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_DECISION = re.compile(r"^# (\d{4}) (.*)$", re.MULTILINE)


def on_config(config: Any) -> Any:
    """Refuse to build without what gallery.py makes: a page would lack its figures."""
    missing = [
        name for name in ("gallery", "figures") if not (Path(config.docs_dir) / name).is_dir()
    ]
    if missing:
        raise SystemExit(f"docs/{' and docs/'.join(missing)} not there: run `make docs`")
    return config


def on_page_markdown(markdown: str, config: Any, **_: Any) -> str:
    """Put in lists where a page has `<!-- decisions -->` or `<!-- commands -->`."""
    if "<!-- decisions -->" in markdown:
        markdown = markdown.replace("<!-- decisions -->", _decisions(Path(config.docs_dir)))
    if "<!-- commands -->" in markdown:
        markdown = markdown.replace("<!-- commands -->", _commands())
    return markdown


def on_page_content(content: str, **_: Any) -> str:
    """Turn equations into MathML, and let the keyboard reach what scrolls."""

    def mathml(match: re.Match[str]) -> str:
        display = "block" if match[1] == "div" else "inline"
        return str(convert(html.unescape(match[2]).strip(), display=display))

    # wide equations scroll sideways: the keyboard has to reach them (site.js does so for the rest)
    found = _MATH.sub(mathml, content)
    return found.replace('display="block">', 'display="block" tabindex="0">')


def on_post_build(config: Any) -> None:
    """Leave out of the site what only its making needed."""
    shutil.rmtree(Path(config.site_dir) / "gallery" / "work", ignore_errors=True)


def _decisions(docs: Path) -> str:
    lines = []
    for path in sorted((docs / "decisions").glob("[0-9]*.md")):
        found = _DECISION.search(path.read_text(encoding="utf-8"))
        if found:
            lines.append(f"* [{found[1]}]({path.name}) {found[2]}")
    return "\n".join(lines)


def _commands() -> str:
    import typer

    from eha_bench.cli.app import app

    group = typer.main.get_command(app)
    parts = []
    for name, command in sorted(getattr(group, "commands", {}).items()):
        context = type(command).context_class(command, info_name=f"eha-bench {name}")
        context.terminal_width = context.max_content_width = 96
        parts.append(f"## {name}\n\n```text\n{command.get_help(context).strip()}\n```\n")
    return "\n".join(parts)
