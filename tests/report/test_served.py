"""The served pages in a real browser: quiet, under a strict policy, by click and by token."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import uvicorn
from chromium import Page
from sample_run import NASTY, SampleRun

from eha_bench.core.atomic_file import write_text
from eha_bench.report import write_report
from eha_bench.server.app import application
from eha_bench.server.guard import Rules
from eha_bench.server.watch import Watch

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


@contextmanager
def serving(folder: Path, rules: Rules) -> Iterator[str]:
    """Serve a folder on the loopback; yield the address."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        watch = Watch(folder)
        config = uvicorn.Config(
            application(folder, rules, watch), log_level="warning", ws="none", loop="asyncio"
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        end = time.monotonic() + 60.0
        while watch.state.history is None and time.monotonic() < end:
            time.sleep(0.05)
        assert watch.state.history is not None, watch.state.problem
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        server.should_exit = True
        thread.join()


@pytest.fixture
def results(sample: SampleRun, tmp_path: Path) -> Path:
    """Two runs with their reports."""
    for name in ("first", "second"):
        place = tmp_path / name
        (place / "recordings").mkdir(parents=True)
        sample.result.write(place / "result.json")
        write_report(place, sample.result, sample.recordings, sample.trials)
    evil = tmp_path / "evil"
    evil.mkdir()
    sample.result.write(evil / "result.json")
    write_text(evil / "report.html", "<script>document.title='taken'</script>evil")
    return tmp_path


def click(tab: Page, selector: str) -> None:
    """Click a link, and wait for the page that it leads to."""
    before = tab.run("performance.timeOrigin")
    tab.run(f"document.querySelector({selector!r}).click()")
    tab.wait(f"performance.timeOrigin !== {before} && document.readyState === 'complete'")


def test_the_pages_are_quiet_and_two_runs_are_compared_by_click(tab: Page, results: Path) -> None:
    with serving(results, Rules()) as address:
        tab.visit(f"{address}/")
        assert "3 runs" in tab.run("document.body.textContent")
        click(tab, ".pick")
        click(tab, ".pick")
        assert "Baseline" in tab.run("document.body.textContent")
        tab.visit(f"{address}/files/history/index.html")
        click(tab, 'a[href^="trends/"]')
        assert tab.run("!!document.querySelector('svg')")
        hosts = {url.partition("//")[2].partition("/")[0] for url in tab.requests
                 if not url.startswith(("data:", "about:"))}  # fmt: skip
        assert hosts == {address.partition("//")[2]}
        assert tab.complaints == []


def test_a_stored_report_draws_in_its_sandbox_and_a_foreign_script_does_not_run(
    tab: Page, results: Path
) -> None:
    with serving(results, Rules()) as address:
        tab.visit(f"{address}/files/first/report.html#trial=pressure_step-15MPa")
        tab.wait("document.querySelectorAll('.canvas[data-drawn]').length > 0")
        assert tab.run("origin") == "null"
        assert tab.complaints == []
        assert NASTY not in tab.run("document.title")
        tab.visit(f"{address}/files/evil/report.html")
        assert tab.run("document.body.textContent") == "evil"
        assert tab.run("document.title") != "taken"


def test_a_browser_keeps_the_token_that_it_was_given_once(tab: Page, results: Path) -> None:
    with serving(results, Rules("a token")) as address:
        tab.visit(f"{address}/?token=a+token")
        assert tab.run("location.search") == ""
        assert "3 runs" in tab.run("document.body.textContent")
        assert tab.run("document.cookie") == ""  # no script reads it
        click(tab, 'a[href="/files/history/index.html"]')
        assert "History" in tab.run("document.body.textContent")
