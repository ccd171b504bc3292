"""Who writes results knows all files that were read for them."""

from __future__ import annotations

import pytest

from eha_bench.core.errors import InputError
from eha_bench.core.input_files import note_input, noting_inputs
from eha_bench.core.output_folder import spare_inputs
from eha_bench.plants.model import load_model


def test_what_a_file_names_is_noted_too(tmp_path):
    (tmp_path / "base.yaml").write_text("model: eha_knee\n")
    (tmp_path / "model.yaml").write_text("model: base.yaml\n")
    with noting_inputs() as outer, noting_inputs() as read:
        load_model(tmp_path / "model.yaml")
    assert {path.name for path in read} == {"model.yaml", "base.yaml"}
    assert outer == read
    note_input(tmp_path)  # nobody asks: nothing is kept
    assert tmp_path not in read


def test_a_dict_is_no_file(tmp_path):
    with noting_inputs() as read:
        load_model({"model": "eha_knee"})
    assert read == []


def test_a_folder_of_results_spares_what_is_in_it(tmp_path):
    folder = tmp_path / "rivals"
    folder.mkdir()
    mine = folder / "mine.yaml"
    mine.touch()
    spare_inputs([tmp_path / "new.json", folder], [tmp_path / "other.yaml", None, {}])
    with pytest.raises(InputError, match=r"mine\.yaml: is read here .*; name another folder"):
        spare_inputs([folder], [mine])
