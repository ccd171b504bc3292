"""The made-up run, its page and the browser that the report's tests share."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from chromium import Browser, Page, find_chromium
from sample_run import SampleRun, sample_run

from eha_bench.report import write_report


@pytest.fixture(scope="session")
def sample() -> SampleRun:
    return sample_run()


@pytest.fixture(scope="session")
def page_file(sample: SampleRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the made-up run, beside recordings that are there."""
    folder = tmp_path_factory.mktemp("report")
    (folder / "recordings").mkdir()
    for run in sample.result.trials:
        if run.recording:
            (folder / run.recording).write_bytes(b"")
    return write_report(folder, sample.result, sample.recordings, sample.trials)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless Chromium; skips where there is none, but fails in CI."""
    executable = find_chromium()
    if executable is None:
        reason = "no Chromium to look at reports with: install chromium, or name one in CHROMIUM"
        if os.environ.get("CI", "").lower() in {"1", "true", "yes"}:
            pytest.fail(reason)
        pytest.skip(reason)
    with Browser(executable) as running:
        yield running


@pytest.fixture
def tab(browser: Browser) -> Iterator[Page]:
    page = browser.page()
    yield page
    page.close()
