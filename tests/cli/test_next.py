"""`eha-bench next` and `close` as a user calls them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "experiment"))

from experiment_question import rival, write_question

LAG = ("current_lag", {"time_constant": 2e-3})


def test_where_nothing_is_open_no_suite_is_written(cli, tmp_path) -> None:
    write_question(tmp_path / "diagnosis", [rival(*LAG)])
    done = cli("next", "diagnosis", "--out", "next.yaml", "--json", check=1)
    assert json.loads(done.stdout)["ending"] == "nothing_open"
    assert "nothing is open" in done.stderr
    assert not (tmp_path / "next.yaml").exists()
    assert (tmp_path / "next.html").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("next", "nothing", "--out", "next.yaml"), "no such diagnosis"),
        (("next", "diagnosis"), "add --out"),
        (("next", "diagnosis", "--out", "next.txt"), ".yaml"),
        (("next", "diagnosis", "--out", "next.yaml", "--budget", "3 m"), "'m'"),
        (("next", "diagnosis", "--out", "next.yaml", "--safety", "no.yaml"), "no.yaml"),
        (("next", "diagnosis", "log.csv", "--out", "next.yaml"), "--from"),
    ],
)
def test_bad_input_is_one_sentence(cli, tmp_path, arguments, said) -> None:
    write_question(tmp_path / "diagnosis", [rival(*LAG, share=0.3)])
    done = cli(*arguments, check=2)
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_rounds_go_on_where_they_were(cli, tmp_path) -> None:
    # a diagnosis that is there already is not made again: the dataset is not even there
    (tmp_path / "dataset.yaml").write_text("model: none.yaml\n")
    write_question(tmp_path / "loop" / "round-1" / "diagnosis", [rival(*LAG)])
    file = tmp_path / "loop" / "round-1" / "diagnosis" / "diagnosis.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "complete": True}))
    done = cli("close", "dataset.yaml", "--target", "physical", "--out", "loop", "--json", check=0)
    found = json.loads(done.stdout)
    assert found["ending"] == "settled"
    assert [item["ending"] for item in found["rounds"]] == ["nothing_open"]
    assert "nothing_open" not in (tmp_path / "loop" / "rounds.html").read_text()
    done = cli("close", "dataset.yaml", "--target", "paper", "--out", "loop", check=2)
    assert "another folder" in done.stderr
