"""What stands for a cause in a sentence."""

from __future__ import annotations

from pathlib import Path

from experiment_question import PAPER, rival, write_question

from eha_bench.experiment.describe import causes_in_words
from eha_bench.experiment.hypothesis import read_question


def test_a_number_that_is_declared_wrongly_is_said_by_its_name(tmp_path: Path) -> None:
    found = rival(None, known=(*PAPER, "torque_constant"))
    folder = write_question(tmp_path, [found, rival("command_delay", {"delay": 4e-3})])
    assert causes_in_words(read_question(folder).rivals) == {
        "none": "another torque_constant", "command_delay": "command_delay",
    }  # fmt: skip


def test_nothing_missing_is_no_effect(tmp_path: Path) -> None:
    folder = write_question(tmp_path, [rival(None), rival("command_delay", {"delay": 4e-3})])
    assert causes_in_words(read_question(folder).rivals)["none"] == "no effect"
