"""The hostile and damaged files of `shared/data/hostile`: each with what has to happen.

Every file is read, described and recovered in a process of its own, so that its memory and time are
its own as well.
"""

import json
import os
import shutil
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from eha_bench import recordings
from eha_bench.core.errors import InputError, RecordingError
from eha_bench.recordings import info, recover
from forked import Forked

FORCE = {"channels": {"force": {"topic": "/f", "field": "data", "unit": "N"}}}
TABLE = {
    "time": {"column": "t", "unit": "s"},
    "channels": {
        "pressure_a": {"column": "p", "unit": "bar"},
        "current": {"column": "n", "unit": "A"},
    },
}
SECONDS, MEGABYTES = 5.0, 500

ALONE = """
import json, re, sys, time
from pathlib import Path
from eha_bench import recordings
from eha_bench.core.errors import EhaBenchError
path, mapping, target = sys.argv[1], json.loads(sys.argv[2]), sys.argv[3]
Path("/proc/self/clear_refs").write_text("5")  # the peak begins at what this process holds now
for act in (lambda: recordings.read(path, channels=mapping), lambda: recordings.info(path),
            lambda: recordings.recover(path, target)):
    start = time.process_time()
    try:
        act()
    except EhaBenchError as error:
        assert "\\n" not in str(error), error
    peak = re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())
    print(time.process_time() - start, int(peak[1]) / 1024)
"""


@pytest.fixture
def hostile(shared_data: Path) -> Path:
    return shared_data / "hostile"


def mapping(name: str) -> Any:
    if name.startswith("one_bit"):
        return None
    if name.endswith((".csv", ".mat", ".parquet")):
        return TABLE
    topic = {"topic": "/t", "field": "x", "unit": "N"}
    return {"channels": {"force": topic}} if name.startswith("walker") else FORCE


BUDGETS = {
    "dupe60k.csv": 2.0,
    "markspam.mcap": 2.0,
    **dict.fromkeys(
        (
            "walker.mcap", "walker_str.mcap", "view.db3", "idl_shift.mcap", "bomb3.mcap",
            "bomb_torn.mcap", "bigmsg.mcap", "case-1-c.csv", "case-4-plain.mat", "case-60-two.db3",
            "case-1494-a.parquet", "redefine.mcap", "case-15-LZ4.bag",
        ),
        SECONDS,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BUDGETS)
def test_no_file_takes_more_than_its_budget(
    forked: Forked, hostile: Path, tmp_path: Path, name: str
) -> None:
    words = (hostile / name, json.dumps(mapping(name)), tmp_path / "clean.mcap")
    done = forked.run(*words, folder=tmp_path, code=ALONE)
    assert done.returncode == 0, done.stderr
    for line in done.stdout.splitlines():
        seconds, megabytes = map(float, line.split())
        assert seconds < BUDGETS[name]
        assert megabytes < MEGABYTES


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("one_bit.mcap", "trial.json is damaged"),
        ("one_bit_name.mcap", "names of its channels are damaged"),
        ("one_bit_unit.mcap", "names or units of its channels are damaged"),
        ("wrong_data_crc.mcap", "checksum of its data is wrong"),
        ("removed_chunk.mcap", "100 messages, it holds 50"),
        ("case-1285-plain.bag", "3 messages, not 60"),
    ],
)
def test_damage_is_said(hostile: Path, name: str, said: str) -> None:
    found = recordings.read(hostile / name, channels=mapping(name))
    assert any(said in note for note in found.notes)
    described = info(hostile / name)
    assert described.health == "damaged"
    assert any(said in note for note in described.notes)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lz4short.mcap", "more than the 430 bytes that are declared"),
        ("case-15-LZ4.bag", "more than the 255 bytes that are declared"),
        ("redefine.mcap", "channel 1 is declared twice, as '/f' and '/other'"),
    ],
)
def test_what_cannot_be_believed_is_not_read(hostile: Path, name: str, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        recordings.read(hostile / name, channels=FORCE)
    described = info(hostile / name)
    assert described.health == "damaged"
    assert any(said in note for note in described.notes)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("view.db3", "its 'topics' is a view"),
        ("idl_shift.mcap", "its IDL computes a constant"),
        ("bomb3.mcap", "--max-memory"),
        ("bomb_torn.mcap", "--max-memory"),
        ("bigmsg.mcap", "--max-memory"),
        ("walker.mcap", "--max-memory"),
        ("walker_str.mcap", "--max-memory"),
        ("dupe60k.csv", "60001 columns"),
        ("case-1-c.csv", "is not a number"),
        ("case-4-plain.mat", "not made of whole numbers"),
        ("case-60-two.db3", "no time or no data"),
        ("case-1494-a.parquet", "does not hold numbers|there is no column"),
    ],
)
def test_what_is_refused(hostile: Path, name: str, said: str) -> None:
    with pytest.raises(RecordingError, match=said):
        recordings.read(hostile / name, channels=mapping(name))


def test_score_refuses_a_damaged_trial(hostile: Path, tmp_path: Path) -> None:
    from eha_bench.bench.judging import score_recordings

    with pytest.raises(InputError, match="its trial is damaged"):
        score_recordings([hostile / "one_bit.mcap"])


@pytest.mark.parametrize(
    "name", ["one_bit.mcap", "one_bit_name.mcap", "one_bit_unit.mcap", "wrong_data_crc.mcap"]
)
def test_recover_makes_nothing_right(hostile: Path, tmp_path: Path, name: str) -> None:
    report = recover(hostile / name, tmp_path / "clean.mcap")
    assert report.notes
    described = info(tmp_path / "clean.mcap")
    assert described.health == "damaged"
    assert any("damaged" in note for note in described.notes)
    assert any("damaged" in n for n in recordings.read(
        tmp_path / "clean.mcap", channels=mapping(name)).notes)  # fmt: skip


def test_a_marked_file_without_chunks_is_torn(hostile: Path) -> None:
    described = info(hostile / "markspam.mcap")
    assert described.health == "damaged"


@pytest.mark.parametrize("act", [recordings.read, info])
def test_pipes_and_devices_are_no_recordings(tmp_path: Path, act: Any) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(RecordingError, match="a pipe or a device"):
            act(path)
        with pytest.raises(RecordingError, match="a pipe or a device"):
            recover(path, tmp_path / "clean.mcap")


def test_a_quantity_of_400_digits_is_one_sentence(
    forked: Forked, hostile: Path, tmp_path: Path
) -> None:
    done = forked.run("validate", hostile / "huge5.yaml", folder=tmp_path)
    assert done.returncode == 2
    assert "huge5.yaml:3" in done.stderr
    assert "is not finite" in done.stderr


def test_an_unknown_unit_in_a_result_does_not_stop_a_comparison(
    forked: Forked, hostile: Path, tmp_path: Path
) -> None:
    sides = [str(hostile / "compare" / side) for side in ("r1", "r2")]
    done = forked.run("compare", *sides, "--out", tmp_path, folder=tmp_path)
    assert done.returncode in {0, 1, 2}
    assert "Traceback" not in done.stderr


def test_validate_runs_nothing(forked: Forked, hostile: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(hostile / "validate_exec", tmp_path / "it")
    for file in folder.iterdir():
        file.chmod(0o644)
    (folder / "target.yaml").write_text(
        "target: simulator\nmodel: model.yaml\ncontroller: controller.yaml\n"
    )
    (folder / "model.yaml").write_text("model: eha_knee\n")
    files = [str(folder / f"{name}.yaml") for name in ("controller", "suite", "target")]
    done = forked.run("validate", *files, "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not (folder / "executed").exists()
    assert "evil:C was not checked" in done.stderr
    assert json.loads(done.stdout)["files"][0]["not_checked"] == ["evil:C"]


def test_a_long_last_line_takes_no_memory(tmp_path: Path) -> None:
    """A million cells in a line that is not a row: as text, not as a list of cells."""
    path = tmp_path / "long.csv"
    rows = "".join(f"0.{k},2.5,3\n" for k in range(10, 60))
    path.write_text("t,p,n\n" + rows + 100_000 * "0.1,2.5,3," + "4\n")
    short = tmp_path / "short.csv"
    short.write_text("t,p,n\n" + rows)
    recordings.read(short, channels=TABLE)  # libraries are loaded before memory is counted
    tracemalloc.start()
    with pytest.raises(RecordingError, match="more cells than the header line"):
        recordings.read(path, channels=TABLE)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 * path.stat().st_size


def test_thousands_of_topics_are_not_gone_through_for_each_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mcap.writer import Writer

    path = tmp_path / "many.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        for number in range(300):
            channel = writer.register_channel(f"/t{number}", "cdr", schema)
            if number % 2:
                writer.add_message(channel, 0, b"\0\1\0\0" + bytes(8), 0)
        writer.finish()
    whole = info(path)
    assert [bool(topic.values) for topic in whole.topics] == [False, True] * 150
    assert not whole.notes
    monkeypatch.setattr("eha_bench.recordings.information._MOST_VISITS", 3000)
    part = info(path)
    assert sum(bool(topic.values) for topic in part.topics) == 10
    assert "the values of 140 of 300 topics were not read" in part.notes
    assert part.health == "good"


def test_a_parquet_file_of_nothing_takes_no_memory(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "nothing.parquet"
    part = pa.table({"time": pa.nulls(10_000_000, pa.float64())})
    with pq.ParquetWriter(path, part.schema, compression="zstd") as writer:
        for _ in range(3):
            writer.write_table(part, row_group_size=10_000_000)
    assert path.stat().st_size < 200_000
    table = {"sample_rate": "1 kHz", "channels": {"force": {"column": "time", "unit": "N"}}}
    with pytest.raises(RecordingError, match="240 MB of memory"):
        recordings.read(path, channels=table)


def test_a_few_bytes_of_parquet_become_no_gigabytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Texts and lists of which the file's dictionary holds one; many columns of one value."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = 1000
    time = pa.array(np.arange(rows) / 1000.0)
    text = pa.array(["x" * 1_000_000] * 2).dictionary_encode().dictionary
    texts = pa.DictionaryArray.from_arrays(pa.array([0] * rows, pa.int32()), text)
    offsets = pa.array(np.arange(rows + 1, dtype=np.int32) * 20_000)
    lists = pa.ListArray.from_arrays(offsets, pa.array(np.zeros(rows * 20_000)))
    table = pa.table({"time": time, "text": texts, "list": lists})
    path = tmp_path / "few.parquet"
    pq.write_table(table, path, compression="zstd", store_schema=False)
    assert path.stat().st_size < 20_000

    def force(column: str) -> Any:
        clock = {"column": "time", "unit": "s"}
        return {"time": clock, "channels": {"force": {"column": column, "unit": "N"}}}

    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("it was read")

    monkeypatch.setattr(pq.ParquetFile, "read", never)
    for column, said in (
        ("text", "does not hold numbers"),
        ("list[3]", "160 MB of memory"),
        ("list", "does not hold numbers"),
        ("list.x", "holds no such elements"),
        ("time[0]", "holds no such elements"),
    ):
        with pytest.raises(RecordingError, match=said):
            recordings.read(path, channels=force(column))
    monkeypatch.undo()
    assert [topic.name for topic in info(path).topics] == ["time", "text", "list"]
    constant = pa.array(np.ones(1_000_000))
    many = tmp_path / "many.parquet"
    pq.write_table(pa.table({f"c{k}": constant for k in range(40)}), many, compression="zstd")
    channels = {f"c{k}": {"column": f"c{k}", "unit": "N"} for k in range(40)}
    with pytest.raises(RecordingError, match="its columns would take"):
        recordings.read(many, channels={"sample_rate": "1 kHz", "channels": channels})
