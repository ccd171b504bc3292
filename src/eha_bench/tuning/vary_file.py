"""vary.yaml: the gains that may be changed, and how far.

vary:
pressure.k_p: {from: 3 A/MPa, to: 9 A/MPa, scale: log}
pressure.k_2: {from: 0.5 A*s/rad, to: 4 A*s/rad, scale: log}
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from eha_bench.core.located import Located
from eha_bench.core.yaml_file import StrictModel, file_of, parse, read_text, validate
from eha_bench.sweeps.sweep_file import Entries


class VaryForm(StrictModel):
    """vary.yaml: the gains that may be changed, and how far."""

    description: str = ""
    vary: Annotated[
        Entries,
        Field(min_length=1, description="gains, mode.gain: {from, to, scale}, or a list of values"),
    ]


@dataclass(frozen=True)
class VaryFile:
    """What a vary.yaml says, before it is checked against controllers.

    Attributes:
        entries: by gain. path: the file. sha256: digest of its text.
    """

    entries: Located
    path: Path
    sha256: str


def load_vary(source: str | Path | Mapping[str, Any]) -> VaryFile:
    """Read a vary.yaml, or a dict of what it would hold.

    Raises:
        InputError: it is wrong, with file, line and key.
    """
    path = file_of(source, "vary")
    text = read_text(path)
    content = Located.of(parse(text, str(path)), str(path))
    validate(VaryForm, content.value, str(path), places=content.place, kind="vary")
    return VaryFile(content.at("vary"), path, hashlib.sha256(text.encode()).hexdigest())
