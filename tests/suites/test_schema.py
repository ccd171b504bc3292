"""What editors are told of a suite agrees with what is read."""

import copy
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from eha_bench.core import plugins
from eha_bench.suites import load_suite
from eha_bench.suites.schema import suite_schema

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "suites").glob("*.yaml"))
GOOD: dict[str, Any] = {
    "trials": [
        {
            "id": "a-${p}",
            "mode": "pressure",
            "duration": "1 s",
            "repeats": "${n}",
            "setup": {"piston": "${piston}"},
            "signal": {"kind": "step", "final": "${p}", "at": 0.001},
            "matrix": {"p": ["1 MPa", 2e6], "n": [1], "piston": {"free": {"x": None}}},
            "accept": {"peak": {"max": "2 MPa"}, "own_metric": "<= 1", "overshoot": None},
            "scores": ["rise_time", {"metric": "peak", "channel": "pressure_a"}],
            "safety": {"pressure_a": "<= 45 MPa"},
        }
    ]
}


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(suite_schema())


def test_names_of_shipped_suites() -> None:
    assert {path.stem for path in SHIPPED} >= {"paper", "identify", "bandwidth", "smoke"}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_suite_fits_the_schema(
    path: Path, validator: jsonschema.Draft202012Validator
) -> None:
    content = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    assert [error.message for error in validator.iter_errors(content)] == []


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_suite_names_its_schema(path: Path) -> None:
    first = path.read_text(encoding="utf-8").splitlines()[0]
    match = re.fullmatch(r"# yaml-language-server: \$schema=(\S+)", first)
    assert match is not None
    assert (path.parent / match[1]).resolve().is_file()


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_suite_is_read_and_says_what_it_is(path: Path) -> None:
    suite = load_suite(path)
    assert suite.name == path.stem
    assert suite.description


def test_every_signal_is_offered() -> None:
    signal = suite_schema()["$defs"]["TrialFile"]["properties"]["signal"]
    assert signal["properties"]["kind"]["enum"] == sorted(plugins.names("signals"))


def test_good_suite_fits(validator: jsonschema.Draft202012Validator) -> None:
    validator.validate(GOOD)


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (["trials"], []),
        (["tirals"], []),
        (["trials", 0, "id"], "../x"),
        (["trials", 0, "id"], None),
        (["trials", 0, "mode"], "a force"),
        (["trials", 0, "durtion"], "1 s"),
        (["trials", 0, "repeats"], 0),
        (["trials", 0, "setup", "piston"], "stuck"),
        (["trials", 0, "signal", "kind"], "wobble"),
        (["trials", 0, "signal", "amplitude"], 1),
        (["trials", 0, "signal"], {"kind": "step"}),
        (["trials", 0, "signal"], {"final": 1}),
        (["trials", 0, "accept", "peak"], {"maximum": 1}),
        (["trials", 0, "safety", "pressure_a"], 3),
        (["defaults"], {"id": "x"}),
        (["defaults"], {"setup": {"pistn": "free"}}),
    ],
)
def test_bad_suite_does_not(
    validator: jsonschema.Draft202012Validator, keys: list[str | int], value: object
) -> None:
    content = copy.deepcopy(GOOD)
    inner: Any = content
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    assert list(validator.iter_errors(content))
