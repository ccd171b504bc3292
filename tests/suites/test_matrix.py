"""The matrix: each combination is a trial, and `${name}` its value."""

from pathlib import Path

import pytest
from writing import load, refusal

MATRIX = """
trials:
  - id: pressure_step
    mode: pressure
    duration: 0.5 s
    signal: {kind: step, final: "${pressure}"}
    matrix: %s
"""


def ids(folder: Path, text: str) -> list[str]:
    return [trial.id for trial in load(folder, text).trials]


def test_ids_carry_the_values(tmp_path: Path) -> None:
    found = ids(tmp_path, MATRIX % "{pressure: [15 MPa, 20 MPa, 30e6]}")
    assert found == ["pressure_step-15MPa", "pressure_step-20MPa", "pressure_step-30000000"]


def test_every_combination_is_a_trial(tmp_path: Path) -> None:
    suite = load(
        tmp_path,
        """
        trials:
          - id: step
            mode: ${mode}
            duration: 0.5 s
            signal: {kind: step, final: "${final}", at: "${at}"}
            description: ${mode} to ${final}
            repeats: ${repeats}
            matrix:
              mode:
                current: {final: 5 A}
                motor_speed: {final: 100 rpm}
              at: [1 ms, 2 ms, 3 ms]
              repeats: [2]
        """,
    )
    assert [trial.id for trial in suite.trials] == [
        "step-current-1ms-2",
        "step-current-2ms-2",
        "step-current-3ms-2",
        "step-motor_speed-1ms-2",
        "step-motor_speed-2ms-2",
        "step-motor_speed-3ms-2",
    ]
    last = suite.trials[-1]
    assert last.signal.edges[0].after == pytest.approx(10.471975512)
    assert last.signal.edges[0].time == 0.003
    assert last.description == "motor_speed to 100 rpm"
    assert last.repeats == 2


def test_id_may_name_its_parameters(tmp_path: Path) -> None:
    text = MATRIX % "{pressure: [15 MPa, 20 MPa]}"
    assert ids(tmp_path, text.replace("id: pressure_step", "id: to_${pressure}_fast")) == [
        "to_15MPa_fast",
        "to_20MPa_fast",
    ]


def test_parameters_reach_defaults_limits_and_whole_blocks(tmp_path: Path) -> None:
    suite = load(
        tmp_path,
        """
        defaults:
          duration: ${length}
          accept: {tracking_rms: "${limit} +- 6 %", tracking_max: "${largest}"}
        trials:
          - id: a
            mode: pressure
            signal: ${wave}
            matrix:
              case:
                slow: {length: 2 s, limit: 39 bar, largest: null, wave: {kind: step, final: 1 MPa}}
                fast:
                  length: 1 s
                  limit: 20 bar
                  largest: {min: 2 MPa}
                  wave: {kind: ramp, final: 1 MPa, over: 0.5 s}
        """,
    )
    slow, fast = suite.trials
    assert (slow.duration, fast.duration) == (2.0, 1.0)
    assert [limit.metric for limit in slow.limits] == ["tracking_rms"]
    assert [limit.metric for limit in fast.limits] == ["tracking_rms", "tracking_max"]
    assert fast.limits[1].bounds.low == 2e6
    assert slow.signal.edges
    assert not fast.signal.edges


@pytest.mark.parametrize(
    ("matrix", "key", "what"),
    [
        ("{presure: [15 MPa]}", "signal.final", "did you mean 'presure'"),
        ("{speed: [1]}", "signal.final", "unknown parameter 'pressure'"),
        ("{pressure: 15 MPa}", "matrix.pressure", "no list of values"),
        ("{pressure: []}", "matrix.pressure", "no values"),
        ("{pressure: {}}", "matrix.pressure", "no values"),
        ("{pressure: [[1]]}", "matrix.pressure.0", "not a number or text"),
        ("{pressure: [null]}", "matrix.pressure.0", "not a number or text"),
        ("{pressure: {15 MPa: 3}}", "matrix.pressure.15 MPa", "expected further parameters"),
        ("{pressure: {15 MPa: {a: 1}, 20 MPa: {}}}", "matrix.pressure", "'a' does not go with"),
        ("{pressure: {15 MPa: {a-b: 1}}}", "matrix.pressure.15 MPa.a-b", "not a name"),
        ("{pressure: [1], p: {x: {pressure: 2}}}", "matrix.p", "is given twice"),
        ("{2x: [1]}", "matrix.2x", "not a name"),
        ("[pressure]", "matrix", "expected named parameters"),
    ],
)
def test_refusal_names_the_key(tmp_path: Path, matrix: str, key: str, what: str) -> None:
    error = refusal(tmp_path, MATRIX % matrix)
    assert what in str(error)
    assert error.where.key == f"trials.pressure_step.{key}"
    assert error.where.line == (6 if key.startswith("signal") else 7)


def test_parameter_without_a_matrix(tmp_path: Path) -> None:
    error = refusal(tmp_path, MATRIX % "null")
    assert "unknown parameter 'pressure' in '${pressure}'" in error.what
    assert "no matrix" in error.hint


def test_parameter_that_is_not_closed(tmp_path: Path) -> None:
    text = (MATRIX % "{pressure: [1 MPa]}").replace("${pressure}", "${pressure} ${x")
    assert "is not closed" in str(refusal(tmp_path, text))


def test_trials_that_come_out_with_the_same_id(tmp_path: Path) -> None:
    error = refusal(tmp_path, MATRIX % "{pressure: [15 MPa, 15MPa]}")
    assert "two trials are called 'pressure_step-15MPa'" in error.what
    error = refusal(tmp_path, MATRIX % "{pressure: [15e6, 1.5e7]}")
    assert "two trials" in error.what


def test_too_many_trials(tmp_path: Path) -> None:
    hundred = str(list(range(100)))
    matrix = f"{{pressure: {hundred}, b: {hundred}, c: {hundred}}}"
    assert "1000000 trials are more than" in str(refusal(tmp_path, MATRIX % matrix))


@pytest.mark.parametrize(
    ("old", "new", "line", "key"),
    [
        ("15 MPa, 20 MPa", "15 MPa, 10 mm", 6, "signal.final"),
        ("35 ms:", "35 mm:", 8, "accept.rise_time.max"),
        ("<= 3 ms", "<= 3 mm", 10, "accept.settling_time"),
        ("0.6 s", "0.6 A", 11, "duration"),
        # what is wrong with a key, or with a text around it, is wrong at the key
        ("final:", "to:", 12, "signal.to"),
        ("'${pressure}'", "'${pressure} kN'", 12, "signal.final"),
    ],
)
def test_a_wrong_value_is_told_with_its_line_in_the_matrix(
    tmp_path: Path, old: str, new: str, line: int, key: str
) -> None:
    text = """\
name: x
trials:
  - id: step
    mode: pressure
    matrix:
      pressure: [15 MPa, 20 MPa]
      rise:
        35 ms: {settling: <= 9 ms}
        40 ms:
          settling: <= 3 ms
      length: [0.6 s]
    signal: {kind: step, final: '${pressure}', at: 50 ms}
    duration: '${length}'
    accept:
      rise_time: {max: '${rise}'}
      settling_time: '${settling}'
"""
    assert load(tmp_path, text).trials
    assert old in text
    error = refusal(tmp_path, text.replace(old, new))
    assert (error.where.line, error.where.key) == (line, f"trials.step.{key}")
