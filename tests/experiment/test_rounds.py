"""From recordings that leave two causes open to one name, by an experiment (slow)."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from experiment_question import rival, write_question

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.rounds import Round, Settled, _beside_the_plant, close
from eha_bench.targets.resolve import open_target
from spindle_plant import SPINDLE

PLANT = SPINDLE + "calibrate: [shaft.inertia, drag.viscous, drag.coulomb]\n"
TRIALS = """\
name: first
defaults: {mode: current, sample_rate: 500 Hz, safety: {motor_speed: -300 rad/s .. 300 rad/s}}
trials:
  - {id: slow, duration: 6 s, signal: {kind: sine, amplitude: 8 A, frequency: 0.7 Hz}}
  - {id: slower, duration: 6 s, signal: {kind: sine, amplitude: 8 A, frequency: 0.5 Hz}}
"""
DATASET = """\
model: plant.yaml
inputs: [current_command]
runs:
  - {log: first-run/recordings/slow-0.mcap, use: train}
  - {log: first-run/recordings/slower-0.mcap, use: holdout}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "truth", ["current_lag, time_constant: 4 ms", "command_delay, delay: 4 ms"]
)
def test_rounds_end_with_the_one_right_name(tmp_path: Path, truth: str):
    (tmp_path / "plant.yaml").write_text(PLANT)
    (tmp_path / "truth.yaml").write_text(f"model: plant.yaml\neffects: [{{effect: {truth}}}]\n")
    (tmp_path / "rig.yaml").write_text(
        "target: simulator\nmodel: truth.yaml\nsensors: {motor_speed: {noise: 0.3 rad/s}}\n"
    )
    (tmp_path / "first.yaml").write_text(TRIALS)
    (tmp_path / "dataset.yaml").write_text(DATASET)
    eb.run(tmp_path / "first.yaml", tmp_path / "rig.yaml", tmp_path / "first-run")
    found = close(
        tmp_path / "dataset.yaml", tmp_path / "rig.yaml", tmp_path / "loop",
        safety=tmp_path / "first.yaml", budget=10.0,
    )  # fmt: skip
    assert found.ending is Settled.SETTLED
    first, *_, last = found.rounds
    assert first.diagnosis["equivalent"]
    assert [item["id"] for item in last.diagnosis["effects"]] == [truth.split(",", maxsplit=1)[0]]
    assert last.diagnosis["equivalent"] == []
    assert found.bench_seconds < 10.0
    assert (tmp_path / "loop" / "rounds.html").exists()


def test_a_simulator_of_another_plant_is_noted(tmp_path: Path):
    _dataset(tmp_path)
    dataset = load_dataset(tmp_path / "dataset.yaml")
    (tmp_path / "knee.yaml").write_text("model: eha_knee\n")
    for model, noted in (("knee.yaml", True), ("plant.yaml", False)):
        (tmp_path / "target.yaml").write_text(f"target: simulator\nmodel: {model}\n")
        opened = open_target(str(tmp_path / "target.yaml"))
        notes = _beside_the_plant(dataset, opened, "target.yaml")
        assert bool(notes) is noted
        if noted:
            assert notes[0].startswith("target.yaml simulates 'eha_knee', and the dataset's model")


def test_a_target_without_any_channel_of_the_plant_is_another_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    _dataset(tmp_path)
    furnace = SimpleNamespace(units={"temperature": "K"})
    monkeypatch.setattr("eha_bench.rounds.open_target", lambda _: furnace)
    with pytest.raises(InputError, match="records none of motor_speed"):
        close(tmp_path / "dataset.yaml", "furnace.yaml", tmp_path / "loop")


def _dataset(folder: Path) -> None:
    (folder / "plant.yaml").write_text(PLANT)
    (folder / "log.csv").write_text("t,i\n0,0\n")
    (folder / "channels.yaml").write_text("channels: {current_command: {column: i, unit: A}}\n")
    (folder / "dataset.yaml").write_text(
        "model: plant.yaml\nruns: [{log: log.csv, channels: channels.yaml, use: train}]\n"
    )


@pytest.mark.parametrize(
    ("verdict", "ending"), [("none", Settled.SETTLED), ("unknown", Settled.NONE_PERMITTED)]
)
def test_an_unknown_that_nothing_can_play_is_not_settled(
    tmp_path: Path, verdict: str, ending: Settled
):
    _dataset(tmp_path)
    (tmp_path / "rig.yaml").write_text("target: simulator\nmodel: plant.yaml\n")
    # a folder's diagnosis is taken as it is
    place = write_question(
        tmp_path / "loop/round-1/diagnosis",
        [rival(None, source=str(tmp_path / "plant.yaml"), known=("drag.coulomb",))],
        noise={"motor_speed": 0.3},
        extremes={"current_command": (-8.0, 8.0), "motor_speed": (-100.0, 100.0)},
        piston="free",
    )
    content = json.loads((place / "diagnosis.json").read_text())
    unknown = {"equation": "torque", "variables": [], "description": ""}
    content |= {"verdict": verdict, "complete": True} | (
        {"unknown": unknown} if verdict == "unknown" else {}
    )
    (place / "diagnosis.json").write_text(json.dumps(content))
    noted = ("rig.yaml simulates something else",)
    (tmp_path / "loop/rounds.json").write_text(json.dumps({"notes": noted}))
    found = close(tmp_path / "dataset.yaml", tmp_path / "rig.yaml", tmp_path / "loop")
    assert found.ending is ending
    # what was noted before an interruption is still to be known
    assert found.notes == noted
    page = (tmp_path / "loop/rounds.html").read_text()
    sentence = found.rounds[-1].to_dict()["experiment"]
    assert sentence[1:] in page.replace("\n", " ")


def test_what_is_not_distinguished_is_named_with_what_was_found(tmp_path: Path):
    found = Round(
        1, tmp_path,
        {"verdict": "effect", "effects": [{"id": "command_delay"}, {"id": "gravity_load"}],
         "equivalent": [["command_delay", "command_lag"]]},
    )  # fmt: skip
    assert found.causes == ("command_delay or command_lag", "gravity_load")
