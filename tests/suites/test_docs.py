"""The reference of suites says what the code reads."""

import re
from pathlib import Path

from writing import load

from eha_bench.core import plugins
from eha_bench.suites.suite_file import TrialFile


def reference(repository: Path) -> str:
    return (repository / "docs" / "suites.md").read_text(encoding="utf-8")


def test_example_is_a_suite(repository: Path, tmp_path: Path) -> None:
    (example,) = re.findall(r"```yaml\n(.*?)```", reference(repository), re.DOTALL)
    assert [trial.id for trial in load(tmp_path, example).trials] == [
        "pressure_step-15MPa",
        "pressure_step-20MPa",
        "knee_sine",
    ]


def test_every_signal_and_its_keys_are_explained(repository: Path) -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*?) \|", reference(repository), re.MULTILINE))
    for kind in plugins.names("signals"):
        fields = plugins.load("signals", kind).model_fields
        for name, field in fields.items():
            if name not in ("kind", "samples"):
                assert f"`{field.alias or name}" in rows[kind], f"{kind}: {name}"


def test_every_key_of_a_trial_is_explained(repository: Path) -> None:
    text = reference(repository)
    for key in TrialFile.model_fields:
        assert f"`{key}`" in text
