"""Files that appear under their name only when they are whole."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eha_bench.core.errors import InputError, Place

_WHILE_WRITING = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})


@contextmanager
def replacing(target: Path, *, durable: bool = False) -> Iterator[Path]:
    """Yield a path next to `target` to write a file at; it takes the name when all went well.

    Otherwise it is removed, and what was under the name stays.

    Args:
        target: the file's name; its folder must exist.
        durable: whether it must still be there when the power goes right after this.

    Raises:
        OSError: the file cannot be written or renamed.
    """
    # 40 letters of four bytes each leave room for the rest in what file systems allow
    part = target.with_name(f".{target.name[:40]}.{secrets.token_hex(4)}.part")
    try:
        yield part
        if durable:
            _to_disk(part)
        part.replace(target)
        if durable and os.name == "posix":  # elsewhere folders cannot be opened
            _to_disk(target.parent)
    except OSError as error:
        unnamed = error.filename is None and error.errno in _WHILE_WRITING
        if str(error.filename) != str(part) and not unnamed:
            raise
        # the temporary file's name means nothing to a user, and a write knows no name
        raise OSError(error.errno, error.strerror, str(target)) from error
    finally:
        part.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a whole text file or nothing; raises OSError."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def writing_to(
    target: Path,
    kind: type[InputError] = InputError,
    hint: str = "check that the folder exists, is writable and has room",
) -> Iterator[None]:
    """Turn an `OSError` while `target` is written into an error that names it and the way out.

    Raises:
        InputError: of that kind; the file cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise kind(
            f"cannot be written ({error.strerror or error})",
            where=Place(file=str(target)),
            hint=hint,
        ) from error


def _to_disk(path: Path) -> None:
    """Ask the disk to keep a file, or a folder's list of names."""
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
