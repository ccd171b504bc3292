"""A summary is sent on: to a webhook, to a command, or said why not."""

import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError
from eha_bench.report.sending import send_on
from eha_bench.trends.history import History
from eha_bench.trends.nightly_file import Nightly, load_nightly

sys.path.insert(0, str(Path(__file__).parents[1] / "comparison"))
from results import folder, result


@pytest.fixture
def drifted(tmp_path: Path) -> History:
    values = [*(1.0 + 0.01 * np.random.default_rng(1).normal(size=30)), 2.0]
    for i, value in enumerate(values):
        started = f"2025-01-{i + 1:02d}T02:00:00+00:00"
        folder(tmp_path / "nights" / f"{i:02d}", result([value], started=started, revision=f"r{i}"))
    return eb.history(tmp_path / "nights")


class Hook(BaseHTTPRequestHandler):
    answer = 200

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.received.append((self.headers["Content-Type"], json.loads(body)))
        if self.answer < 0:
            self.wfile.write(b"no status line, but " + self.path.encode() + b"\r\n\r\n")
            return
        self.send_response(self.answer, f"as for {self.path}")
        self.send_header("Location", "http://127.0.0.1:1/")
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def hook() -> Iterator[HTTPServer]:
    server = HTTPServer(("127.0.0.1", 0), Hook)
    server.received = []
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()


def test_a_webhook_gets_text_and_what_programs_read(
    drifted: History, hook: HTTPServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"http://127.0.0.1:{hook.server_port}/x"
    assert "sent" in send_on(drifted, Nightly(send=url))
    monkeypatch.setenv("KNEE_HOOK", url)
    assert "sent" in send_on(drifted, Nightly(send="$KNEE_HOOK"))
    (kind, content), again = hook.received
    assert again[1] == content
    assert kind == "application/json"
    assert content["status"] == "drifted"
    assert "Rise time" in content["text"]
    assert "r29 → r30" in content["events"][0]
    assert content["drifted"][0]["metric"] == "rise_time"


def test_a_webhook_that_refuses_or_leads_elsewhere_is_said(
    drifted: History, hook: HTTPServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"http://127.0.0.1:{hook.server_port}/x"
    for answer in (500, 302):
        monkeypatch.setattr(Hook, "answer", answer)
        with pytest.raises(InputError, match=str(answer)):
            send_on(drifted, Nightly(send=url))
    with pytest.raises(InputError, match="did not answer"):
        send_on(drifted, Nightly(send="http://127.0.0.1:1/"))
    with pytest.raises(InputError, match="NO_SUCH_NAME"):
        send_on(drifted, Nightly(send="$NO_SUCH_NAME"))


@pytest.mark.parametrize("answer", [500, 302, 799, -1])
def test_what_a_webhook_answers_tells_nobody_its_address(
    drifted: History, hook: HTTPServer, monkeypatch: pytest.MonkeyPatch, answer: int
) -> None:
    monkeypatch.setattr(Hook, "answer", answer)
    with pytest.raises(InputError) as caught:
        send_on(drifted, Nightly(send=f"http://127.0.0.1:{hook.server_port}/TOKEN"))
    assert "TOKEN" not in str(caught.value)
    assert "not HTTP" in str(caught.value) if answer < 0 else f" {answer}" in str(caught.value)
    assert caught.value.__suppress_context__


@pytest.fixture
def dripping() -> Iterator[int]:
    """Port of a peer whose answer comes byte by byte, and never ends."""
    stopping = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def drip() -> None:
            peer, _ = server.accept()
            with peer, suppress(OSError):
                peer.sendall(b"HTTP/1.1 200 OK\r\nX: ")
                while not stopping.wait(0.02):
                    peer.sendall(b"x")

        thread = threading.Thread(target=drip)
        thread.start()
        yield server.getsockname()[1]
        stopping.set()
        thread.join()


def test_a_webhook_that_drips_does_not_hold_the_night(
    drifted: History, dripping: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eha_bench.report.sending._PATIENCE_S", 0.4)
    started = time.monotonic()
    with pytest.raises(InputError, match=r"did not answer \(not within 0.4 s\)"):
        send_on(drifted, Nightly(send=f"http://127.0.0.1:{dripping}/x"))
    assert time.monotonic() - started < 10.0  # the peer itself never ends


def test_a_command_gets_markdown_and_no_shell_reads_it(drifted: History, tmp_path: Path) -> None:
    out = tmp_path / "mail.txt"
    script = tmp_path / "mail.py"
    script.write_text(
        "import sys, pathlib\n"
        "text = sys.argv[1] + chr(10) + sys.stdin.read()\n"
        f"pathlib.Path({str(out)!r}).write_text(text, 'utf-8')\n",
        encoding="utf-8",
    )
    send_on(drifted, Nightly(send=f"{sys.executable} {script} 'rig {{status}}; $(rm x)'"))
    first, _, text = out.read_text(encoding="utf-8").partition("\n")
    assert first == "rig drifted; $(rm x)"
    assert text.startswith("## ❌")
    with pytest.raises(InputError, match="cannot be run"):
        send_on(drifted, Nightly(send="/no/such/mailer"))
    with pytest.raises(InputError, match="exited with 3"):
        send_on(drifted, Nightly(send=f"{sys.executable} -c 'raise SystemExit(3)'"))


def test_steady_nights_are_sent_only_always(tmp_path: Path, hook: HTTPServer) -> None:
    for i, value in enumerate(1.0 + 0.01 * np.random.default_rng(2).normal(size=12)):
        started = f"2025-01-{i + 1:02d}T02:00:00+00:00"
        folder(tmp_path / f"{i:02d}", result([float(value)], started=started))
    steady = eb.history(tmp_path)
    url = f"http://127.0.0.1:{hook.server_port}/"
    assert send_on(steady, Nightly(send=url)) == ""
    assert send_on(steady, Nightly(send=url, when="always")) != ""
    assert len(hook.received) == 1
    assert (tmp_path / "history" / "history.md").read_text(encoding="utf-8").startswith("## ✅")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("send: ''", "neither a webhook nor a command"),
        ('send: "mail \'x"', "is not a command"),
        ("sent: x", "send"),
        ("send: http://host:port/x", "is not the address of a webhook"),
        ("send: http://me:secret@host/x", "write http"),
        ("send: 'https://host/a b'", "is not the address of a webhook"),
        ("send: 'http://[::1/x'", "is not the address of a webhook"),
        ("send: https:///x", "is not the address of a webhook"),
        ("send: x\nwhen: sometimes", "when"),
    ],
)
def test_a_wrong_nightly_file_is_told(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "nightly.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said) as caught:
        load_nightly(path)
    assert "nightly.yaml" in str(caught.value)
