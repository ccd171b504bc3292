"""`eha-bench run --posterior`: P(pass) against what is known of it, and with everything wrong."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eha_bench.core.errors import InputError
from eha_bench.plants.model import load_model
from eha_bench.posterior.file import read_posterior
from eha_bench.sweeps.chance import Chance

from .conftest import Cli

SUITE = """\
name: hold
trials:
  - id: step
    mode: current
    setup: {piston: locked}
    duration: 80 ms
    signal: {kind: step, final: 8 A, at: 10 ms}
    accept:
      tracking_max: {channel: current, max: 12 A}
      peak: {channel: pressure_difference, max: LIMIT MPa}
"""
MODEL = "model: eha_knee\nparameters: {torque_constant: 0.25, leakage: 2e-15}\n"


def posterior(covariance: float = 0.02**2, **more: Any) -> dict[str, Any]:
    content = {
        "schema_version": 1,
        "model": "calibrated.yaml",
        "covariance": {"parameters": ["torque_constant"], "matrix": [[covariance]]},
        "per_run": {},
    }
    return content | more


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "hold.yaml").write_text(SUITE.replace("LIMIT", "16.5"), encoding="utf-8")
    (tmp_path / "calibrated.yaml").write_text(MODEL, encoding="utf-8")
    (tmp_path / "calibration.json").write_text(json.dumps(posterior(), indent=1))
    return tmp_path


def probability(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "probability.json").read_text(encoding="utf-8"))
    return content


RUN = ("run", "hold.yaml", "--target", "calibrated.yaml", "--posterior", "calibration.json")


def test_a_run_tells_how_likely_each_limit_is_kept(cli: Cli, files: Path) -> None:
    done = cli(*RUN, "--draws", 24, "--out", "out")
    found = probability(files / "out")
    assert "P(pass)" in done.stderr
    assert found["suite"]["draws"] == 24
    peak = next(item for item in found["limits"] if item["metric"] == "peak")
    assert 0 < peak["p_pass"]["kept"] < 24
    assert peak["p_pass"]["low"] < peak["p_pass"]["value"] < peak["p_pass"]["high"]
    # whether the other limit is kept does not follow what is drawn
    other = next(item for item in found["limits"] if item["metric"] == "tracking_max")
    assert other["p_pass"]["kept"] == 24
    assert found["suite"] == peak["p_pass"]
    # the one unknown is what it costs
    assert [item["key"] for item in found["unknowns"]] == ["torque_constant"]
    assert found["unknowns"][0]["share"] > 0.8
    text = (files / "out/probability.html").read_text(encoding="utf-8")
    assert "Responses of the draws" in text
    assert 'href="report.html"' in text


def test_a_certain_machine_passes_or_fails_for_certain(cli: Cli, files: Path) -> None:
    (files / "calibration.json").write_text(json.dumps(posterior(1e-16)))
    (files / "hold.yaml").write_text(SUITE.replace("LIMIT", "20"), encoding="utf-8")
    cli(*RUN, "--draws", 8, "--out", "sure", "--p-pass", 0.7, check=0)
    assert probability(files / "sure")["suite"]["value"] == 1.0
    said = cli(*RUN, "--draws", 8, "--out", "few", "--p-pass", 0.95, check=1)
    assert "P(pass) is not shown to be 0.95 or more" in said.stderr
    (files / "hold.yaml").write_text(SUITE.replace("LIMIT", "5"), encoding="utf-8")
    cli(*RUN, "--draws", 8, "--out", "lost", check=1)
    assert probability(files / "lost")["suite"]["value"] == 0.0


@pytest.mark.slow  # starts processes
def test_processes_and_seeds_give_the_same(cli: Cli, files: Path) -> None:
    cli(*RUN, "--draws", 6, "--out", "a")
    cli(*RUN, "--draws", 6, "--out", "b", "--workers", "2")
    assert probability(files / "a") == probability(files / "b")


def test_draws_have_the_covariance(files: Path) -> None:
    matrix = [[4e-4, 3e-17], [3e-17, 9e-30]]
    content = posterior()
    content["covariance"] = {"parameters": ["torque_constant", "leakage"], "matrix": matrix}
    (files / "calibration.json").write_text(json.dumps(content))
    known = read_posterior(files / "calibration.json", load_model(files / "calibrated.yaml"))
    draws = known.draws(4000, 1)
    values = np.array([[draw.values["torque_constant"], draw.values["leakage"]] for draw in draws])
    # leakage cannot be below 0: two thirds of a standard deviation above it, so truncated
    assert values.min() >= 0.0
    assert np.corrcoef(values.T)[0, 1] == pytest.approx(0.5, abs=0.12)
    assert values[:, 0].std() == pytest.approx(0.02, rel=0.1)
    assert [draw.values for draw in known.draws(5, 1)] == [draw.values for draw in draws[:5]]
    assert draws[7].model.value("torque_constant") == draws[7].values["torque_constant"]


@pytest.mark.slow
def test_what_is_left_unexplained_lowers_the_probability(cli: Cli, files: Path) -> None:
    (files / "revised.yaml").write_text(MODEL)
    (files / "hold.yaml").write_text(SUITE.replace("LIMIT", "18.5"), encoding="utf-8")
    known = {"parameters": ["torque_constant"], "matrix": [[1e-12]]}
    rival = {"id": "x", "standing": "found", "model": "revised.yaml", "covariance": known}
    run = ("run", "hold.yaml", "--target", "revised.yaml", "--posterior", "diagnosis.json")
    kept = []
    for left in (0.0, 5e6):
        content = {
            "verdict": "unknown", "rivals": [rival], "per_run": {},
            "covered": {"unexplained": {"pressure_a": left, "current": None}},
        }  # fmt: skip
        (files / "diagnosis.json").write_text(json.dumps(content))
        cli(*run, "--draws", 12, "--out", f"out{left:g}")
        kept.append(probability(files / f"out{left:g}")["suite"]["value"])
    assert kept[0] == 1.0
    assert kept[1] < 0.9


def test_what_lies_beyond_the_recordings_is_noted(cli: Cli, files: Path) -> None:
    extremes = {"current": [-2.0, 2.0], "current_command": [-8.0, 8.0], "pressure_a": [0.0, 1e8]}
    locked = {"piston": "locked", "bypass": "closed", "extremes": extremes}
    (files / "calibration.json").write_text(json.dumps(posterior(covered={"setups": [locked]})))
    said = cli(*RUN, "--draws", 3, "--out", "out").stderr
    beyond = probability(files / "out")["beyond"]
    assert [(item["trial"], item["channel"]) for item in beyond] == [("step", "current")]
    assert beyond[0]["reached"] == pytest.approx(8.0, rel=0.05)
    assert beyond[0]["distance"] == pytest.approx(1.5, rel=0.1)
    assert "step takes current to 8" in said
    assert "-2 to 2: P(pass) supposes" in said
    assert "step takes current to 8" in (files / "out/probability.html").read_text()


def test_a_setup_that_was_never_recorded_is_noted(cli: Cli, files: Path) -> None:
    free = {"piston": "free", "bypass": "closed", "extremes": {}}
    (files / "calibration.json").write_text(json.dumps(posterior(covered={"setups": [free]})))
    said = cli(*RUN, "--draws", 3, "--out", "out").stderr
    assert "step runs with the piston locked and the bypass closed, in which the model" in said
    setup = {"trial": "step", "piston": "locked", "bypass": "closed"}
    assert probability(files / "out")["beyond"] == [setup]


@pytest.mark.parametrize("covered", [{"setups": [{"piston": "locked"}]}, {"setups": 3}, [1]])
def test_what_cannot_be_read_of_the_recordings_is_one_sentence(
    cli: Cli, files: Path, covered: Any
) -> None:
    (files / "calibration.json").write_text(json.dumps(posterior(covered=covered)))
    said = cli(*RUN, "--draws", 3, "--out", "out", check=2).stderr
    assert "where its recordings have been cannot be read" in said
    assert "Traceback" not in said


@pytest.mark.slow
def test_conditions_are_drawn_beside_what_was_fitted(cli: Cli, files: Path) -> None:
    (files / "cold.yaml").write_text(
        "over:\n  parameters:\n    viscous_torque: {from: 0.001 N*m*s/rad, to: 0.1 N*m*s/rad}\n"
    )
    cli(*RUN, "--draws", 24, "--conditions", "cold.yaml", "--out", "out")
    found = probability(files / "out")
    unknown = {item["key"]: item for item in found["unknowns"]}
    assert set(unknown) == {"torque_constant", "viscous_torque"}
    page = (files / "out/probability.html").read_text(encoding="utf-8")
    assert "viscous_torque 0.001 N*m*s/rad ... 0.1 N*m*s/rad" in page


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "over:\n  gains: {pressure.k_p: [3 A/MPa]}\n",
            "c.yaml:2, key 'over.gains': condit",
        ),
        ("over:\n  parameters: {viscous: [1]}\n", "c.yaml:2, key 'over.parameters.viscous'"),
    ],
)
def test_conditions_that_are_none(cli: Cli, files: Path, text: str, told: str) -> None:
    (files / "c.yaml").write_text(text)
    done = cli(*RUN, "--conditions", "c.yaml", "--out", "out", check=2)
    assert told in done.stderr


def test_conditions_need_a_posterior(cli: Cli, files: Path) -> None:
    (files / "c.yaml").write_text("over: {}\n")
    done = cli("run", "hold.yaml", "--conditions", "c.yaml", check=2)
    assert "--conditions needs a --posterior" in done.stderr


def test_what_differs_from_run_to_run_is_drawn_from_the_runs(files: Path) -> None:
    own = {f"run{k}": {"external_force": {"value": 100.0 * k}} for k in range(3)}
    (files / "calibration.json").write_text(json.dumps(posterior(per_run=own)))
    known = read_posterior(files / "calibration.json", load_model(files / "calibrated.yaml"))
    found = {draw.model.value("external_force") for draw in known.draws(40, 0)}
    assert found == {0.0, 100.0, 200.0}


def test_explanations_that_cannot_be_told_apart_are_drawn_in_turn(files: Path) -> None:
    (files / "rivals").mkdir()
    (files / "revised.yaml").write_text(
        MODEL + "effects: [{effect: current_lag, time_constant: 2 ms}]\n"
    )
    (files / "rivals/lag.yaml").write_text((files / "revised.yaml").read_text())
    delay = MODEL + "effects: [{effect: command_delay, delay: 2 ms}]\n"
    (files / "rivals/delay.yaml").write_text(delay)
    none = {"parameters": ["torque_constant"], "matrix": [[1e-6]]}
    rivals = [
        {"id": "lag", "standing": "found", "model": "rivals/lag.yaml", "covariance": none},
        {"id": "delay", "standing": "equivalent", "model": "rivals/delay.yaml", "covariance": none},
        {"id": "other", "standing": "runner_up", "model": "rivals/none.yaml", "covariance": none},
    ]
    content = {"verdict": "effect", "rivals": rivals, "per_run": {}}
    (files / "diagnosis.json").write_text(json.dumps(content))
    known = read_posterior(files, load_model(files / "revised.yaml"))
    assert [draw.component for draw in known.draws(4, 0)] == ["lag", "delay"] * 2
    assert [draw.model.effects[0].id for draw in known.draws(2, 0)] == [
        "current_lag", "command_delay",
    ]  # fmt: skip
    assert "do not distinguish: lag, delay" in known.notes[0]
    # the effect stands in no line of diagnosis.json: the first model that it names does
    (files / "diagnosis.json").write_text(json.dumps(content, indent=1))
    (files / "plain.yaml").write_text(MODEL)
    with pytest.raises(InputError) as refused:
        read_posterior(files, load_model(files / "plain.yaml"))
    line = (files / "diagnosis.json").read_text().splitlines()[refused.value.where.line - 1]
    assert '"model": "rivals/lag.yaml"' in line
    assert "it has the effect current_lag" in refused.value.what


@pytest.mark.parametrize(
    ("model", "told"),
    [
        (MODEL.replace("0.25", "0.3"), "calibration.json:6, key 'torque_constant': is the "
         "posterior of another model: torque_constant is 0.25 there and 0.3 in this one"),
        (MODEL + "effects: [{effect: command_delay, delay: 1 ms}]\n",
         "it has no effect command_delay, which this one declares"),
        ("model: linear_drive\n", "is the posterior of another model: of eha_knee"),
    ],
)  # fmt: skip
def test_the_posterior_of_another_model(cli: Cli, files: Path, model: str, told: str) -> None:
    (files / "other.yaml").write_text(model)
    words = ("run", "hold.yaml", "--target", "other.yaml", "--posterior", "calibration.json")
    said = cli(*words, "--out", "out", check=2)
    assert told in said.stderr
    assert not (files / "out").exists()


def test_no_posterior_at_all(cli: Cli, files: Path) -> None:
    said = cli(*RUN[:-1], "nowhere.json", "--out", "out", check=2)
    assert "nowhere.json: no such diagnosis.json" in said.stderr
    content = posterior()
    content["covariance"] = None
    (files / "calibration.json").write_text(json.dumps(content))
    assert "has no intervals" in cli(*RUN, "--out", "out", check=2).stderr
    assert "needs a --posterior" in cli("run", "hold.yaml", "--p-pass", "0.9", check=2).stderr


def test_the_interval_is_that_of_jeffreys() -> None:
    # Brown, Cai, DasGupta (2001), and 1 where all pass
    found = Chance(9, 10)
    assert (found.low, found.high) == pytest.approx((0.6186, 0.9890), abs=2e-4)
    assert Chance(10, 10).high == 1.0
    assert Chance(10, 10).low == pytest.approx(0.7829, abs=2e-4)
    assert Chance(0, 10).low == 0.0


def test_the_interval_holds_as_often_as_it_says() -> None:
    generator = np.random.default_rng(1)
    for true in (0.5, 0.9, 0.97):
        kept = generator.binomial(200, true, 2000)
        held = [Chance(int(k), 200).low <= true <= Chance(int(k), 200).high for k in kept]
        assert 0.92 <= np.mean(held) <= 0.98
