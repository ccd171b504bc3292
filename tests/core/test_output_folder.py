"""Where results go is looked at before the work is done, and nothing is made by looking."""

from __future__ import annotations

import pytest

from eha_bench.core import output_folder
from eha_bench.core.errors import InputError
from eha_bench.core.output_folder import writable


def test_a_folder_that_is_not_there_yet_is_fine_and_not_made(tmp_path):
    assert writable(tmp_path / "a" / "b") == tmp_path / "a" / "b"
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file: is a file; name a folder"):
        writable(tmp_path / "file")
    with pytest.raises(InputError, match=r"cannot be made: '.*file' is a file"):
        writable(tmp_path / "file" / "below" / "it")


def test_a_folder_that_may_not_be_written_is_said(tmp_path, monkeypatch):
    # root may write anywhere, so that nobody's permissions can be taken away here
    monkeypatch.setattr(output_folder.os, "access", lambda _path, _mode: False)
    with pytest.raises(InputError, match=r"may not be written; name another"):
        writable(tmp_path)
    with pytest.raises(InputError, match=r"below: may not be written, as .* may not"):
        writable(tmp_path / "below")
