"""`eha-bench validate` and `eha-bench schema`."""

import json
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from .conftest import Cli


def shipped(folder: Path) -> list[Path]:
    return sorted((folder / "suites").rglob("*.yaml"))


def test_every_shipped_file_is_valid(cli: Cli, repository: Path) -> None:
    files = shipped(repository)
    assert len(files) >= 8
    cli("validate", *files, check=0)


@pytest.mark.parametrize(
    ("kind", "pattern"),
    [("suite", "*.yaml"), ("model", "models/*.yaml"), ("controller", "controllers/*.yaml"),
     ("target", "targets/*.yaml")],
)  # fmt: skip
def test_shipped_files_agree_with_the_printed_schema(
    cli: Cli, repository: Path, kind: str, pattern: str
) -> None:
    schema = json.loads(cli("schema", kind, check=0).stdout)
    files = sorted((repository / "suites").glob(pattern))
    assert files
    for path in files:
        content = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
        jsonschema.validate(content, schema)
        first = path.read_text(encoding="utf-8").splitlines()[0]
        assert first.startswith("# yaml-language-server: $schema="), path
        assert (path.parent / first.split("=")[1]).is_file(), path


def test_every_wrong_file_is_named(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("model: eha_knee\nparameters: {leakage: 3 kg}\n", "utf-8")
    (tmp_path / "b.yaml").write_text("nonsense: 1\n", "utf-8")
    (tmp_path / "c.yaml").write_text("model: eha_knee\n", "utf-8")
    done = cli("validate", "a.yaml", "b.yaml", "c.yaml", check=2)
    assert "a.yaml:2, key 'parameters.leakage'" in done.stderr
    assert "b.yaml:1" in done.stderr
    assert "c.yaml: a valid model" in done.stderr


def test_an_unknown_kind_is_bad_input(cli: Cli) -> None:
    assert "suite" in cli("schema", "suit", check=2).stderr


def test_a_dataset_is_only_as_valid_as_its_channels(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text("model: linear_drive\n")
    (tmp_path / "log.csv").touch()
    (tmp_path / "channels.yaml").write_text("channels: {voltage: {column: u, unit: bar}}\n")
    (tmp_path / "dataset.yaml").write_text(
        "model: model.yaml\nchannels: channels.yaml\ninputs: [voltage]\nruns: [{log: log.csv}]\n"
    )
    done = cli("validate", tmp_path / "dataset.yaml", check=2)
    assert "channels.yaml:1" in done.stderr
    assert "unit 'bar' has the wrong dimension" in done.stderr


SUITE = """\
name: a
{key}: {name}
trials: [{{id: a, mode: current, duration: 1 s, signal: {{kind: constant, value: 1 A}}}}]
"""


@pytest.mark.parametrize("key", ["model", "controller", "target"])
def test_a_suite_is_only_as_valid_as_the_files_it_names(cli: Cli, tmp_path: Path, key: str) -> None:
    (tmp_path / "s.yaml").write_text(SUITE.format(key=key, name="none.yaml"))
    for command in (("validate", "s.yaml"), ("run", "s.yaml", "--out", "o", "--dry-run")):
        said = cli(*command, check=2).stderr
        assert f"s.yaml:2, key '{key}': there is no file 'none.yaml'" in said


@pytest.mark.parametrize("key", ["model", "controller"])
def test_a_target_is_only_as_valid_as_the_files_it_names(
    cli: Cli, tmp_path: Path, key: str
) -> None:
    (tmp_path / "m.yaml").write_text("model: eha_knee\n")
    rest = "" if key == "model" else "model: m.yaml\n"
    (tmp_path / "t.yaml").write_text(f"target: simulator\n{key}: none.yaml\n{rest}")
    said = cli("validate", "t.yaml", check=2).stderr
    assert f"t.yaml:2, key '{key}': there is no file 'none.yaml'" in said


@pytest.mark.parametrize("mapped", [True, False])
def test_an_input_that_nobody_has_is_told(cli: Cli, tmp_path: Path, mapped: bool) -> None:
    (tmp_path / "m.yaml").write_text("model: eha_knee\n")
    (tmp_path / "log.mcap").touch()
    (tmp_path / "c.yaml").write_text(
        "channels:\n  current_command: {topic: /i, field: data}\n"
        "  valve: {topic: /v, field: d, unit: ''}\n"
    )
    text = "model: m.yaml\ninputs:\n  - motor_speed\n  - {}\nruns: [{{log: log.mcap}}]\n"
    text += "channels: c.yaml\n" if mapped else ""
    (tmp_path / "d.yaml").write_text(text.format("current_comand"))
    said = cli("validate", "d.yaml", check=2).stderr
    assert "d.yaml:4, key 'inputs.1'" in said
    assert "did you mean 'current_command'" in said
    (tmp_path / "d.yaml").write_text(text.format("valve"))
    cli("validate", "d.yaml", check=0)


def test_what_is_valid_as_json(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("model: eha_knee\nparameters: {leakage: 3 kg}\n", "utf-8")
    (tmp_path / "b.yaml").write_text("model: eha_knee\n", "utf-8")
    found = json.loads(cli("validate", "a.yaml", "b.yaml", "--json", check=2).stdout)
    first, second = found["files"]
    assert (first["valid"], first["kind"], first["error"]["line"]) == (False, "model", 2)
    assert first["error"]["key"] == "parameters.leakage"
    clean = {"valid": True, "not_checked": [], "notes": []}
    assert second == {"file": "b.yaml", "kind": "model", **clean}


@pytest.mark.parametrize("own", ["inputs: [voltage]", "channels: channels.yaml"])
def test_a_dataset_without_runs_is_told_that_it_lacks_them(
    cli: Cli, tmp_path: Path, own: str
) -> None:
    (tmp_path / "dataset.yaml").write_text(f"model: linear_drive\n{own}\n")
    done = cli("validate", "dataset.yaml", check=2)
    assert "'runs' is missing" in done.stderr
    assert "'inputs'" not in done.stderr


@pytest.mark.parametrize("command", [("validate",), ("run",)])
def test_a_result_is_called_one(cli: Cli, ran: Path, command: tuple[str, ...]) -> None:
    told = cli(*command, ran / "result.json", check=2).stderr
    assert "result.json:1: this is a result" in told
    assert "unknown key" not in told


def test_a_shipped_name_that_is_misspelt_is_suggested(cli: Cli, suite: Path) -> None:
    text = suite.read_text()
    suite.write_text(f"controller: physicl\n{text}")
    told = cli("validate", suite, check=2).stderr
    assert "tiny.yaml:1, key 'controller': there is no file 'physicl'" in told
    assert "did you mean 'physical'?" in told
    suite.write_text(f"controller: mine\n{text}")
    told = cli("validate", suite, check=2).stderr
    assert "or one that is shipped: " in told
    assert ", paper, physical" in told
    suite.write_text(f"controller: sub/physicl.yaml\n{text}")
    assert "one that is shipped" not in cli("validate", suite, check=2).stderr
