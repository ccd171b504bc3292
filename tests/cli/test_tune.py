"""`eha-bench tune`: gains that pass, infeasible ones said so, the same by seed, and mistakes."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eha_bench.tuning.aim import PassProbability, Tail, Worst, least
from eha_bench.tuning.contradiction import contradiction

from .conftest import Cli
from .own_controller import write_own_controller

SUITE = """\
name: hold
trials:
  - id: step
    mode: pressure
    setup: {piston: locked}
    duration: 60 ms
    signal: {kind: step, initial: 0 MPa, final: 10 MPa, at: 1 ms}
    accept:
      tracking_rms: <= 4.9 MPa
      peak: <= 12 MPa
  - id: turn
    mode: current
    setup: {piston: locked}
    duration: 20 ms
    signal: {kind: step, final: 8 A, at: 10 ms}
    accept:
      tracking_max: {channel: current, max: 12 A}
"""
MODEL = "model: eha_knee\nparameters: {torque_constant: 0.25}\n"
VARY = """\
vary:
  pressure.k_p: {from: 3 A/MPa, to: 12 A/MPa, scale: log}
  pressure.k_2: {from: 0.5 A*s/rad, to: 4 A*s/rad, scale: log}
"""
TUNE = ("tune", "hold.yaml", "--model", "calibrated.yaml", "--vary", "vary.yaml")
FEW = ("--candidates", 24, "--draws", 4)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "hold.yaml").write_text(SUITE, encoding="utf-8")
    (tmp_path / "vary.yaml").write_text(VARY, encoding="utf-8")
    (tmp_path / "calibrated.yaml").write_text(MODEL, encoding="utf-8")
    recorded = {"pressure_a": [0.0, 5e6], "current": [-100.0, 100.0]}
    content = {
        "model": "calibrated.yaml",
        "covariance": {"parameters": ["torque_constant"], "matrix": [[0.005**2]]},
        "per_run": {},
        "covered": {"setups": [{"piston": "locked", "bypass": "closed", "extremes": recorded}]},
    }
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    return tmp_path


def tuning(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "tuning.json").read_text(encoding="utf-8"))
    return content


def test_tuned_gains_pass_where_those_before_do_not(cli: Cli, files: Path) -> None:
    done = cli(*TUNE, *FEW, "--out", "out", check=0)
    assert done.stdout.strip() == "out/tuned.yaml"
    found = tuning(files / "out")
    assert found["status"] == "feasible"
    assert found["p_pass"]["value"] > found["p_pass_before"]["value"]
    assert found["gains"]["pressure.k_p"]["before"] == pytest.approx(6.06e-6)
    assert "extends: paper" in (files / "out/tuned.yaml").read_text(encoding="utf-8")
    # what it says is what a run says
    words = ("--posterior", "calibration.json", "--draws", 4, "--out", "run")
    cli("run", "hold.yaml", "--target", "out/target.yaml", *words, check=0)
    chance = json.loads((files / "run/probability.json").read_text(encoding="utf-8"))
    assert chance["suite"] == found["p_pass"]
    # 10 MPa are asked for, and 5 MPa were recorded
    for content in (chance, found):
        assert [item["channel"] for item in content["beyond"]] == ["pressure_a"]
        assert any("step takes pressure_a to" in note for note in content["notes"])
    assert "P(pass) before" in (files / "out/tuning.html").read_text(encoding="utf-8")
    cli("validate", "out/tuned.yaml", "out/target.yaml", "vary.yaml", check=0)


@pytest.mark.slow
def test_a_seed_gives_the_same_gains_on_any_workers(cli: Cli, files: Path) -> None:
    few = ("--candidates", 16, "--draws", 4, "--seed", 5)
    cli(*TUNE, *few, "--out", "a")
    cli(*TUNE, *few, "--out", "b", "--workers", "2")
    assert tuning(files / "a") == tuning(files / "b")


@pytest.mark.slow
def test_what_cannot_be_kept_together_is_named(cli: Cli, files: Path) -> None:
    # as fast as that only with more overshoot than is allowed
    text = SUITE.replace("4.9 MPa", "4.7 MPa").replace("12 MPa", "11.3 MPa")
    (files / "hold.yaml").write_text(text, encoding="utf-8")
    done = cli(*TUNE, *FEW, "--out", "out", check=1)
    found = tuning(files / "out")
    assert found["status"] == "infeasible"
    assert found["infeasible"]["never"] == []
    assert found["infeasible"]["contradict"] == [["step.tracking_rms", "step.peak"]]
    assert found["infeasible"]["nearest_miss"]
    assert "no candidate keeps all of: step.tracking_rms" in done.stderr
    assert "Infeasible" in (files / "out/tuning.html").read_text(encoding="utf-8")


def test_a_limit_that_no_gain_meets_is_named(cli: Cli, files: Path) -> None:
    (files / "hold.yaml").write_text(SUITE.replace("4.9 MPa", "1 kPa"), encoding="utf-8")
    cli(*TUNE, "--candidates", 16, "--draws", 3, "--out", "out", check=1)
    assert tuning(files / "out")["infeasible"]["never"] == ["step.tracking_rms"]


def test_without_a_posterior_nothing_is_said_of_the_machine(cli: Cli, files: Path) -> None:
    (files / "calibration.json").unlink()
    done = cli(*TUNE, *FEW, "--out", "out", check=0)
    found = tuning(files / "out")
    assert found["p_pass"] is None
    assert found["margin"] >= 0.0
    assert "its uncertainty is not considered" in done.stderr


@pytest.mark.parametrize("aim", ["worst", "cvar"])
def test_other_aims(cli: Cli, files: Path, aim: str) -> None:
    cli(*TUNE, "--candidates", 16, "--draws", 4, "--robust", aim, "--out", "out")
    assert tuning(files / "out")["p_pass"]["draws"] == 4


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("vary.yaml", "vary: {pressure.k_x: {from: 1, to: 2}}", "vary.yaml:1, key 'vary.pressure.k_"
         "x': no controller has a gain 'pressure.k_x'"),
        ("vary.yaml", "vary:\n  pressure.k_p: {from: 2 A/MPa, to: 1 A/MPa}", "vary.yaml:2, key "
         "'vary.pressure.k_p.to': the range is empty: it goes from 2 A/MPa to 1 A/MPa"),
        ("vary.yaml", "vary: {}", "'vary' is empty"),
        ("vary.yaml", "vary: {motor_speed.k_p: {from: 1, to: 2}}",
         "no trial with a limit is run under a controller of these gains"),
        ("hold.yaml", SUITE.replace("<= 12 MPa", "{channel: force, max: 1 kN}"),
         "hold.yaml:10, key 'trials.step.accept.peak': nothing scores the limit on peak (step: "
         "peak is not scored: no force)"),
        ("calibration.json", '{"model": "calibrated.yaml", "covariance": {"parameters": '
         '["command_delay.delay"], "matrix": [[1e-8]]}}', "it has the effect command_delay, which "
         "this one does not"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(cli: Cli, files: Path, file: str, text: str, told: str) -> None:
    (files / file).write_text(text + "\n", encoding="utf-8")
    said = cli(*TUNE, "--candidates", 8, "--draws", 2, "--out", "out", check=2)
    assert told in said.stderr
    assert not (files / "out").exists()


def test_the_posterior_of_another_model(cli: Cli, files: Path) -> None:
    (files / "other").mkdir()
    (files / "other/calibrated.yaml").write_text(MODEL.replace("0.25", "0.26"))
    (files / "calibration.json").rename(files / "other/calibration.json")
    said = cli(*TUNE, "--posterior", "other", "--out", "out", check=2)
    assert "torque_constant is 0.26 there and 0.25 in this one" in said.stderr


def test_an_unknown_aim(cli: Cli, files: Path) -> None:
    said = cli(*TUNE, "--robust", "best", "--out", "out", check=2)
    assert "--robust 'best' is not known; known: worst, cvar" in said.stderr


def test_a_class_of_the_users_own_is_tuned(cli: Cli, files: Path) -> None:
    write_own_controller(files, "own.yaml")
    (files / "vary.yaml").write_text("vary: {pressure.gain: {from: 0.2 A/MPa, to: 3 A/MPa}}\n")
    few = ("--candidates", 8, "--draws", 2)
    cli(*TUNE, *few, "--controller", "own.yaml", "--out", "out")
    assert "extends: ../own.yaml" in (files / "out/tuned.yaml").read_text(encoding="utf-8")
    cli("run", "hold.yaml", "--target", "out/target.yaml", "--out", "run")
    result = json.loads((files / "run/result.json").read_text(encoding="utf-8"))
    assert result["status"] in ("passed", "failed")


def test_a_pid_of_any_unit_is_tuned(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(
        "name: s\nmodel: valve_cylinder\ncontroller: c.yaml\ntrials:\n"
        "  - id: step\n    mode: piston_position\n    duration: 0.4 s\n"
        "    signal: {kind: step, initial: 0 mm, final: 5 mm, at: 10 ms}\n"
        "    accept: {response_time: <= 120 ms, overshoot: <= 10 %}\n"
    )
    (tmp_path / "c.yaml").write_text("piston_position: {controller: pid, k_p: 0.1 V/mm}\n")
    own = ("tune", "s.yaml", "--model", "valve_cylinder", "--controller", "c.yaml")
    own = (*own, "--vary", "v.yaml", "--out", "out")
    (tmp_path / "v.yaml").write_text(
        "vary:\n  piston_position.k_p: {from: 0.1 V/mm, to: 2 V/mm, scale: log}\n"
    )
    done = cli(*own, "--candidates", 16, check=0)
    assert "piston_position.k_p: 0.1 V/mm -> " in done.stderr
    assert tuning(tmp_path / "out")["status"] == "feasible"
    cli("run", "s.yaml", "--target", "out/target.yaml", "--out", "run", check=0)
    (tmp_path / "v.yaml").write_text("vary:\n  piston_position.k_p: {from: 1 A/rad, to: 5 A/rad}\n")
    done = cli(*own, check=2)
    assert "v.yaml:2, key 'vary.piston_position.k_p.from'" in done.stderr
    assert "Traceback" not in done.stderr


def diagnosed(folder: Path) -> Path:
    """Write what a diagnosis leaves, without its search."""
    place = folder / "found"
    place.mkdir()
    (place / "revised.yaml").write_text(MODEL, encoding="utf-8")
    errors = {"before": 3e5, "after": 4e4, "noise_floor": 3e4, "unit": "Pa"}
    interval = {"value": 0.25, "low": 0.24, "high": 0.26, "unit": "N*m/A"}
    content = {
        "verdict": "effect", "unknown": None, "model": "revised.yaml", "covered": {"seconds": 24.0},
        "effects": [{"id": "entrained_air", "equation": "flow", "parameters": {}}],
        "error": {"train": {}, "holdout": {"pressure_a": errors}, "unseen": {}},
        "calibrated": {"torque_constant": interval},
    }  # fmt: skip
    (place / "diagnosis.json").write_text(json.dumps(content), encoding="utf-8")
    return place


def test_one_page_goes_from_the_diagnosis_to_the_result(cli: Cli, files: Path) -> None:
    cli(*TUNE, *FEW, "--out", "tuned", check=0)
    cli("run", "hold.yaml", "--target", "tuned/target.yaml", "--out", "new", check=0)
    (files / "old.yaml").write_text(
        "target: simulator\nmodel: calibrated.yaml\ncontroller: paper\n", encoding="utf-8"
    )
    cli("run", "hold.yaml", "--target", "old.yaml", "--out", "old", check=1)
    diagnosed(files)
    done = cli("before-after", "old", "found", "new", "tuned", "--out", "pages/all.html", check=0)
    assert done.stdout.strip() == "pages/all.html"
    page = (files / "pages/all.html").read_text(encoding="utf-8")
    assert "Passed on the machine" in page
    assert "the machine keeps 3 of 3 limits; with the previous gains it kept 2 of 3" in page
    assert "entrained air (in the flow balances" in page
    assert 'href="../new/report.html"' in page
    assert "another model" not in page
    # what does not belong together is told
    cli("before-after", "old", "found", "tuned", "--out", "pages/old.html", check=0)
    page = (files / "pages/old.html").read_text(encoding="utf-8")
    assert "no result was made with the tuned gains" in page
    (files / "found/revised.yaml").write_text("model: eha_knee\n", encoding="utf-8")
    cli("before-after", "found", "tuned", "--out", "pages/none.html", check=0)
    page = (files / "pages/none.html").read_text(encoding="utf-8")
    assert "tuned for another model" in page
    assert "Not run yet" in page


@pytest.mark.parametrize(
    ("folders", "told"),
    [
        (["nowhere"], "nowhere: no such folder"),
        (["."], "holds none of diagnosis.json, tuning.json, result.json"),
        (["found"], "no folder of `tune` is given"),
        (["found", "found"], "there are 2 folders of `diagnose`"),
    ],
)
def test_folders_that_make_no_page(cli: Cli, files: Path, folders: list[str], told: str) -> None:
    diagnosed(files)
    done = cli("before-after", *folders, check=2)
    assert told in done.stderr


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_so_far(files: Path) -> None:
    (files / "hold.yaml").write_text(SUITE.replace("60 ms", "0.8 s"), encoding="utf-8")
    words = [str(item) for item in (*TUNE, "--candidates", 4000, "--draws", 4, "--out", "out")]
    running = subprocess.Popen(
        [sys.executable, "-m", "eha_bench", *words], cwd=files, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "CI": "true"},
    )  # fmt: skip
    threading.Timer(10.0, lambda: running.send_signal(signal.SIGINT)).start()
    began = time.monotonic()
    _, said = running.communicate(timeout=240)
    assert running.returncode == 130, said
    assert time.monotonic() - began < 60  # not a whole generation more
    assert "Traceback" not in said
    if (files / "out").exists():  # otherwise nothing had been tried in time
        assert tuning(files / "out")["complete"] is False
        assert (files / "out/tuned.yaml").is_file()


def test_worth_goes_by_passing_first_and_by_margin_then() -> None:
    aim = PassProbability()
    more = np.array([[0.01, 0.5], [0.01, 0.5], [-0.9, 0.5]])
    fewer = np.array([[0.9, 0.9], [-0.01, 0.9], [-0.01, 0.9]])
    assert aim.of(more) > aim.of(fewer)
    assert aim.of(more + 0.001) > aim.of(more)
    assert Worst().of(fewer) > Worst().of(more)
    assert Tail().of(fewer) == pytest.approx(-0.01)


def test_what_is_not_scored_is_worse_than_any_miss() -> None:
    margins = np.array([[0.2, -5.0], [0.2, np.nan], [np.nan, np.nan], [0.3, 0.1]])
    found = least(margins)
    assert found[3] == 0.1
    assert found[0] > found[1] > found[2]


def test_contradictions_are_the_smallest_sets() -> None:
    pair = np.array([[1.0, -1.0, 1.0, -1.0], [-1.0, 1.0, 1.0, -1.0]])
    found = contradiction(pair)
    assert found.never == (3,)
    assert found.together == ((0, 1),)
    three = np.array([[1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]])
    assert contradiction(three).together == ((0, 1, 2),)
