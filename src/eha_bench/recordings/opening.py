"""Opens a recording, be it a file or a folder of them."""

from __future__ import annotations

import stat
from pathlib import Path

from eha_bench.core.errors import Place, RecordingError
from eha_bench.recordings.bags.rosbag2 import Rosbag2Source
from eha_bench.recordings.formats import open_file
from eha_bench.recordings.source import Source

_HEAD = 4096
_ZSTD = b"\x28\xb5\x2f\xfd"


def open_source(path: Path) -> Source:
    """Return a recording as a source, whatever its format.

    Raises:
        RecordingError: no such file, an empty one, or no recording.
    """
    where = Place(file=str(path))
    try:
        if path.is_dir():
            return Rosbag2Source(path)
        refuse_special(path)
        with path.open("rb") as stream:
            head = stream.read(_HEAD)
    except FileNotFoundError as error:
        raise RecordingError("no such file", where=where, hint="check its path") from error
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})", where=where) from error
    if not head:
        raise RecordingError("the file is empty", where=where, hint="record it again")
    if path.name == "metadata.yaml":
        return Rosbag2Source(path.parent)
    return Rosbag2Source(path) if head.startswith(_ZSTD) else open_file(path, head)


def refuse_special(path: Path) -> None:
    """Refuse what is not a file, before it is opened: a pipe would wait, a device never end.

    Raises:
        RecordingError: it is a pipe, a device or a socket.
        OSError: it is not there.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise RecordingError(
            "this is a pipe or a device, not a file",
            where=Place(file=str(path)),
            hint="write it to a file first",
        )
