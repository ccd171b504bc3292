"""A suite file becomes a suite, and whatever is wrong with it one sentence with its place."""

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from writing import STEP, load, only, refusal, with_signal, write

from eha_bench.core.errors import EhaBenchError, InputError, Place
from eha_bench.core.limit import Bounds
from eha_bench.core.located import Keys, Located
from eha_bench.core.trial import MODES, Bypass, ControlMode, Piston
from eha_bench.suites import load_suite

FULL = """
name: bench
description: what it is for
model: models/knee.yaml
controller: controllers/knee.yaml
target: simulator
defaults:
  mode: pressure
  sample_rate: 2 kHz
  setup: {piston: locked, bypass: open}
  accept: {overshoot: <= 30 %, rise_time: <= 40 ms}
  safety: {pressure_a: <= 45 MPa}
trials:
  - id: first
    description: the first
    duration: 500 ms
    settle: 0.1 s
    repeats: 3
    seed: 7
    signal: {kind: step, initial: 1 MPa, final: 150 bar, at: 1 ms}
    accept: {rise_time: <= 20 ms}
  - id: second
    mode: joint_angle
    setup: {piston: free, initial: {joint_angle: 50 deg}}
    signal: {kind: sine, amplitude: 10 deg, offset: 60 deg, frequency: 2 Hz, cycles: 4}
    accept: {tracking_max: <= 5 deg, overshoot: null, rise_time: null}
    safety: {pressure_b: <= 45 MPa}
"""


def test_suite_holds_what_the_file_says(tmp_path: Path) -> None:
    suite = load(tmp_path, FULL)
    assert (suite.name, suite.description) == ("bench", "what it is for")
    assert (suite.model, suite.controller) == ("models/knee.yaml", "controllers/knee.yaml")
    assert suite.target == "simulator"
    assert suite.path == tmp_path / "suite.yaml"
    assert suite.text == FULL
    assert suite.sha256 == hashlib.sha256(FULL.encode()).hexdigest()

    first = suite.trial("first")
    assert first.mode == ControlMode.PRESSURE
    assert first.channel == "pressure_difference"
    assert (first.setup.piston, first.setup.bypass) == (Piston.LOCKED, Bypass.OPEN)
    assert (first.duration, first.settle, first.sample_rate) == (0.5, 0.1, 2000.0)
    assert (first.repeats, first.seed, first.description) == (3, 7, "the first")
    (edge,) = first.signal.edges
    assert (edge.before, edge.after, edge.time, edge.until) == (1e6, 15e6, 0.001, 0.5)
    assert {limit.metric: limit.bounds for limit in first.limits} == {
        "overshoot": Bounds(high=0.3),
        "rise_time": Bounds(high=0.02),
    }
    clock = first.clock()
    assert clock.size == 1200
    reference = first.reference(clock)
    np.testing.assert_array_equal(reference[clock < 0.001], 1e6)
    np.testing.assert_array_equal(reference[clock >= 0.001], 15e6)

    second = suite.trial("second")
    assert (second.setup.piston, second.setup.bypass) == (Piston.FREE, Bypass.OPEN)
    assert second.setup.initial == {"joint_angle": pytest.approx(math.radians(50))}
    assert second.duration == 2.0
    assert second.signal.tones[0].amplitude == pytest.approx(math.radians(10))
    assert [limit.metric for limit in second.limits] == ["tracking_max"]
    assert {limit.channel for limit in second.safety} == {"pressure_a", "pressure_b"}


def test_name_is_the_files_without_one(tmp_path: Path) -> None:
    assert load(tmp_path, STEP).name == "suite"


def test_unknown_trial_suggests_a_near_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean 'first'"):
        load(tmp_path, FULL).trial("frist")


def test_settling_holds_the_level_before_a_step_at_zero(tmp_path: Path) -> None:
    trial = only(tmp_path, STEP.replace("at: 1 ms", "initial: 2 MPa") + "    settle: 0.2 s\n")
    reference = trial.reference(trial.clock())
    np.testing.assert_array_equal(reference[:200], 2e6)
    np.testing.assert_array_equal(reference[200:], 15e6)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("level", "unit"),
    [("1 MPa", "Pa"), ("1 deg", "rad"), ("1 A", "A"), ("1 rpm", "rad/s"), ("1 mm", "m")],
)
def test_levels_take_the_unit_of_the_mode(
    tmp_path: Path, mode: ControlMode, level: str, unit: str
) -> None:
    text = with_signal(f"{{kind: step, final: {level}}}", mode.name)
    if mode.unit == unit:
        assert only(tmp_path, text).signal.edges
        return
    error = refusal(tmp_path, text)
    assert "wrong dimension" in error.what
    assert f"because the trial controls {mode.name}" in error.what
    assert (error.where.key, error.where.line) == ("trials.one.signal.final", 6)


@pytest.mark.parametrize(
    ("signal", "key", "what"),
    [
        ("{kind: stp, final: 1 MPa}", "kind", "unknown signal 'stp'; did you mean 'step'"),
        ("{kind: wobble}", "kind", "unknown signal 'wobble'; known: chirp, constant"),
        ("{kind: 3}", "kind", "'3' is not a kind of signal"),
        ("{final: 1 MPa}", "kind", "key 'kind' is missing"),
        ("step", "", "a signal is written as keys and values"),
        ("null", "", "a signal is written as keys and values"),
        ("{kind: step}", "final", "key 'final' is missing"),
        ("{kind: step, final: 1 MPa, att: 1 ms}", "att", "did you mean 'at'"),
        ("{kind: step, final: .nan}", "final", "is not finite"),
        ("{kind: step, final: .inf}", "final", "is not finite"),
        ("{kind: step, final: [1]}", "final", "expected a number or text"),
        ("{kind: step, final: true}", "final", "expected a number or text"),
        ("{kind: step, final: 1 MPa, at: -1 ms}", "at", "is negative"),
        ("{kind: step, final: 1 MPa, at: 1 MPa}", "at", "wrong dimension"),
        ("{kind: sine, amplitude: 1 MPa, frequency: 0 Hz}", "frequency", "not greater than 0"),
        ("{kind: sine, amplitude: 1 MPa, frequency: 5 rpm}", "frequency", "wrong dimension"),
        ("{kind: sine, amplitude: 1 MPa, frequency: 5 Hz, cycles: 0}", "cycles", "greater than 0"),
        ("{kind: steps, levels: [], hold: 1 s}", "levels", "at least 1"),
        ("{kind: steps, levels: [1 MPa, 2 deg], hold: 1 s}", "levels.1", "wrong dimension"),
        ("{kind: steps, levels: [1 MPa], hold: [1 s, 2 A]}", "hold.1", "wrong dimension"),
        (
            "{kind: steps, levels: [1 MPa], hold: [1 s, 2 s]}",
            "",
            "2 lengths in 'hold' for 1 levels",
        ),
        ("{kind: steps, levels: [1 MPa], hold: 0}", "hold", "not greater than 0"),
        (
            "{kind: stepped_sine, amplitude: 1 MPa, frequencies: {first: 1, last: 5}}",
            "frequencies.count",
            "is missing",
        ),
        (
            "{kind: stepped_sine, amplitude: 1 MPa, frequencies: [1 Hz, 2 s]}",
            "frequencies.1",
            "wrong dimension",
        ),
        (
            "{kind: stepped_sine, amplitude: 1 deg, frequencies: [1 Hz]}",
            "amplitude",
            "wrong dimension",
        ),
        (
            "{kind: stepped_sine, amplitude: [1, 2], frequencies: [1 Hz]}",
            "",
            "2 amplitudes for 1 frequencies",
        ),
        (
            "{kind: chirp, amplitude: 1, f_start: 1 Hz, f_stop: 1 Hz, duration: 1 s}",
            "",
            "use a sine",
        ),
        ("{kind: chirp, amplitude: 1, f_start: 1 Hz, f_stop: 2 Hz}", "duration", "is missing"),
        (
            "{kind: multisine, amplitude: 1, period: 1 s, f_min: 1.2 Hz, f_max: 1.8 Hz}",
            "",
            "they are 1 Hz apart",
        ),
        (
            "{kind: multisine, amplitude: 1, period: 1 s, f_min: 5 Hz, f_max: 1 Hz}",
            "",
            "f_max lies below f_min",
        ),
        (
            "{kind: multisine, amplitude: 1, period: 1 s, f_min: 1, f_max: 5, phases: schroeder,"
            " realisations: 2}",
            "",
            "use phases: random",
        ),
        ("{kind: prbs, low: 2 MPa, high: 1 MPa, bit: 10 ms}", "", "low has to lie below high"),
        ("{kind: prbs, low: 1, high: 2, bit: 10 ms, order: 40}", "order", "less than or equal"),
    ],
)
def test_wrong_signal_names_the_key(tmp_path: Path, signal: str, key: str, what: str) -> None:
    error = refusal(tmp_path, with_signal(signal))
    assert what in str(error)
    assert error.where.key == ".".join(filter(None, ("trials.one.signal", key)))
    assert error.where.line == 6


@pytest.mark.parametrize(
    ("text", "line", "key", "what"),
    [
        ("trials: []\n", 1, "trials", "at least 1"),
        ("name: x\n", 1, "trials", "key 'trials' is missing"),
        ("trials: [3]\n", 1, "trials.0", "expected keys and values"),
        ("tirals: []\n", 1, "tirals", "did you mean 'trials'"),
        (STEP + "modle: x\n", 7, "modle", "did you mean 'model'"),
        (STEP + "name: a/b\n", 7, "name", "character that a name cannot have"),
        (STEP + "name: nul\n", 7, "name", "Windows"),
        (STEP + "defaults: 3\n", 7, "defaults", "expected keys and values"),
        (STEP + "defaults: {id: x}\n", 7, "defaults.id", "unknown key 'id'"),
        (STEP + "defaults: {setpu: {}}\n", 7, "defaults.setpu", "did you mean 'setup'"),
        (
            STEP + "defaults:\n  setup:\n    piston: stuck\n",
            9,
            "defaults.setup.piston",
            "'stuck' is not known here",
        ),
        (STEP + "    durtion: 1 s\n", 7, "trials.step.durtion", "did you mean 'duration'"),
        (STEP + "    settle: -1 s\n", 7, "trials.step.settle", "is negative"),
        (STEP + "    repeats: 0\n", 7, "trials.step.repeats", "greater than or equal to 1"),
        (STEP + "    repeats: 1.5\n", 7, "trials.step.repeats", "1.5 should be a whole number"),
        (STEP + "    seed: -1\n", 7, "trials.step.seed", "greater than or equal to 0"),
        (STEP + "    sample_rate: 0 Hz\n", 7, "trials.step.sample_rate", "greater than 0"),
        (
            STEP + "    sample_rate: 1 MHz\n    settle: 1 day\n",
            7,
            "trials.step.sample_rate",
            "more",
        ),
        (STEP + "    sample_rate: 1 Hz\n", 7, "trials.step.sample_rate", "shorter than one tick"),
        (
            STEP + "    setup: {pistn: free}\n",
            7,
            "trials.step.setup.pistn",
            "did you mean 'piston'",
        ),
        (
            STEP + "    setup: {bypass: ajar}\n",
            7,
            "trials.step.setup.bypass",
            "'ajar' is not known here",
        ),
        (
            STEP + "    setup: {initial: {joint_angle: 1 mm}}\n",
            7,
            "trials.step.setup.initial.joint_angle",
            "wrong dimension",
        ),
        (
            STEP + "    setup: {initial: {joint_angle: 1, piston_position: 0}}\n",
            7,
            "trials.step.setup.initial",
            "keep one of them",
        ),
        (STEP.replace("mode: pressure", "mode: presure"), 4, "trials.step.mode", "'pressure'"),
        (STEP.replace("mode: pressure", "mode: reference"), 4, "trials.step.mode", "itself"),
        (STEP.replace("mode: pressure\n", "\n"), 3, "trials.step.mode", "is missing"),
        (STEP.replace("0.5 s", "-0.5 s"), 5, "trials.step.duration", "not greater than 0"),
        (STEP.replace("0.5 s", ".nan"), 5, "trials.step.duration", "not finite"),
        (STEP.replace("0.5 s", "0.5 MPa"), 5, "trials.step.duration", "wrong dimension"),
        (STEP.replace("duration: 0.5 s", ""), 3, "trials.step.duration", "never ends"),
        (STEP.replace("id: step", "description: x"), 3, "trials.0.id", "key 'id' is missing"),
        (
            STEP.replace("signal: {kind: step, final: 15 MPa, at: 1 ms}", ""),
            3,
            "trials.step.signal",
            "missing",
        ),
        (
            STEP.replace("kind: step, final: 15 MPa", "kind: sine, amplitude: 1, frequency: 500"),
            3,
            "trials.step.sample_rate",
            "reaches 500 Hz, sampled at 1000 Hz",
        ),
    ],
)
def test_wrong_suite_names_line_and_key(
    tmp_path: Path, text: str, line: int, key: str, what: str
) -> None:
    error = refusal(tmp_path, text.lstrip("\n") if not text.startswith("\n") else text)
    assert what in str(error)
    assert (error.where.key, error.where.line) == (key, line)


@pytest.mark.parametrize(
    "name",
    [
        "../x", "..", ".", "/etc/x", "a/b", "a\\b", "C:x", "~x", ".hidden", "-x", "a b", "", "nul",
        "COM1", "aux.txt", "x.", "a\0b", "é", "a" * 200, "$x", "a\nb", "%2e%2e",
    ],
)  # fmt: skip
def test_id_is_never_a_path(tmp_path: Path, name: str) -> None:
    quoted = name.replace("\\", "\\\\").replace("\0", "\\0").replace("\n", "\\n")
    error = refusal(tmp_path, STEP.replace("id: step", f'id: "{quoted}"'))
    assert error.where.key.endswith(".id")
    assert error.where.line == 3


def test_id_may_be_a_plain_name(tmp_path: Path) -> None:
    for name in ("a", "A-1.5_b", "_x", "7", "null.a.b" * 3):
        if name.startswith("null"):
            continue
        assert only(tmp_path, STEP.replace("id: step", f'id: "{name}"')).id == name


def test_ids_are_unique_on_every_file_system(tmp_path: Path) -> None:
    second = STEP.replace("\ntrials:\n", "")
    error = refusal(tmp_path, STEP + second)
    assert error.what == "two trials are called 'step'"
    assert error.where.line == 7
    error = refusal(tmp_path, STEP + second.replace("id: step", "id: STEP"))
    assert "differ in capital letters only" in error.what


def test_error_in_defaults_is_placed_there(tmp_path: Path) -> None:
    error = refusal(tmp_path, STEP + "defaults:\n  accept:\n    peak: <= 3 deg\n")
    assert (error.where.key, error.where.line) == ("defaults.accept.peak", 9)


@pytest.mark.slow
def test_missing_and_deep_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_suite(tmp_path / "none.yaml")
    deep = "trials: " + "[" * 60 + "]" * 60
    assert "is nested too deeply" in str(refusal(tmp_path, deep))
    assert refusal(tmp_path, "trials: " + "[" * 1000 + "]" * 1000)
    assert refusal(tmp_path, "trials: &a [*a]\n")
    assert refusal(tmp_path, "trials: [&a {id: *a}]\n")


def test_aliases_that_multiply_are_refused(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    assert "too many values" in str(refusal(tmp_path, "\n".join([*lines, "trials: []"])))


MANY = """\
name: many
defaults: {mode: pressure, setup: {piston: locked}, accept: {overshoot: <= 20 %}}
trials:
"""
ONE_OF_MANY = """\
  - {id: step-%d, duration: 1 s, signal: {kind: step, final: 5 MPa}, accept: {rise_time: <= 1 s}}
"""


def test_the_work_of_loading_grows_with_the_trials_and_no_faster(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Places that are gone through, counted: four times the trials once cost sixteen times them."""
    whole = Located.places.fget
    assert whole is not None
    gone_through = 0

    def counted(part: Located) -> Mapping[Keys, Place]:
        nonlocal gone_through
        gone_through += len(part.written) if part.inside else 1
        return whole(part)

    monkeypatch.setattr(Located, "places", property(counted))

    def work(count: int) -> int:
        nonlocal gone_through
        path = tmp_path / f"{count}.yaml"
        path.write_text(MANY + "".join(ONE_OF_MANY % number for number in range(count)))
        gone_through = 0
        assert len(load_suite(path).trials) == count
        return gone_through

    assert work(120) < 4.5 * work(30)


KEYS = ["id", "mode", "signal", "kind", "final", "duration", "setup", "accept", "peak", "safety"]
KEYS += ["scores", "matrix", "initial", "repeats"]


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(KEYS) | st.text(max_size=5),
                inner,
                max_size=5,
            )
        ),
        max_leaves=15,
    )
)
def test_any_content_is_a_suite_or_an_error_with_a_place(
    tmp_path_factory: pytest.TempPathFactory, content: object
) -> None:
    import json

    path = write(tmp_path_factory.mktemp("suite"), "")
    base = {"id": "a", "mode": "pressure", "signal": {"kind": "step", "final": 1}, "duration": 1}
    over = content if isinstance(content, dict) else {"accept": content}
    text = (
        json.dumps({"trials": [{**base, **over}]}, allow_nan=False, default=str)
        if _finite(content)
        else "trials: .nan"
    )
    path.write_text(text, encoding="utf-8")
    refused: EhaBenchError | None = None
    try:
        assert load_suite(path).trials
    except EhaBenchError as error:
        refused = error
    assert refused is None or (refused.where.file and refused.exit_status == 2)


def _finite(content: object) -> bool:
    if isinstance(content, float):
        return math.isfinite(content)
    if isinstance(content, dict):
        return all(map(_finite, content.values()))
    return all(map(_finite, content)) if isinstance(content, list) else True
