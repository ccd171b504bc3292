"""`eha-bench next` and `close` as a user calls them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "experiment"))

from experiment_question import rival, write_question

from eha_bench.rounds import _notes_of
from spindle_plant import SPINDLE

LAG = ("current_lag", {"time_constant": 2e-3})
DELAY = ("command_delay", {"delay": 2e-3})


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
        (("next", "diagnosis", "--from", "log.csv", "--out", "next.yaml"), "leave out --out"),
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


def _left_open(folder: Path) -> None:
    """Write a first diagnosis that leaves two causes open."""
    place = write_question(folder / "diagnosis", [rival(*LAG), rival(*DELAY)])
    file = place / "diagnosis.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "complete": True}))


def test_why_a_run_stopped_is_said_wherever_rounds_are_read(cli, tmp_path) -> None:
    (tmp_path / "dataset.yaml").write_text("model: none.yaml\n")
    _left_open(tmp_path / "loop" / "round-1")
    # a motor of ten times the torque goes beyond what was recorded: a safety stop
    (tmp_path / "strong.yaml").write_text(
        "model: eha_knee\nparameters: {torque_constant: 1.3 N*m/A}\n"
    )
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: strong.yaml\n")
    done = cli("close", "dataset.yaml", "--target", "rig.yaml", "--out", "loop", "--budget", "3 s",
               check=3)  # fmt: skip
    result = json.loads((tmp_path / "loop/round-1/next-run/result.json").read_text())
    reason = result["trials"][0]["reason"]
    assert reason
    said = f"round 1 stopped: part_1: {reason}"
    found = json.loads((tmp_path / "loop/rounds.json").read_text())
    assert found["notes"] == [said]
    assert found["rounds"][0]["reason"] == f"part_1: {reason}"
    assert said in " ".join(done.stderr.split())
    assert "did not come to its end" in (tmp_path / "loop/rounds.html").read_text()
    # the same command goes on once the machine is repaired, and then it has not failed
    assert _notes_of(tmp_path / "loop") == ()


def test_a_suite_that_the_target_refuses_leaves_the_rounds_with_the_reason(cli, tmp_path) -> None:
    (tmp_path / "dataset.yaml").write_text("model: none.yaml\n")
    _left_open(tmp_path / "loop" / "round-1")
    (tmp_path / "plant.yaml").write_text(SPINDLE)
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: plant.yaml\n")
    done = cli("close", "dataset.yaml", "--target", "rig.yaml", "--out", "loop", "--budget", "3 s",
               check=2)  # fmt: skip
    found = json.loads((tmp_path / "loop/rounds.json").read_text())
    assert found["ending"] == "stopped"
    reason = found["rounds"][0]["reason"]
    assert found["rounds"][0]["ending"] == "proposed"
    assert reason[:40] in " ".join(done.stderr.split())
    assert (tmp_path / "loop/rounds.html").exists()


def test_where_nothing_could_be_ranked_the_status_says_so(cli, tmp_path) -> None:
    write_question(tmp_path / "diagnosis", [rival(*LAG)])
    (tmp_path / "torn.csv").write_text("t,i\n")
    for more in ((), ("--json",)):
        done = cli("next", "diagnosis", "--from", "torn.csv", *more, check=2)
        assert "torn.csv" in done.stdout
        assert "none of the recordings could be ranked" in done.stderr
