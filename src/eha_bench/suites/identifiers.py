"""Names that become file names: letters, digits, `_`, `-` and `.`, never a path."""

from __future__ import annotations

import re

from eha_bench.core.errors import InputError, Place

LONGEST = 120
PATTERN = r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$"
# Names of devices on Windows, with or without an extension.
_RESERVED = re.compile(r"^(con|prn|aux|nul|com\d|lpt\d)(\..*)?$", re.IGNORECASE)


def check_identifier(name: object, what: str, where: Place) -> str:
    """Return `name` if a file may be called so on every system.

    Raises:
        InputError: it is not text, empty, too long, a path, reserved, or ends with a dot.
    """
    allowed = "use letters, digits, '_', '-' and '.', the first a letter, digit or '_'"
    if not isinstance(name, str):
        raise InputError(f"{what} is not text", where=where, hint=allowed)
    if not re.fullmatch(PATTERN.strip("^$"), name):
        raise InputError(f"{what} '{name}' cannot be a file name", where=where, hint=allowed)
    if len(name) > LONGEST:
        raise InputError(
            f"{what} '{name[:40]}...' has {len(name)} characters",
            where=where,
            hint=f"at most {LONGEST} fit into a file name everywhere",
        )
    if _RESERVED.match(name) or name.endswith("."):
        raise InputError(
            f"{what} '{name}' cannot be a file name on Windows",
            where=where,
            hint="choose another name",
        )
    return name


def label(value: object) -> str:
    """Return a value as a part of a name: `15 MPa` -> `15MPa`; other characters become `_`."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)  # 30e6 -> 30000000
    text = re.sub(r"\s+", "", str(value))
    return re.sub(r"[^A-Za-z0-9_.-]", "_", text)
