"""The page of a run, as text: what it says; no name is markup, nothing comes from outside."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from sample_run import NASTY, SampleRun, sample_run

from eha_bench.core.errors import RecordingError
from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status
from eha_bench.report import write_report
from eha_bench.report.run_report import anchor_of, headline, recording_href


class Outline(HTMLParser):
    """Collects what matters: ids, links, inline styles, handlers, scripts, text."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.outside: list[str] = []
        self.handlers: list[str] = []
        self.styled = 0
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            text = value or ""
            if name == "id":
                self.ids.append(text)
            elif name == "href":
                self.links.append(text)
            elif name == "style":
                self.styled += 1
            elif name.startswith("on"):
                self.handlers.append(name)
            if name in ("href", "src") and re.match(r"(?!data:)[a-z]+:|//", text):
                self.outside.append(text)

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def outline(path: Path) -> Outline:
    found = Outline()
    found.feed(path.read_text(encoding="utf-8"))
    return found


def test_page_is_self_contained_and_strict(page_file: Path) -> None:
    found = outline(page_file)
    assert found.outside == []
    assert found.handlers == []
    assert found.styled == 0
    assert len(found.ids) == len(set(found.ids))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page_file.read_text("utf-8"))
    assert policy is not None
    assert policy[1].startswith("default-src &#39;none&#39;")
    assert "unsafe" not in policy[1]
    assert "http" not in policy[1]


def test_links_lead_somewhere(page_file: Path) -> None:
    found = outline(page_file)
    for link in found.links:
        if link.startswith("#"):
            assert link[1:] in found.ids, link
        elif not link.startswith("data:"):
            assert (page_file.parent / link).exists()


def test_summary_comes_first_worst_first(page_file: Path) -> None:
    text = page_file.read_text(encoding="utf-8")
    order = [
        text.index(">Fault<"),
        text.index("Stopped, unfinished or unsafe"),
        text.index(">Limits not kept, worst first"),
        text.index("2.58\u00a0ms"),
        text.index("0.072\u00a0A"),
        text.index('id="trial=pressure_step-15MPa"'),
    ]
    assert order == sorted(order)


def test_repeats_are_collapsed(page_file: Path) -> None:
    text = page_file.read_text(encoding="utf-8")
    assert text.count('<details class="repeat-details"') == 2
    assert 'id="trial=pressure_step-20MPa&amp;repeat=1"' in text


def test_provenance_and_notes_are_told(page_file: Path) -> None:
    text = page_file.read_text(encoding="utf-8")
    for expected in ("d81d2b8", "9c" * 32, "bench-2", "resampled onto 1 kHz", "oil temperature"):
        assert expected in text


def only(sample: SampleRun, *places: int) -> Result:
    return replace(sample.result, trials=tuple(sample.result.trials[i] for i in places))


def test_a_report_is_the_same_each_time(sample: SampleRun, tmp_path: Path) -> None:
    result = only(sample, 0)
    pages = [
        write_report(tmp_path, result, sample.recordings, sample.trials).read_bytes()
        for _ in range(2)
    ]
    assert pages[0] == pages[1]
    assert [path.name for path in tmp_path.glob(".*")] == []


def test_names_are_text_wherever_they_stand(tmp_path: Path) -> None:
    sample = sample_run(NASTY)
    run = sample.result.trials[0]
    trial = replace(sample.trials[run.id], id=NASTY)
    nasty = replace(run, id=NASTY, reason=NASTY, notes=(NASTY,), recording=NASTY, sha256=NASTY)
    nasty = replace(
        nasty,
        scores=tuple(
            replace(s, metric=NASTY, channel=NASTY, limit=NASTY, unit=NASTY) for s in run.scores
        ),
    )
    recording = sample.recordings[(run.id, 0)]()
    recording = recording.with_values({NASTY: recording["current"]})
    recording = replace(recording, notes=(NASTY,), units={**recording.units, NASTY: NASTY})
    result = Result(NASTY, NASTY, Status.FAILED, (nasty,), {NASTY: NASTY, "started": NASTY}, NASTY)
    path = write_report(tmp_path, result, {(NASTY, 0): lambda: recording}, {NASTY: trial})
    assert "<script>alert" not in path.read_text(encoding="utf-8")
    assert NASTY in "".join(outline(path).text)


def test_a_recording_that_cannot_be_read_is_said(sample: SampleRun, tmp_path: Path) -> None:
    def torn() -> Recording:
        raise RecordingError("the file ends in the middle of a record")

    loaders = {**sample.recordings, ("knee_sine-1Hz", 0): torn}
    text = write_report(tmp_path, only(sample, 5, 6), loaders, sample.trials).read_text("utf-8")
    assert "No plot: the file ends in the middle of a record." in text
    assert "No plot: the recording is missing." in text


def test_trials_may_be_unknown(sample: SampleRun, tmp_path: Path) -> None:
    text = write_report(tmp_path, only(sample, 1), sample.recordings, {}).read_text("utf-8")
    assert "<svg" in text
    assert "48.16" in text


def test_a_trial_without_limits_is_not_shown_as_passed(sample: SampleRun, tmp_path: Path) -> None:
    run = sample.result.trials[0]
    free = replace(run, scores=tuple(replace(score, limit="") for score in run.scores))
    result = replace(sample.result, trials=(sample.result.trials[3], free), not_run=())
    text = write_report(tmp_path, result, sample.recordings, sample.trials).read_text("utf-8")
    trial = text.split(f'id="{anchor_of(free.id)}"')[1].split("</summary>")[0]
    assert "not judged" in trial
    assert "passed" not in trial
    assert 'data-show="unjudged"' in text


def test_an_empty_result_has_a_page(tmp_path: Path) -> None:
    result = Result("nothing", "simulator", Status.INCOMPLETE, ())
    text = write_report(tmp_path, result, {}, {}).read_text("utf-8")
    assert "Not all was run" in text


def test_headline(sample: SampleRun) -> None:
    assert headline(sample.result) == (
        "1 run stopped by a fault or a safety limit; "
        "4 of 21 limits missed, 1 undecided, 2 not scored, in 4 of 5 trials."
    )
    passed = replace(sample.result, status=Status.PASSED, trials=sample.result.trials[:1])
    assert headline(passed) == "All 3 limits kept in 1 trial."
    kept = passed.trials[0]
    free = replace(kept, id="free", scores=tuple(replace(s, limit="") for s in kept.scores))
    both = replace(passed, trials=(kept, free))
    assert headline(both) == "All 3 limits kept in 1 of 2 trials."


@pytest.mark.parametrize(
    ("recording", "href"),
    [
        ("recordings/a b.mcap", "recordings/a%20b.mcap"),
        ("../outside.mcap", ""),
        ("recordings/../../x", ""),
        ("javascript:alert(1)", "javascript%3Aalert%281%29"),
        ("missing.mcap", ""),
        ("", ""),
    ],
)
def test_recordings_are_linked_only_below_the_report(
    tmp_path: Path, recording: str, href: str
) -> None:
    (tmp_path / "recordings").mkdir()
    for name in ("recordings/a b.mcap", "javascript:alert(1)"):
        (tmp_path / name).write_bytes(b"")
    assert recording_href(tmp_path, recording) == href
    assert recording_href(tmp_path, str(tmp_path / "recordings/a b.mcap")) == ""
