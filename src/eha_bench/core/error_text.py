"""What was raised by code that is not ours, in one line, with the place in that code.

Whoever writes a plug-in reads one sentence: what went wrong, in which file, on which line.
"""

from __future__ import annotations

import re
import sysconfig
import traceback
from pathlib import Path
from textwrap import shorten
from typing import Final

_OURS: Final = Path(__file__).resolve().parents[1]
_STANDARD: Final = Path(sysconfig.get_path("stdlib")).resolve()
_COLOURS: Final = re.compile("\x1b\\[[0-9;]*m")
_LONGEST: Final = 500
"""Most characters of what was raised: some libraries raise pages."""
_INSTALLED: Final = frozenset({"site-packages", "dist-packages"})


def without_colours(text: str) -> str:
    """Return a text without a terminal's codes for colours, which some libraries put in errors."""
    return _COLOURS.sub("", text)


def error_text(error: BaseException) -> str:
    """Return what was raised and where: `KeyError: 'x', at my_law.py:7 in step`."""
    plain = without_colours(f"{type(error).__name__}: {error}")
    what = shorten(" ".join(plain.split()).removesuffix(":"), _LONGEST, placeholder=" ...")
    frame = _place(traceback.extract_tb(error.__traceback__))
    return f"{what}, at {frame.filename}:{frame.lineno} in {frame.name}" if frame else what


def place_of(function: object) -> str:
    """Return where a function is written, to stand behind what it did: `, at my_law.py:7 in step`.

    Of what is not written in Python it is "".
    """
    code = getattr(function, "__code__", None)
    return f", at {code.co_filename}:{code.co_firstlineno} in {code.co_name}" if code else ""


def shown(value: object) -> str:
    """Return a value as a sentence names it: a number or a text itself, else its type."""
    if value is None or isinstance(value, bool | int | float | str):
        return shorten(repr(value), _LONGEST, placeholder=" ...")
    return f"a {type(value).__name__}"


def _place(frames: traceback.StackSummary) -> traceback.FrameSummary | None:
    """Return the innermost frame of the user's own code, else of what the bench had called.

    Own code is what is neither ours, nor installed, nor Python's: where a plug-in calls NumPy in a
    wrong way, the line that calls it is wrong. Of an installed plug-in it is its innermost frame.
    """
    paths = [Path(frame.filename).resolve() for frame in frames]
    foreign = [n for n, path in enumerate(paths) if not path.is_relative_to(_OURS)]
    own = [n for n in foreign if not _is_installed(paths[n])]
    if own:
        return frames[own[-1]]
    of_plugin = [n for n in foreign if paths[n].parent == paths[foreign[0]].parent]
    return frames[of_plugin[-1]] if of_plugin else next(reversed(frames), None)


def _is_installed(path: Path) -> bool:
    frozen = path.name.startswith("<")
    return frozen or path.is_relative_to(_STANDARD) or not _INSTALLED.isdisjoint(path.parts)
