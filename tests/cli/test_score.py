"""`eha-bench score` on logs that were made elsewhere."""

import json
from pathlib import Path

import numpy as np
import pytest

from .conftest import Cli

LOGS = ("locked_steps", "locked_stairs", "locked_sine", "locked_multisine", "locked_prbs",
        "bypass_ramps", "bypass_sine", "free_steps", "free_swing", "free_sine")  # fmt: skip
MODE = {"channels_0": "current", "channels_1": "pressure", "channels_2": "piston_position"}

FOREIGN = """\
name: foreign
trials:
  - id: any
    mode: {mode}
    signal: {{kind: recorded}}
    scores: [tracking_rms, rise_time]
"""


def map_of(folder: Path, log: str) -> str:
    from ruamel.yaml import YAML

    dataset = YAML(typ="safe").load((folder / "dataset.yaml").read_text(encoding="utf-8"))
    runs = {run["log"]: run["channels"] for run in dataset["runs"]}
    return str(runs[f"{log}.mcap"])


@pytest.mark.parametrize("log", LOGS)
def test_every_log_of_the_rig_is_scored_by_its_own_reference(
    cli: Cli, shared_data: Path, tmp_path: Path, log: str
) -> None:
    folder = shared_data / "rig_samples" / "D"
    mapping = map_of(folder, log)
    suite = tmp_path / "foreign.yaml"
    suite.write_text(FOREIGN.format(mode=MODE[mapping.removesuffix(".yaml")]), encoding="utf-8")
    done = cli(
        "score", folder / f"{log}.mcap", "--suite", suite, "--channels", folder / mapping,
        "--out", "scored",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "scored" / "result.json").read_text(encoding="utf-8"))
    scores = {score["metric"]: score for score in result["trials"][0]["scores"]}
    assert scores["tracking_rms"]["value"] > 0
    for score in scores.values():
        assert score["value"] is not None or score["reason"]
    assert (tmp_path / "scored" / "report.html").is_file()


def test_bags_are_scored_too(cli: Cli, shared_data: Path, tmp_path: Path) -> None:
    suite = tmp_path / "foreign.yaml"
    suite.write_text(FOREIGN.format(mode="current"), encoding="utf-8")
    cases = {
        "rosbag2_mcap/cdr_test": None,
        "rosbag1/example.bag": None,
    }
    for name in cases:
        bag = shared_data / "bags" / name
        done = cli("score", bag, "--suite", suite, "--out", "scored")
        # no channel map: the message names the way out
        assert done.returncode == 2
        assert "channels" in done.stderr


CSV_MAP = "time: {column: t, unit: s}\nchannels:\n  pressure_difference: {column: p, unit: MPa}\n" \
    "  reference: {column: r, unit: MPa}\n"  # fmt: skip


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty"),
        ("t,p,r\n", "empty|no sample|no row"),
        ("t,p,q\n0,1,2\n1,2,3\n", "'r'|r"),
        ("t,p,r\n0,1,2\n1,x,3\n", "x|number"),
    ],
)
def test_a_broken_log_is_one_sentence(
    cli: Cli, tmp_path: Path, content: str, message: str
) -> None:
    (tmp_path / "log.csv").write_text(content, encoding="utf-8")
    (tmp_path / "channels.yaml").write_text(CSV_MAP, encoding="utf-8")
    (tmp_path / "s.yaml").write_text(FOREIGN.format(mode="pressure"), encoding="utf-8")
    done = cli(
        "score", "log.csv", "--suite", "s.yaml", "--channels", "channels.yaml", "--out", "o"
    )
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "log.csv" in done.stderr
    assert any(word in done.stderr for word in message.split("|"))
    assert not (tmp_path / "o").exists()


def test_a_nan_in_a_log_is_said_and_not_guessed_over(cli: Cli, tmp_path: Path) -> None:
    time = np.arange(400) / 1000
    reference = np.where(time < 0.1, 0.0, 10.0)
    measured = 10 * (1 - np.exp(-np.maximum(time - 0.1, 0) / 0.01))
    rows = [f"{t:.3f},{p:.5f},{r}" for t, p, r in zip(time, measured, reference, strict=True)]
    rows[120] = "0.120,nan,10.0"
    (tmp_path / "log.csv").write_text("t,p,r\n" + "\n".join(rows) + "\n", encoding="utf-8")
    (tmp_path / "channels.yaml").write_text(CSV_MAP, encoding="utf-8")
    (tmp_path / "s.yaml").write_text(FOREIGN.format(mode="pressure"), encoding="utf-8")
    done = cli(
        "score", "log.csv", "--suite", "s.yaml", "--channels", "channels.yaml", "--out", "o",
        check=0,
    )  # fmt: skip
    result = json.loads((tmp_path / "o" / "result.json").read_text(encoding="utf-8"))
    rise = next(s for s in result["trials"][0]["scores"] if s["metric"] == "rise_time")
    text = " ".join([rise["reason"], *result["trials"][0]["notes"], done.stderr])
    assert "0.12" in text


def test_a_log_that_belongs_to_no_trial_says_so(cli: Cli, tmp_path: Path, suite: Path) -> None:
    (tmp_path / "log.csv").write_text("t,p,r\n0,1,2\n0.001,2,3\n", encoding="utf-8")
    (tmp_path / "channels.yaml").write_text(CSV_MAP, encoding="utf-8")
    done = cli(
        "score", "log.csv", "--suite", suite, "--channels", "channels.yaml", check=2
    )
    assert "--trial" in done.stderr
