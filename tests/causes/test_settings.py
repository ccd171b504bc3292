"""nightly.yaml with `diagnose`: what is wrong is said with file, line and key."""

from pathlib import Path

import pytest

from eha_bench.causes.settings import load_cause_settings
from eha_bench.core.errors import InputError
from eha_bench.core.yaml_file import kind_of
from eha_bench.trends.nightly_file import load_nightly

SUITE = """\
name: nightly
trials:
  - id: step
    mode: pressure
    setup: {piston: locked}
    duration: 0.5 s
    signal: {kind: step, final: 15 MPa, at: 50 ms}
    accept: {response_time: <= 60 ms}
"""


def written(folder: Path, text: str) -> Path:
    (folder / "suite.yaml").write_text(SUITE)
    (folder / "nightly.yaml").write_text(text)
    return folder / "nightly.yaml"


def test_what_is_calibrated_is_followed_beside_what_is_asked_for(tmp_path: Path) -> None:
    file = written(tmp_path, "diagnose: {model: physical, follow: [entrained_air, leakage]}\n")
    names = [cause.name for cause in load_cause_settings(file).causes]
    assert {"leakage", "bulk_modulus", "entrained_air at all"} <= set(names)
    assert not any(name.startswith("command_delay") for name in names)
    assert len(names) == len(set(names))


def test_all_that_may_act_is_followed_where_nothing_is_asked_for(tmp_path: Path) -> None:
    settings = load_cause_settings(written(tmp_path, "diagnose: {model: physical}\n"))
    names = {cause.id for cause in settings.causes}
    assert {"command_delay", "joint_backlash", "seal_friction", "leakage"} <= names
    assert not names & {"learned", "viscosity_temperature", "cogging_torque", "pump_ripple"}
    assert settings.case is None


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ("diagnose:\n  model: physical\n  follow:\n    - entrained_air\n    - sael_friction\n",
         "5, key 'diagnose.follow.1'", "seal_friction"),
        ("diagnose:\n  model: nowhere.yaml\n", "2, key 'diagnose.model'", "not there"),
        ("diagnose:\n  model: physical\n  suite: gone.yaml\n", "3, key 'diagnose.suite'", "gone"),
        ("diagnose:\n  model: physical\n  suite: suite.yaml\n  trials: [stepp]\n",
         "4, key 'diagnose.trials.0'", "step"),
        ("diagnose:\n  model: physical\n  target: gone.yaml\n  suite: suite.yaml\n",
         "3, key 'diagnose.target'", "gone"),
        ("diagnose:\n  model: physical\n  healthy_nights: 2\n", "3, key", "8"),
        ("diagnose:\n  model: physical\n  fellow: [leakage]\n", "3, key 'diagnose.fellow'",
         "follow"),
        ("when: always\n", "", "nothing follows a night"),
    ],
)  # fmt: skip
def test_a_mistake_is_named(tmp_path: Path, text: str, key: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        load_cause_settings(written(tmp_path, text))
    assert "nightly.yaml" in error.value.sentence
    assert key in error.value.sentence
    assert said in error.value.sentence


def test_a_model_without_calibrate_is_refused(tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text("model: eha_knee\n")
    with pytest.raises(InputError, match="nothing under 'calibrate'"):
        load_cause_settings(written(tmp_path, "diagnose: {model: model.yaml}\n"))


def test_sending_alone_asks_for_no_causes(tmp_path: Path) -> None:
    file = written(tmp_path, "send: cat\n")
    assert load_nightly(file).diagnose is None
    with pytest.raises(InputError, match="there is nothing to diagnose"):
        load_cause_settings(file)


def test_validate_knows_the_file_and_its_mistakes(tmp_path: Path) -> None:
    file = written(tmp_path, "diagnose: {model: physical, follow: [sael]}\n")
    kind = kind_of(file)
    assert kind.name == "nightly"
    with pytest.raises(InputError, match=r"follow\.0"):
        kind.check(file)
