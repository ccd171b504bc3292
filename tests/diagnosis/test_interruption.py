"""Ctrl-C, pressed while calibrating or searching, keeps what was found; and nothing is random."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drive_data import write_drive

from eha_bench.cli.main import main
from eha_bench.core.workers import Processes
from eha_bench.diagnosis.conclusion import Conclusion
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.evidence import NOT_COMPARED
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Verdict
from eha_bench.diagnosis.outcome.refusal import Refusal
from eha_bench.diagnosis.replay.prediction import predict
from eha_bench.plants.model import load_model
from forked import Forked

# the command, with a Ctrl-C at the moment a stage begins
PRESS = """\
import os, signal, sys
from eha_bench.cli import closing
from eha_bench.cli.main import main
from eha_bench.core.workers import Processes
stage, least = sys.argv.pop(1), float(sys.argv.pop(1))
pressed = []
def stages(bar):
    def tell(now, share):
        if now == stage and share >= least and not pressed:
            pressed.append(now)
            os.kill(os.getpid(), signal.SIGINT)
    return tell
closing._stages = stages
main()
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    return write_drive(tmp_path_factory.mktemp("drive"), seconds=1.5)


@pytest.fixture(scope="module")
def diagnosed(dataset, tmp_path_factory):
    """The whole diagnosis, its folder, and the stages that it told of."""
    folder = tmp_path_factory.mktemp("diagnosed")
    stages: list[str] = []
    return diagnose(dataset, folder, lambda stage, _: stages.append(stage)), folder, stages


def _pressed(
    forked: Forked, folder: Path, stage: str, share: float, *arguments: str
) -> subprocess.CompletedProcess[str]:
    return forked.run(stage, share, *arguments, folder=folder, code=PRESS)


@pytest.mark.slow
def test_a_program_of_several_diagnoses_ends_once_the_first_is_kept(
    forked, dataset, tmp_path
) -> None:
    code = f"""\
import os, signal
import eha_bench as eb
def tell(stage, share):
    if stage == "search":
        os.kill(os.getpid(), signal.SIGTERM)
for name in ("first", "second"):
    eb.diagnose({str(dataset)!r}, name, tell)
"""
    done = forked.run(folder=tmp_path, code=code)
    assert done.returncode == -signal.SIGTERM, done.stderr
    found = json.loads((tmp_path / "first" / "diagnosis.json").read_text())
    assert found["complete"] is False
    assert (tmp_path / "first" / "diagnosis.html").exists()
    assert not (tmp_path / "second").exists()


@pytest.mark.parametrize(
    ("stage", "share", "verdict", "says"),
    [
        ("calibrate", 0.1, "unknown", "interrupted while calibrating"),
        pytest.param(
            "calibrate", 0.6, "unknown", "interrupted while calibrating", marks=pytest.mark.slow
        ),
        pytest.param(
            "search", 0.0, "unknown", "interrupted during the search", marks=pytest.mark.slow
        ),
    ],
)
def test_what_was_found_is_kept(forked, dataset, tmp_path, stage, share, verdict, says) -> None:
    done = _pressed(forked, tmp_path, stage, share, "diagnose", str(dataset), "--out", ".")
    assert done.returncode == 130, done.stderr
    assert says in done.stderr
    assert "Traceback" not in done.stderr
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["complete"] is False
    assert found["verdict"] == verdict
    assert found["effects"] == []
    # nothing was located, and no equation is guessed
    assert found["unknown"]["equation"] is None
    assert found["unknown"]["variables"] == []
    assert says in found["unknown"]["description"]
    # the runs are scored all the same, and the files are whole
    assert found["error"]["holdout"]["piston_position"]["after"] > 0.0
    assert "Interrupted" in (tmp_path / "diagnosis.html").read_text()
    for name in ("revised.yaml", "recalibrated.yaml"):
        assert load_model(tmp_path / name).value("mass") > 50.0
    assert not list(tmp_path.glob(".*"))


@pytest.mark.slow
def test_an_effect_that_was_found_is_kept(forked, dataset, tmp_path) -> None:
    """Pressed when the next look begins; where no look is needed any more, all was done."""
    done = _pressed(forked, tmp_path, "search", 0.25, "diagnose", str(dataset), "--out", ".")
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert [item["id"] for item in found["effects"]] == ["coulomb_friction"]
    assert done.returncode == (0 if found["complete"] else 130)


@pytest.mark.slow
def test_a_calibration_keeps_its_values(forked, dataset, tmp_path) -> None:
    done = _pressed(forked, tmp_path, "calibrate", 0.4, "calibrate", str(dataset), "--out", ".")
    assert done.returncode == 130, done.stderr
    found = json.loads((tmp_path / "calibration.json").read_text())
    assert found["complete"] is False
    assert load_model(tmp_path / "calibrated.yaml").parameters["mass"] != 95.0


@pytest.mark.slow  # starts processes
def test_the_same_input_gives_the_same_output_also_by_processes(
    dataset, diagnosed, tmp_path
) -> None:
    one, folder, stages = diagnosed
    two = diagnose(dataset, tmp_path, workers=Processes(2))
    assert one.to_dict() | {"seconds": 0} == two.to_dict() | {"seconds": 0}
    assert (folder / "revised.yaml").read_text() == (tmp_path / "revised.yaml").read_text()
    np.testing.assert_array_equal(one.revised.vector(), two.revised.vector())
    # progress is told while it works
    assert {"read", "calibrate", "search", "replay", "done"} <= set(stages)
    assert one.verdict is Verdict.EFFECT
    assert one.effects[0].id == "coulomb_friction"
    estimate = one.effects[0].parameters["friction_force"]
    assert estimate.low < 20.0 < estimate.high


def test_the_errors_are_those_of_predict(dataset, diagnosed) -> None:
    found, folder, _ = diagnosed
    for name in ("recalibrated", "revised"):
        runs = {item.run: item.values for item in predict(dataset, folder / f"{name}.yaml")}
        replay = next(item for item in found.replays if item.run == "held")
        error = replay.measured["piston_position"] - runs["held"]["piston_position"]
        rms = float(np.sqrt(np.mean(error**2)))
        told = found.holdout["piston_position"]
        expected = told.before_predict if name == "recalibrated" else told.after_predict
        assert rms == pytest.approx(expected, rel=0.02)
        assert rms >= 0.98 * (told.before if name == "recalibrated" else told.after)
    assert (
        found.holdout["piston_position"].after < 1.3 * found.holdout["piston_position"].noise_floor
    )


@pytest.mark.parametrize("command", ["diagnose", "calibrate", "predict"])
def test_where_results_cannot_go_is_said_before_the_work(
    command, tmp_path, monkeypatch, capsys
) -> None:
    """A diagnosis of minutes is not lost to a slip in --out."""
    path = write_drive(tmp_path, seconds=0.2)
    (tmp_path / "train.csv").write_text("not looked at yet")
    (tmp_path / "file").touch()
    more = ["--model", str(tmp_path / "model.yaml")] if command == "predict" else []
    given = ["eha-bench", command, str(path), "--out", str(tmp_path / "file"), *more]
    monkeypatch.setattr("sys.argv", given)
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert "file: is a file; name a folder with --out" in capsys.readouterr().err


def test_an_effect_that_was_on_trial_is_not_named() -> None:
    """Both of a pair stand in the search while they are compared."""

    class Pair(SimpleNamespace):
        @property
        def effects(self) -> list[SimpleNamespace]:
            return [*self.accepted]

    search = Pair(
        accepted=[SimpleNamespace(comparison=NOT_COMPARED)],
        fit="with it",
        base="without",
        excess_left="little",
        excess_base=SimpleNamespace(significance=50.0, relative=0.5, bursts=0.0),
        thresholds=DEFAULT,
    )
    conclusion = object.__new__(Conclusion)
    conclusion.search = search
    decision = conclusion._decision_so_far()
    assert (search.accepted, search.fit) == ([], "without")
    assert decision.verdict is Verdict.UNKNOWN
    assert "before any cause had stood its test" in decision.notes[0]


@pytest.mark.parametrize(
    ("relative", "significance", "verdict"),
    [
        (0.01, 2.0, Verdict.NONE),
        (0.5, 50.0, Verdict.UNKNOWN),
        # a slow log shows little structure, and a search that was stopped has not looked
        (1.3, 2.0, Verdict.UNKNOWN),
    ],
)
def test_a_stopped_search_says_nothing_is_missing_only_of_what_is_down_to_the_noise(
    relative: float, significance: float, verdict: Verdict
) -> None:
    missing = SimpleNamespace(significance=significance, relative=relative, bursts=0.0)
    conclusion: Any = object.__new__(Conclusion)
    conclusion.search = SimpleNamespace(
        accepted=[], effects=(), fit="fit", excess_base=missing, thresholds=DEFAULT
    )
    assert conclusion._decision_so_far().verdict is verdict


@pytest.mark.parametrize(
    ("names", "refused", "left"),
    [
        (["relief_valve"], [], ["relief_valve"]),
        (["relief_valve"], ["relief_valve"], []),
        # what stands is not lost with what does not
        (["external_leakage", "stribeck_friction"], ["stribeck_friction"], ["external_leakage"]),
        (["external_leakage", "relief_valve"], ["relief_valve", "external_leakage"], []),
    ],
)
def test_an_interrupted_search_names_nothing_that_its_own_figures_refuse(
    monkeypatch: pytest.MonkeyPatch, names: list[str], refused: list[str], left: list[str]
) -> None:
    items = {name: SimpleNamespace(start=SimpleNamespace(candidate=name)) for name in names}
    search = SimpleNamespace(fit="with all", base="without", excess_left=0, excess_base=1)
    search.accepted = search.effects = [*items.values()]
    conclusion: Any = object.__new__(Conclusion)
    conclusion.search = search
    asked = iter(refused)

    def against(*_: Any) -> Refusal | None:
        name = next(asked, None)
        return name and Refusal(items[name], "replays of held-out runs are worse with it")

    def drop(_search: Any, item: Any, fit: Any) -> None:
        search.accepted = search.effects = [own for own in search.effects if own is not item]
        search.fit = fit

    def so_far() -> Decision:
        return Decision(Verdict.EFFECT, search.fit, ("the causes found until then",), None)

    def assemble(*, complete: bool) -> SimpleNamespace:
        assert not complete
        decided = conclusion.decision
        return SimpleNamespace(verdict=decided.verdict, replays=("held",), decision=decided)

    for name, own in (
        ("against_the_end", against),
        ("drop", drop),
        ("without", lambda _search, item: f"without {item.start.candidate}"),
    ):
        monkeypatch.setattr(f"eha_bench.diagnosis.conclusion.{name}", own)
    conclusion._decision_so_far, conclusion._assemble = so_far, assemble
    found: Any = SimpleNamespace(verdict=Verdict.EFFECT, replays=("held",), decision=so_far())
    end = conclusion._if_it_stands(found)
    assert [item.start.candidate for item in search.accepted] == left
    assert end.verdict is (Verdict.EFFECT if left else Verdict.UNKNOWN)
    assert (end is found) == (not refused)
    for name in refused:
        assert f"{name} is not accepted: replays of held-out runs are worse" in " ".join(
            end.decision.notes
        )
    if not left:
        assert search.fit == "without"
