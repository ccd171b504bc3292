"""`eha-bench sweep`: from YAML to table and page, resumed, and with everything wrong."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from eha_bench.plants.model import load_model

from .conftest import Cli
from .own_controller import write_own_controller

SUITE = """\
name: hold
trials:
  - id: step
    mode: pressure
    setup: {piston: locked}
    settle: 10 ms
    duration: 80 ms
    signal: {kind: step, initial: 0 MPa, final: 10 MPa, at: 1 ms}
    accept:
      tracking_rms: <= 4 MPa
      peak: <= 12 MPa
"""
OVER = """\
over:
  gains:
    pressure.k_p: {from: 2 A/MPa, to: 8 A/MPa, steps: 3}
  parameters:
    bulk_modulus: [600 MPa, 900 MPa]
"""


def same(first: pa.Table, second: pa.Table) -> bool:
    """Whether two tables hold the same, NaN in the same places."""
    return first.schema.equals(second.schema) and first.to_pandas().equals(second.to_pandas())


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "hold.yaml").write_text(SUITE, encoding="utf-8")
    (tmp_path / "sweep.yaml").write_text(OVER, encoding="utf-8")
    return tmp_path


def test_a_sweep_leaves_a_table_a_page_and_a_summary(cli: Cli, files: Path) -> None:
    done = cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out")
    assert done.stdout.strip() == "out/sweep.html"
    out = files / "out"
    summary = json.loads((out / "sweep.json").read_text(encoding="utf-8"))
    assert summary["points"] == summary["done"] == 6
    assert done.returncode == (0 if summary["passed"] else 1)
    table = pq.read_table(out / "points.parquet")
    assert table.column("pressure.k_p").to_pylist() == pytest.approx(
        [2e-6, 2e-6, 5e-6, 5e-6, 8e-6, 8e-6]
    )
    assert table.schema.field("pressure.k_p").metadata == {b"unit": b"A/Pa"}
    assert table.column("bulk_modulus").to_pylist() == [6e8, 9e8] * 3
    error = np.array(table.column("value:step.tracking_rms"))
    margin = np.array(table.column("margin:step.tracking_rms"))
    assert margin == pytest.approx((4e6 - error) / 4e6)
    assert np.ptp(error) > 0.0
    least = np.minimum(margin, np.array(table.column("margin:step.peak")))
    assert np.array(table.column("margin")) == pytest.approx(least)
    kept = [status == "passed" for status in table.column("status").to_pylist()]
    assert kept == (least >= 0.0).tolist()
    assert sum(kept) == summary["passed"]
    assert summary["best"]["point"] == int(np.argmax(least))


def test_a_point_is_what_a_run_with_these_gains_gives(cli: Cli, files: Path) -> None:
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out")
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out", "--point", 5)
    result = json.loads((files / "out/points/5/result.json").read_text(encoding="utf-8"))
    scores = {score["metric"]: score["value"] for score in result["trials"][0]["scores"]}
    table = pq.read_table(files / "out/points.parquet").to_pylist()
    assert table[5]["value:step.tracking_rms"] == scores["tracking_rms"]
    # what the recording carries is what was run
    (files / "gains.yaml").write_text("extends: paper\npressure: {k_p: 8 A/MPa}\n")
    assert table[5]["bulk_modulus"] == load_model("paper").value("bulk_modulus")
    target = "target: simulator\nmodel: paper\ncontroller: gains.yaml\n"
    (files / "target.yaml").write_text(target)
    cli("run", "hold.yaml", "--target", "target.yaml", "--out", "same")
    same = json.loads((files / "same/result.json").read_text(encoding="utf-8"))
    again = {score["metric"]: score["value"] for score in same["trials"][0]["scores"]}
    assert again["tracking_rms"] == pytest.approx(scores["tracking_rms"], rel=1e-6)
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out", "--resume")
    assert 'href="points/5/report.html"' in (files / "out/sweep.html").read_text(encoding="utf-8")


def test_an_interrupted_sweep_is_gone_on_with(cli: Cli, files: Path) -> None:
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "whole")
    journal = files / "whole/points.jsonl"
    lines = journal.read_text(encoding="utf-8").splitlines()
    # two points were done, and the third was being written
    (files / "part").mkdir()
    torn = "\n".join([*lines[:3], lines[3][: len(lines[3]) // 2]])
    (files / "part/points.jsonl").write_text(torn, encoding="utf-8")
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "part", "--resume")
    first, second = (pq.read_table(files / name / "points.parquet") for name in ("whole", "part"))
    assert same(first, second)


def test_what_is_resumed_has_to_be_the_same(cli: Cli, files: Path) -> None:
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out")
    (files / "sweep.yaml").write_text(OVER.replace("steps: 3", "steps: 4"), encoding="utf-8")
    said = cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out", "--resume", check=2)
    assert "points.jsonl:1: is of another sweep" in said.stderr


@pytest.mark.slow
@pytest.mark.parametrize("design", ["latin_hypercube", "sobol"])
def test_workers_and_seeds_give_the_same_points(cli: Cli, files: Path, design: str) -> None:
    text = f"design: {design}\npoints: 5\nseed: 3\n{OVER}"
    (files / "sweep.yaml").write_text(text, encoding="utf-8")
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "a")
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "b", "--workers", "2")
    first, second = (pq.read_table(files / name / "points.parquet") for name in "ab")
    assert first.num_rows == 5
    assert same(first, second)
    gains = np.array(first.column("pressure.k_p"))
    assert np.unique(gains).size == 5
    assert gains.min() >= 2e-6
    assert gains.max() <= 8e-6


def test_trials_and_effects_are_varied_too(cli: Cli, files: Path) -> None:
    (files / "model.yaml").write_text(
        "model: eha_knee\neffects: [{effect: command_delay, delay: 1 ms}]\n"
    )
    (files / "sweep.yaml").write_text(
        "over:\n"
        "  parameters: {command_delay.delay: [0.5 ms, 3 ms]}\n"
        "  trials: {step.signal.final: [5 MPa, 12 MPa], defaults.sample_rate: [1 kHz]}\n"
    )
    cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--target", "model.yaml", "--out", "out")
    table = pq.read_table(files / "out/points.parquet").to_pylist()
    assert [row["step.signal.final"] for row in table] == [5e6, 12e6] * 2
    assert [row["command_delay.delay"] for row in table] == pytest.approx([5e-4, 5e-4, 3e-3, 3e-3])
    assert len({row["value:step.peak"] for row in table}) == 4


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("over: {gains: {pressure.k_x: [1, 2]}}", "sweep.yaml:1, key 'over.gains.pressure.k_x': "
         "no controller has a gain 'pressure.k_x'; did you mean 'pressure.k_"),
        ("over:\n  gains:\n    pressure.k_p: {from: 4 A/MPa, to: 4 A/MPa}",
         "sweep.yaml:3, key 'over.gains.pressure.k_p.to': the range is empty: it goes from 4"),
        ("over:\n  gains:\n    pressure.k_p: {from: 4 bar, to: 8 bar}", "sweep.yaml:3, key "
         "'over.gains.pressure.k_p.from': unit 'bar' has the wrong dimension"),
        ("over: {gains: {pressure.k_p: []}}", "the list is empty"),
        ("over: {parameters: {bulk: [1, 2]}}", "the model has no parameter 'bulk'"),
        ("over: {parameters: {entrained_air.air_fraction: [0.01]}}",
         "is of an effect that the model does not declare; declare entrained_air"),
        ("over: {parameters: {bulk_modulus: [1 Pa]}}", "is outside"),
        ("over: {trials: {stop.signal.at: [1 ms]}}", "names no trial of the suite"),
        ("over: {trials: {step.signal.fin: [1 MPa]}}", "unknown key 'fin'"),
        ("over: {}", "there is nothing to vary; add a block: gains, parameters, trials"),
        ("design: sobol\nover: {gains: {pressure.k_p: [1 A/MPa]}}", "'points' is missing"),
        ("over: {gains: {pressure.k_p: {from: 0 A/MPa, to: 1 A/MPa, scale: log}}}",
         "a logarithmic range cannot start at 0 A/MPa"),
        ("trials: []", "this is a suite, and a sweep is expected"),
        ("over: {gains: {pressure.k_p: {from: 1, to: 2, steps: 2000}, pressure.k_i: {from: 1, to: "
         "2, steps: 2000}}}", "the grid has 4e+06 points, more than 1e+06"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(cli: Cli, files: Path, text: str, told: str) -> None:
    (files / "sweep.yaml").write_text(text + "\n", encoding="utf-8")
    said = cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out", check=2)
    assert told in said.stderr
    assert not (files / "out").exists()


def test_a_suite_without_limits_cannot_be_swept(cli: Cli, files: Path) -> None:
    (files / "hold.yaml").write_text(SUITE.partition("    accept")[0], encoding="utf-8")
    said = cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out", check=2)
    assert "no acceptance limit" in said.stderr


def test_a_folder_of_something_else_is_left_alone(cli: Cli, files: Path) -> None:
    (files / "out").mkdir()
    (files / "out/mine.txt").write_text("mine")
    said = cli("sweep", "hold.yaml", "--over", "sweep.yaml", "--out", "out", check=2)
    assert "is not empty and holds no sweep" in said.stderr
    assert [path.name for path in (files / "out").iterdir()] == ["mine.txt"]


def test_validate_and_schema_know_a_sweep(cli: Cli, files: Path) -> None:
    assert "a valid sweep" in cli("validate", "sweep.yaml", check=0).stderr
    (files / "sweep.yaml").write_text("over: {gain: {}}\n")
    assert "unknown key 'gain'" in cli("validate", "sweep.yaml", check=2).stderr
    assert "over" in json.loads(cli("schema", "sweep", check=0).stdout)["properties"]


@pytest.mark.slow
def test_a_class_of_the_users_own_is_swept_by_workers(cli: Cli, files: Path) -> None:
    write_own_controller(files, "own.yaml")
    (files / "target.yaml").write_text("target: simulator\nmodel: paper\ncontroller: own.yaml\n")
    (files / "sweep.yaml").write_text("over: {gains: {pressure.gain: [0.5 A/MPa, 2 A/MPa]}}\n")
    words = ("sweep", "hold.yaml", "--over", "sweep.yaml", "--target", "target.yaml")
    cli(*words, "--out", "a")
    cli(*words, "--out", "b", "--workers", "2")
    first, second = (pq.read_table(files / name / "points.parquet") for name in "ab")
    assert first.column("reason").to_pylist() == ["", ""]
    assert same(first, second)
