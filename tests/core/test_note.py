"""Notes keep their template and values, and are merged by these, never by their text."""

import json
import pickle

from eha_bench.core.note import Note, merged_notes, of_run


def gaps(channel: str, count: int) -> Note:
    return Note("{channel} has {count:d} gaps", channel=channel, count=count)


def test_a_note_reads_as_its_sentence() -> None:
    note = gaps("current", 3)
    assert note == "current has 3 gaps"
    assert json.dumps([note]) == '["current has 3 gaps"]'
    assert (note.template, note.values["count"]) == ("{channel} has {count:d} gaps", 3)


def test_a_note_survives_a_worker() -> None:
    back = pickle.loads(pickle.dumps(of_run("ramp", gaps("current", 3))))
    assert back == "ramp: current has 3 gaps"
    assert back.values == {"channel": "current", "count": 3, "run": "ramp"}


def test_notes_of_one_kind_are_one_with_ranges_of_their_numbers() -> None:
    notes = [of_run(run, gaps("current", count)) for run, count in (("a", 3), ("b", 12), ("c", 3))]
    assert merged_notes(notes) == ("a, b, c: current has 3 to 12 gaps",)


def test_a_number_that_is_the_same_in_all_is_no_range() -> None:
    assert merged_notes([of_run(run, gaps("current", 3)) for run in "ab"]) == (
        "a, b: current has 3 gaps",
    )


def test_words_keep_notes_apart_also_where_they_hold_numbers_or_braces() -> None:
    notes = [of_run("a", gaps("p1", 3)), of_run("a", gaps("p2", 3)), of_run("b", "{p1} and 4")]
    assert merged_notes(notes) == ("a: p1 has 3 gaps", "a: p2 has 3 gaps", "b: {p1} and 4")


def test_a_plain_sentence_that_several_runs_say_is_said_once() -> None:
    assert merged_notes([of_run("a", "torn"), of_run("b", "torn")]) == ("a, b: torn",)
