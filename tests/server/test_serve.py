"""The pages of a folder, asked for by the ASGI test client: what they say and what they hide."""

import json
import os
import re
import socket
import time
from pathlib import Path

import numpy as np
import pytest
from asking import NASTY, asking, nights
from results import folder, result
from typer.testing import CliRunner

import eha_bench as eb
from eha_bench.cli.app import app
from eha_bench.recordings import LiveWriter
from eha_bench.server.guard import Rules
from eha_bench.server.inside import inside
from eha_bench.server.live_view import live_view, loop_so_far
from eha_bench.server.runs_on import look
from eha_bench.server.serving import is_loopback
from eha_bench.server.stored import policy_of


def grow(place: Path, rate: float = 500.0) -> Path:
    recordings = place / "recordings"
    recordings.mkdir(parents=True)
    path = recordings / "pressure_step-0.mcap"
    writer = LiveWriter(path, {"pressure_a": "Pa", "current": "A"}, epoch_ns=0)
    for tick in range(1000):
        writer.append(tick / rate, [5e6 + tick, 2.0])
    writer.flush()  # as a run that is on leaves it: chunks are written, the end is not
    content = path.read_bytes()
    writer.close()
    path.write_bytes(content)
    return path


def everything(path: Path) -> dict[str, tuple[int, bytes]]:
    return {
        str(file.relative_to(path)): (file.stat().st_mtime_ns, file.read_bytes())
        for file in path.rglob("*")
        if file.is_file()
    }


def test_the_first_page_has_runs_and_verdict_with_links_that_lead_somewhere(served):
    text = served.text("/")
    assert "12 runs, 1 metric: none drifted" in text
    links = re.findall(r'href="(/[^"]*)"', text)
    assert "/files/history/index.html" in links
    assert "/files/night-11/report.html" in links
    assert len([link for link in links if link.startswith("/?baseline=night-")]) == 12
    for link in links:
        assert served.client.get(link.replace("&amp;", "&")).status_code == 200, link


def test_the_site_is_the_one_that_history_writes(served, tmp_path):
    served.client.get("/")
    eb.history(served.folder)
    written = served.folder / "history"
    for path in [written / "index.html", *(written / "trends").glob("*.html")]:
        name = path.relative_to(written).as_posix()
        here = served.text(f"/files/history/{name}")
        file = path.read_text(encoding="utf-8")
        # but for the title, which is the folder as it was given
        assert here.replace(served.folder.name, "") == file.replace(str(served.folder), "").replace(
            served.folder.name, ""
        )
    assert json.loads(served.text("/files/history/history.json"))["status"] == "steady"


def test_nothing_is_written_into_the_folder(served):
    before = everything(served.folder)
    for link in ("/", "/files/history/index.html", "/status.json"):
        served.text(link)
    served.text("/compare?baseline=night-00&candidate=night-11")
    served.watch.refresh()
    assert everything(served.folder) == before


def test_two_runs_are_compared_by_two_clicks(served):
    first = served.text("/")
    pick = next(one for one in re.findall(r'href="([^"]*)"', first) if "baseline=night-03" in one)
    second = served.text(pick)
    assert "Baseline: <strong>night-03</strong>" in second
    both = next(one for one in re.findall(r'href="([^"]*)"', second) if "candidate=night-07" in one)
    page = served.text(both.replace("&amp;", "&"))
    assert "Rise time" in page
    assert "night-03" in page
    assert "night-07" in page


@pytest.mark.parametrize(
    "query",
    [
        "baseline=night-00",
        "baseline=night-00&candidate=nowhere",
        "baseline=night-00&candidate=../night-00",
        "baseline=night-00&candidate=%2Fetc",
        "baseline=night-00&candidate=history",
        "baseline=.&candidate=night-00",
    ],
)
def test_what_is_no_run_is_not_compared(served, query):
    answer = served.client.get(f"/compare?{query}")
    assert answer.status_code in (400, 404)
    assert "Traceback" not in answer.text


def test_a_recording_elsewhere_is_not_opened(served, tmp_path):
    outside = tmp_path / "kept_apart.mcap"
    outside.write_bytes(b"secret")
    place = served.folder / "night-00" / "result.json"
    content = json.loads(place.read_text())
    for trial in content["trials"]:
        trial["recording"] = "../../kept_apart.mcap"
    place.write_text(json.dumps(content))
    page = served.text("/compare?baseline=night-00&candidate=night-01")
    assert "kept_apart" not in page


def test_a_new_result_is_seen_and_one_that_is_gone_stays_in_the_trend(served):
    made = result([1.0] * 3, started="2025-02-01T02:00:00+00:00")
    folder(served.folder / "night-99", made)
    served.watch.refresh()
    assert "night-99" in served.text("/")
    (served.folder / "night-99" / "result.json").unlink()
    served.watch.refresh()
    text = served.text("/")
    assert "13 runs" in text
    assert "results are gone" in text


def test_an_index_of_another_kind_is_made_anew(tmp_path):
    nights(tmp_path)
    (tmp_path / "history").mkdir()
    (tmp_path / "history" / "index.sqlite").write_bytes(b"not a database" * 100)
    served = asking(tmp_path)
    assert "12 runs" in served.text("/")
    assert (tmp_path / "history" / "index.sqlite").read_bytes() == b"not a database" * 100


def test_a_folder_without_results_says_so(tmp_path):
    served = asking(tmp_path)
    text = served.text("/")
    assert "No history yet" in text
    assert "holds no result" in text
    assert served.client.get("/files/history/index.html").status_code == 503


def test_before_the_history_is_worked_out_the_page_comes_again(tmp_path):
    nights(tmp_path)
    from starlette.testclient import TestClient

    from eha_bench.server.app import application
    from eha_bench.server.watch import Watch

    watch = Watch(tmp_path)
    client = TestClient(application(tmp_path, Rules(), watch), base_url="http://127.0.0.1")
    waiting = client.get("/")
    assert "Computing" in waiting.text
    assert waiting.headers["refresh"] == "2"
    with client:  # the application begins the watch, and ends it
        for _ in range(200):
            if client.get("/status.json").json()["status"]:
                break
            time.sleep(0.05)
        settled = client.get("/")
    assert "12 runs" in settled.text
    assert "refresh" not in settled.headers


def test_a_run_that_is_on_shows_its_channels_and_its_loop(served):
    grow(served.folder / "tonight")
    served.watch.refresh()
    assert 'href="/live/tonight"' in served.text("/")
    assert json.loads(served.text("/status.json"))["running"] == ["tonight"]
    answer = served.client.get("/live/tonight")
    assert int(answer.headers["refresh"]) >= 2
    assert "pressure_step-0" in answer.text
    assert "Period 2.000 ms at the median" in answer.text
    assert "Pressure" in answer.text
    assert '<path d="M' in answer.text
    served.text("/live/night-00", 404)
    served.text("/live/../etc", 404)


def test_what_a_run_that_is_on_has_not_done_yet_is_not_lost(served):
    before = json.loads(served.text("/status.json"))
    place = grow(served.folder / "tonight").parents[1]
    begun = json.loads((served.folder / "night-00" / "result.json").read_text(encoding="utf-8"))
    begun |= {"status": "incomplete", "trials": []}
    (place / "result.json").write_text(json.dumps(begun), encoding="utf-8")
    served.watch.refresh()
    on = json.loads(served.text("/status.json"))
    assert (on["running"], on["status"]) == (["tonight"], before["status"])
    assert "12 runs, " in served.text("/")
    assert "has no value of" not in served.text("/")
    ended = time.time() - 60.0
    for path in (place / "recordings").iterdir():
        os.utime(path, (ended, ended))
    served.watch.refresh()
    assert "13 runs, " in served.text("/")


def test_the_digits_of_a_channel_are_those_of_its_range(tmp_path):
    view = live_view(grow(tmp_path / "run"))
    for channel in view.channels:
        digits = {
            len(text.partition(".")[2]) for text in (channel.newest, channel.low, channel.high)
        }
        assert len(digits) == 1


def test_a_run_counts_as_on_while_its_recording_grows(tmp_path):
    path = grow(tmp_path / "run")
    now = path.stat().st_mtime
    assert [run.name for run in look(tmp_path, now + 5.0).runs_on] == ["run"]
    assert look(tmp_path, now + 15.0).runs_on == ()
    os.utime(path.parent, (now - 1e6, now - 1e6))
    assert look(tmp_path, now + 5.0).runs_on == ()


def test_a_recording_of_which_nothing_can_be_read_yet_is_said(served):
    place = served.folder / "tonight" / "recordings"
    place.mkdir(parents=True)
    (place / "step-0.mcap").write_bytes(b"\x89MCAP0\r\n")
    served.watch.refresh()
    assert "Nothing to show yet" in served.text("/live/tonight")


def test_loop_health_counts_late_ticks():
    time_ = np.arange(1000) / 500.0
    assert "0 of 1000 ticks late" in loop_so_far(time_)
    time_[500:] += 0.003
    assert "5.000 ms at most; 1 of 1000 ticks late" in loop_so_far(time_)
    assert loop_so_far(time_[:1]) == "1 tick so far"


@pytest.mark.parametrize(
    "name",
    [
        "../secret.html",
        "..%2fsecret.html",
        "%2e%2e/secret.html",
        "night-00/../../secret.html",
        "night-00/%2e%2e/%2e%2e/secret.html",
        "/etc/passwd",
        "//etc/passwd",
        "..\\secret.html",
        "link.html",
        "links/secret.html",
        ".hidden/report.html",
        "night-00/.hidden.html",
        "night-00",
        "night-00/",
        "night-00/result.json%00.html",
        "history/../../secret.html",
        "history/index.sqlite",
        "night-00/key.pem",
    ],
)
def test_nothing_outside_and_nothing_hidden_is_sent(served, name):
    secret = served.folder.parent / "secret.html"
    secret.write_text("secret")
    (served.folder / "link.html").symlink_to(secret)
    (served.folder / "links").symlink_to(secret.parent)
    (served.folder / ".hidden").mkdir()
    (served.folder / ".hidden" / "report.html").write_text("secret")
    (served.folder / "night-00" / ".hidden.html").write_text("secret")
    (served.folder / "night-00" / "key.pem").write_text("secret")
    answer = served.client.get(f"/files/{name}")
    assert answer.status_code == 404
    assert "secret" not in answer.text


def test_a_link_within_the_folder_is_followed(served):
    (served.folder / "latest").symlink_to(served.folder / "night-11")
    assert served.client.get("/files/latest/result.json").status_code == 200
    assert inside(served.folder, "latest/result.json") is not None
    assert inside(served.folder, "") is None


def test_stored_pages_run_only_what_they_declare_and_in_a_sandbox(served, tmp_path):
    answer = served.client.get("/files/night-00/report.html")
    policy = answer.headers["content-security-policy"]
    assert "script-src" not in policy
    assert "default-src 'none'" in policy
    assert re.search(r"sandbox(;|$)", policy)
    own = served.client.get("/files/history/index.html").headers["content-security-policy"]
    assert "sandbox" not in own
    assert "script-src 'sha256-" in own
    site = served.folder / "night-01" / "report.html"
    site.write_text(served.text("/files/history/index.html"))
    stored = served.client.get("/files/night-01/report.html").headers["content-security-policy"]
    assert stored == f"{own}; sandbox allow-scripts allow-downloads"


@pytest.mark.parametrize(
    "policy",
    [
        "default-src *",
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'none'; img-src data:; "
        "base-uri 'none'; form-action 'none'",
        "default-src 'none'; script-src https://elsewhere; style-src 'none'; img-src data:; "
        "base-uri 'none'; form-action 'none'",
    ],
)
def test_a_page_does_not_give_itself_more_than_digests(policy):
    page = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    assert "script-src" not in policy_of(page)


@pytest.mark.parametrize(
    "path", ["/", "/nowhere", "/files/x", "/compare", "/files/night-00/result.json"]
)
def test_every_answer_is_guarded(served, path):
    headers = served.client.get(path).headers
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "unsafe-eval" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"


def test_hostile_names_stay_text(tmp_path):
    watched = tmp_path / "results"
    hostile = watched / "<img src=x onerror=alert(1)>"
    folder(hostile, result([1.0] * 3, host=NASTY, target=NASTY, revision=NASTY))
    nights(watched)
    served = asking(watched)
    grow(watched / "<b>on</b>")
    served.watch.refresh()
    for path in ("/", "/?baseline=<script>alert(2)</script>", "/files/history/index.html"):
        text = served.text(path)
        assert "<script>alert" not in text
        assert "<img" not in text
        assert "<b>on" not in text
    assert "<b>" not in served.text("/live/%3Cb%3Eon%3C/b%3E")
    assert "<script>alert" not in served.text("/compare?baseline=<script>alert(3)&candidate=x", 404)


def test_only_reading_is_allowed(served):
    for method in ("post", "put", "delete", "patch", "options"):
        assert getattr(served.client, method)("/").status_code == 405
    assert served.client.head("/").status_code == 200


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:8765", 200),
        ("localhost", 200),
        ("[::1]:80", 200),
        ("LOCALHOST:1", 200),
        ("attacker.example", 400),
        ("127.0.0.1.attacker.example:8765", 400),
        ("", 400),
    ],
)
def test_a_name_of_somebody_else_that_leads_here_is_refused(served, host, status):
    assert served.client.get("/", headers={"host": host}).status_code == status


def test_with_a_token_nothing_is_said_without_it(tmp_path):
    nights(tmp_path)
    served = asking(tmp_path, Rules("a token"), "http://rig.example")
    for path in ("/", "/status.json", "/files/night-00/result.json", "/?token=another"):
        answer = served.client.get(path)
        assert answer.status_code == 401
        assert "night" not in answer.text
    assert served.client.get("/", headers={"authorization": "Bearer a token"}).status_code == 200
    assert served.client.get("/", headers={"authorization": "Bearer b"}).status_code == 401
    first = served.client.get("/?token=a+token&from=0", follow_redirects=False)
    assert (first.status_code, first.headers["location"]) == (303, "/?from=0")
    cookie = first.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "a token" not in cookie
    assert served.client.get("/").status_code == 200
    away = served.client.get(
        "http://rig.example//elsewhere.example/?token=a+token", follow_redirects=False
    )
    assert away.headers["location"].startswith("/elsewhere")


def test_many_runs_come_in_pages(tmp_path, monkeypatch):
    monkeypatch.setattr("eha_bench.server.pages.RUNS_A_PAGE", 5)
    nights(tmp_path)
    served = asking(tmp_path)
    first = served.text("/")
    assert first.count("as baseline<") == 5
    assert "newer runs" not in first
    last = served.text("/?from=10")
    assert last.count("as baseline<") == 2
    assert "older runs" not in last
    for odd in ("-1", "x", "9" * 30, "²"):
        assert served.text(f"/?from={odd}").count("as baseline<") == 5


@pytest.mark.parametrize(
    ("address", "here"),
    [("127.0.0.1", True), ("127.3.2.1", True), ("::1", True), ("0.0.0.0", False), ("::", False)],
)
def test_what_is_only_of_this_machine(address, here):
    assert is_loopback(address) is here


def test_mistakes_at_the_command_line_are_told(tmp_path):
    missing = CliRunner().invoke(app, ["serve", str(tmp_path / "nowhere")])
    assert "no such folder" in str(missing.exception)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        found = CliRunner().invoke(app, ["serve", str(tmp_path), "--port", port])
    assert "cannot be listened on" in str(found.exception)
