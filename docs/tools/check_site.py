"""Check the built site: every local link leads somewhere, and no page loads anything from outside.

python docs/tools/check_site.py build/site
"""

from __future__ import annotations

import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADS = {"script": "src", "img": "src", "iframe": "src", "link": "href", "source": "src"}
# links that a reader may follow, not what the page loads
_INERT = {"canonical", "next", "prev"}
# a link that was meant to be one, but stands on the page as it was typed
_TYPED = re.compile(r"\]\([\w./-]+\.md\b")
_AS_TYPED = {"code", "pre", "script", "style"}


class Page(HTMLParser):
    """The ids of a page, its links, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = {"", "__comments"}
        self.links: list[str] = []
        self.loads: list[str] = []
        self.typed: list[str] = []
        self._verbatim = 0
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what a tag names, links and loads."""
        self._verbatim += tag in _AS_TYPED
        found = {name: value or "" for name, value in attrs}
        self.ids.update(value for name in ("id", "name") if (value := found.get(name)))
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        elif tag in _LOADS and found.get("rel", "") not in _INERT:
            self.loads.append(found.get(_LOADS[tag], ""))

    def handle_endtag(self, tag: str) -> None:
        """Leave what stands as it is typed."""
        self._verbatim -= tag in _AS_TYPED

    def handle_data(self, data: str) -> None:
        """Note links that were not made into links."""
        if not self._verbatim:
            self.typed += _TYPED.findall(data)


def problems(site: Path) -> list[str]:
    """Return what is wrong, one sentence each."""
    pages = {path: Page(path) for path in sorted(site.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        name = path.relative_to(site)
        if name.name == "404.html":
            continue  # its links are absolute, for it may be shown anywhere
        found += [f"{name} loads {url}" for url in page.loads if urlsplit(url).netloc]
        found += [f"{name} shows the text of a link, '{text})'" for text in page.typed]
        for url in (*page.links, *page.loads):
            parts = urlsplit(url)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.exists():
                found.append(f"{name} links to {url}, which is not there")
            elif target in pages and not _anchored(pages[target], parts.fragment):
                found.append(f"{name} links to {url}: no such place on that page")
    return found


def _anchored(page: Page, fragment: str) -> bool:
    # A report's link may go on with a repeat or a stretch of time.
    first = fragment.partition("&")[0]
    return any(name in page.ids for name in (fragment, unquote(fragment), first))


if __name__ == "__main__":
    wrong = problems(Path(sys.argv[1]).resolve())
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    sys.exit(bool(wrong))
