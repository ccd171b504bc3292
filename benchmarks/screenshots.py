"""`python -m benchmarks.screenshots PAGE.html...`: pictures of pages on a desk and on a phone.

Each page whole, at 1280 and at 390 pixels, light and dark: `index-1280-light.png` and so on. Any
page that eha-bench writes can be named, the morning page (`history/index.html`) among them. Leaves
with 1 where a page complains or asks for anything from outside.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "report"))
from chromium import Browser, find_chromium

WIDTHS = (1280, 390)
SCHEMES = ("light", "dark")


def main() -> int:
    """Take the pictures, and print where they are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("reports/screenshots"))
    chosen = parser.parse_args()
    executable = find_chromium()
    if executable is None:
        print("benchmarks.screenshots needs chromium", file=sys.stderr)
        return 2
    chosen.out.mkdir(parents=True, exist_ok=True)
    wrong = []
    with Browser(executable) as browser:
        for page in chosen.pages:
            for width in WIDTHS:
                for scheme in SCHEMES:
                    tab = browser.page()
                    tab.emulate(width, scheme=scheme)
                    tab.open(page.resolve())
                    picture = chosen.out / f"{page.stem}-{width}-{scheme}.png"
                    tab.screenshot(picture, whole=True)
                    outside = [
                        url for url in tab.requests if not url.startswith(("file:", "data:"))
                    ]
                    wrong += [f"{page}: {what}" for what in (*tab.complaints, *outside)]
                    print(picture)
    for what in wrong:
        print(what, file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
