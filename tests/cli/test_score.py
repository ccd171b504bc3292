"""`eha-bench score` on logs that were made elsewhere."""

import dataclasses
import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb

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


TURTLE_MAP = """\
clock: log
channels:
  reference:   {topic: /turtle1/cmd_vel, field: angular.z, unit: rad/s}
  motor_speed: {topic: /turtle1/pose, field: angular_velocity, unit: rad/s}
"""


def test_a_ros_1_bag_is_scored(cli: Cli, shared_data: Path, tmp_path: Path) -> None:
    (tmp_path / "suite.yaml").write_text(FOREIGN.format(mode="motor_speed"), encoding="utf-8")
    (tmp_path / "turtle.yaml").write_text(TURTLE_MAP, encoding="utf-8")
    bag = shared_data / "bags" / "rosbag1" / "example.bag"
    cli("score", bag, "--suite", "suite.yaml", "--channels", "turtle.yaml", "--out", "o", check=0)
    result = json.loads((tmp_path / "o" / "result.json").read_text(encoding="utf-8"))
    scores = {score["metric"]: score for score in result["trials"][0]["scores"]}
    assert 0 < scores["tracking_rms"]["value"] < 2
    assert result["trials"][0]["notes"]


def test_a_rosbag2_written_by_another_library_is_scored(cli: Cli, tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    message = store.types["std_msgs/msg/Float64"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            name: writer.add_connection(f"/{name}", message.__msgtype__, typestore=store)
            for name in ("p", "r")
        }
        for tick in range(600):
            time = tick * 1e-3
            wanted = 0.0 if time < 0.1 else 10.0
            reached = 0.0 if time < 0.1 else 10 * (1 - math.exp(-(time - 0.1) / 0.02))
            for name, value in (("p", reached), ("r", wanted)):
                raw = store.serialize_cdr(message(data=value), message.__msgtype__)
                writer.write(connections[name], 1_000_000_000 + tick * 1_000_000, raw)
    (tmp_path / "suite.yaml").write_text(FOREIGN.format(mode="pressure"), encoding="utf-8")
    (tmp_path / "map.yaml").write_text(
        "channels:\n  pressure_difference: {topic: /p, field: data, unit: bar}\n"
        "  reference: {topic: /r, field: data, unit: bar}\n",
        encoding="utf-8",
    )
    cli("score", "bag", "--suite", "suite.yaml", "--channels", "map.yaml", "--out", "o", check=0)
    result = json.loads((tmp_path / "o" / "result.json").read_text(encoding="utf-8"))
    scores = {score["metric"]: score for score in result["trials"][0]["scores"]}
    assert scores["rise_time"]["value"] == pytest.approx(0.02 * math.log(9), rel=0.01)


def test_a_foreign_bag_without_a_map_names_the_way_out(
    cli: Cli, shared_data: Path, tmp_path: Path
) -> None:
    (tmp_path / "suite.yaml").write_text(FOREIGN.format(mode="current"), encoding="utf-8")
    bag = shared_data / "bags" / "rosbag2_mcap" / "cdr_test"
    done = cli("score", bag, "--suite", "suite.yaml", "--out", "o", check=2)
    assert "channels" in done.stderr
    assert not (tmp_path / "o").exists()


def test_scoring_executes_nothing_that_a_recording_holds(
    cli: Cli, ran: Path, tmp_path: Path
) -> None:
    recording = eb.read(ran / "recordings" / "sine-0.mcap")
    (tmp_path / "evil.py").write_text(
        "from pathlib import Path\nPath('owned').touch()\n"
        "from eha_bench.control.open_loop import OpenLoop as Evil\n",
        encoding="utf-8",
    )
    attachments = {
        **recording.attachments,
        "controller.yaml": b"current: {controller: 'evil:Evil'}",
        "suite.yaml": b"controller: evil.yaml",
    }
    eb.write("held.mcap", dataclasses.replace(recording, attachments=attachments))
    cli("score", "held.mcap", "--out", "o", check=0)
    assert not (tmp_path / "owned").exists()
    assert "evil" not in sys.modules


def test_a_name_in_a_recording_never_becomes_a_path(cli: Cli, ran: Path, tmp_path: Path) -> None:
    recording = eb.read(ran / "recordings" / "sine-0.mcap")
    trial = json.loads(recording.attachments["trial.json"])
    trial["id"] = "../../outside"
    attachments = {**recording.attachments, "trial.json": json.dumps(trial).encode()}
    metadata = {**recording.metadata, "trial": "../../outside"}
    changed = dataclasses.replace(recording, attachments=attachments, metadata=metadata)
    eb.write("held.mcap", changed)
    before = set(tmp_path.parent.iterdir())
    done = cli("score", "held.mcap", "--out", "o", check=2)
    assert "outside" in done.stderr
    assert set(tmp_path.parent.iterdir()) == before
    assert not (tmp_path / "o").exists()


def test_a_truncated_recording_is_scored_to_its_tear_or_refused_in_a_sentence(
    cli: Cli, shared_data: Path, tmp_path: Path
) -> None:
    folder = shared_data / "rig_samples" / "D"
    whole = (folder / "locked_sine.mcap").read_bytes()
    (tmp_path / "torn.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    (tmp_path / "suite.yaml").write_text(FOREIGN.format(mode="pressure"), encoding="utf-8")
    done = cli(
        "score", "torn.mcap", "--suite", "suite.yaml",
        "--channels", folder / map_of(folder, "locked_sine"), "--out", "o",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "o" / "result.json").read_text(encoding="utf-8"))
    assert any("torn" in note for note in result["trials"][0]["notes"])


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
def test_a_broken_log_is_one_sentence(cli: Cli, tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "log.csv").write_text(content, encoding="utf-8")
    (tmp_path / "channels.yaml").write_text(CSV_MAP, encoding="utf-8")
    (tmp_path / "s.yaml").write_text(FOREIGN.format(mode="pressure"), encoding="utf-8")
    done = cli("score", "log.csv", "--suite", "s.yaml", "--channels", "channels.yaml", "--out", "o")
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


def _score_step(cli: Cli, folder: Path, samples: int, check: int = 0) -> str:
    """Score the first samples of a step of 0.4 s by its own reference; return what is said."""
    time = np.arange(samples) / 1000
    reference = np.where(time < 0.1, 0.0, 10.0)
    rows = [f"{t:.3f},{r:.5f},{r}" for t, r in zip(time, reference, strict=True)]
    (folder / "log.csv").write_text("t,p,r\n" + "\n".join(rows) + "\n", encoding="utf-8")
    suite = FOREIGN.format(mode="pressure") + "    duration: 0.4 s\n"
    (folder / "s.yaml").write_text(suite, encoding="utf-8")
    done = cli(
        "score", "log.csv", "--suite", "s.yaml", "--channels", "channels.yaml", "--out", "o",
        check=check,
    )  # fmt: skip
    return done.stderr


def test_a_log_shorter_than_its_trial_is_said_to_be(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "channels.yaml").write_text(CSV_MAP, encoding="utf-8")
    assert "note: any: the recording lasts 0.199 s, and the trial 0.4 s" in _score_step(
        cli, tmp_path, 200
    )
    assert "note:" not in _score_step(cli, tmp_path, 400)


def test_a_reference_in_another_quantity_is_refused(cli: Cli, tmp_path: Path) -> None:
    content = CSV_MAP.replace("{column: r, unit: MPa}", "{column: r, unit: A}")
    assert content != CSV_MAP
    (tmp_path / "channels.yaml").write_text(content, encoding="utf-8")
    said = _score_step(cli, tmp_path, 400, check=2)
    assert "log.csv: its reference is in A, and trial 'any' controls pressure_difference" in said


def test_a_log_that_belongs_to_no_trial_says_so(cli: Cli, tmp_path: Path, suite: Path) -> None:
    (tmp_path / "log.csv").write_text("t,p,r\n0,1,2\n0.001,2,3\n", encoding="utf-8")
    (tmp_path / "channels.yaml").write_text(CSV_MAP, encoding="utf-8")
    done = cli("score", "log.csv", "--suite", suite, "--channels", "channels.yaml", check=2)
    assert "--trial" in done.stderr


def test_scores_name_recordings_from_their_own_folder(cli: Cli, ran: Path, tmp_path: Path) -> None:
    """As a run does: whoever reads result.json finds the recording, wherever they stand."""
    done = cli("score", "ran/recordings/hold-0.mcap", "--out", "some/where", "--json", check=0)
    (trial,) = json.loads(done.stdout)["trials"]
    assert trial["recording"] == "../../ran/recordings/hold-0.mcap"
    assert json.loads((tmp_path / "some/where/result.json").read_text()) == json.loads(done.stdout)
    assert (tmp_path / "some/where" / trial["recording"]).is_file()
    assert "No plot" not in (tmp_path / "some/where/report.html").read_text()


def test_scores_do_not_take_the_place_of_a_run(cli: Cli, ran: Path) -> None:
    before = Path("ran/result.json").read_bytes()
    done = cli("score", "ran/recordings/hold-0.mcap", "--out", "ran", check=2)
    assert "ran: holds the result of a run" in done.stderr
    assert Path("ran/result.json").read_bytes() == before
    for _ in range(2):  # scores may be made again
        cli("score", "ran/recordings/hold-0.mcap", "--out", "scored", check=0)


def test_a_file_name_that_is_no_text_is_one_sentence(cli: Cli, ran: Path) -> None:
    odd = os.fsdecode(b"b\xffd.mcap")
    try:
        Path(odd).write_bytes(Path("ran/recordings/hold-0.mcap").read_bytes())
    except OSError:
        pytest.skip("this file system takes no such name")
    done = cli("score", odd, "--out", "scored", check=2)
    assert "a file name is not UTF-8" in done.stderr
    assert "b\\udcffd.mcap" in done.stderr
    assert not list(Path("scored").iterdir())


ONE = """\
name: one
trials:
  - id: {id}
    mode: current
    setup: {{piston: locked}}
    duration: 20 ms
    signal: {{kind: step, final: 5 A, at: 5 ms}}
"""


def test_a_recording_of_a_trial_that_the_suite_lacks_is_not_taken_for_its_only_one(
    cli: Cli, tmp_path: Path
) -> None:
    for name in ("small", "large"):
        (tmp_path / f"{name}.yaml").write_text(ONE.format(id=name), encoding="utf-8")
    cli("run", "large.yaml", "--out", "ran", check=0)
    made = "ran/recordings/large-0.mcap"
    done = cli("score", made, "--suite", "small.yaml", "--out", "scored", check=2)
    assert "large-0.mcap: is a recording of trial 'large'" in done.stderr
    assert "give --trial; the suite has: small" in done.stderr
    assert not (tmp_path / "scored").exists()
    note = "its metadata names trial 'large'; scored as 'small'"
    cli("score", made, "--suite", "small.yaml", "--trial", "small", "--out", "o", check=0)
    assert note in json.loads(Path("o/result.json").read_text())["trials"][0]["notes"]
    Path(made).rename("small-0.mcap")
    cli("score", "small-0.mcap", "--suite", "small.yaml", "--out", "p", check=0)
    assert note in json.loads(Path("p/result.json").read_text())["trials"][0]["notes"]


def test_a_recording_that_names_no_trial_is_of_the_only_one(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(ONE.format(id="one"), encoding="utf-8")
    time = np.arange(0, 0.02, 1e-3)
    recording = eb.Recording(time, {"reference": time, "current": time})
    eb.write(tmp_path / "log.mcap", recording)
    cli("score", "log.mcap", "--suite", "one.yaml", "--out", "o", check=0)
    result = json.loads(Path("o/result.json").read_text())
    assert result["trials"][0]["id"] == "one"
    digests = [result["provenance"][f"{key}_sha256"] for key in ("model", "controller")]
    assert digests == ["", ""]
    assert "Model, SHA-256" not in Path("o/report.html").read_text()


def test_scores_come_from_the_model_that_all_recordings_name(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(ONE.format(id="one"), encoding="utf-8")
    (tmp_path / "stiff.yaml").write_text(
        "model: eha_knee\nparameters: {bulk_modulus: 1.2 GPa}\n", encoding="utf-8"
    )
    cli("run", "one.yaml", "--out", "a", check=0)
    cli("run", "one.yaml", "--target", "stiff.yaml", "--out", "b", check=0)
    first, second = "a/recordings/one-0.mcap", "b/recordings/one-0.mcap"

    def digests(*recordings: str) -> dict[str, str]:
        cli("score", *recordings, "--out", "o", check=0)
        said = json.loads(Path("o/result.json").read_text())["provenance"]
        return {key: said[key] for key in ("model_sha256", "controller_sha256")}

    ran = json.loads(Path("a/result.json").read_text())["provenance"]
    assert digests(first) == {key: ran[key] for key in ("model_sha256", "controller_sha256")}
    together = digests(first, second)
    assert together["model_sha256"] == ""
    assert together["controller_sha256"] == ran["controller_sha256"]
