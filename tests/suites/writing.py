"""How tests write suites and read what is wrong with them."""

from pathlib import Path
from textwrap import dedent

import pytest

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.trial import Trial
from eha_bench.suites import Suite, load_suite

STEP = """
trials:
  - id: step
    mode: pressure
    duration: 0.5 s
    signal: {kind: step, final: 15 MPa, at: 1 ms}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "suite.yaml"
    path.write_text(dedent(text), encoding="utf-8")
    return path


def load(folder: Path, text: str) -> Suite:
    return load_suite(write(folder, text))


def only(folder: Path, text: str) -> Trial:
    (trial,) = load(folder, text).trials
    return trial


def refusal(folder: Path, text: str) -> EhaBenchError:
    """The one-sentence error that a suite gives."""
    path = write(folder, text)
    with pytest.raises(EhaBenchError) as caught:
        load_suite(path)
    error = caught.value
    assert error.exit_status == 2
    assert "\n" not in str(error)
    assert error.where.file
    return error


def with_signal(signal: str, mode: str = "pressure", duration: str = "1 s") -> str:
    return f"""
trials:
  - id: one
    mode: {mode}
    duration: {duration}
    signal: {signal}
"""
