"""HDF5, MAT v7.3, TDMS, ULog, MDF 4: written by their own libraries, read with their units."""

import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from asammdf import MDF, Signal, Source
from nptdms import ChannelObject, GroupObject, TdmsWriter

from eha_bench import recordings
from eha_bench.core.errors import InputError, RecordingError
from eha_bench.core.recording import Recording
from eha_bench.recordings import info

COUNT = 400
TIME = np.arange(COUNT) / 1000
SLOW = TIME[::10]
PRESSURE = 1.0 + np.sin(50 * TIME)
SPEED = 100 * np.cos(50 * TIME)
OIL = 300 + SLOW
MAP: dict[str, Any] = {
    "channels": {
        "pressure_a": {"column": "pressure_a", "unit": "bar"},
        "motor_speed": {"topic": "fast", "field": "motor_speed", "unit": "rpm"},
        "oil_temperature": {"topic": "slow", "field": "oil_temperature", "unit": "K"},
    }
}


def hdf5(path: Path) -> Path:
    with h5py.File(path, "w") as file:
        fast, slow = file.create_group("fast"), file.create_group("slow")
        fast["time"], slow["time"] = TIME, SLOW
        fast["pressure_a"], fast["motor_speed"] = PRESSURE, SPEED
        fast["pressure_a"].attrs["unit"] = "bar"
        fast["motor_speed"].attrs["unit"] = "rpm"
        slow["oil_temperature"] = OIL
        file.attrs["rig"] = "2"
    return path


def tdms(path: Path) -> Path:
    clock = {"wf_start_offset": 0.0, "wf_start_time": np.datetime64("2025-03-01T12:00:00")}
    fast, slow = {**clock, "wf_increment": 0.001}, {**clock, "wf_increment": 0.01}
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                GroupObject("fast"),
                ChannelObject("fast", "pressure_a", PRESSURE, {**fast, "unit_string": "bar"}),
                ChannelObject("fast", "motor_speed", SPEED, {**fast, "unit_string": "rpm"}),
                ChannelObject("slow", "oil_temperature", OIL, slow),
            ]
        )
    return path


def mdf(path: Path) -> Path:
    with MDF(version="4.10") as log:
        log.append(
            [
                Signal(PRESSURE, TIME, name="pressure_a", unit="bar"),
                Signal(SPEED, TIME, name="motor_speed", unit="rpm"),
            ],
            comment="fast",
        )
        log.append([Signal(OIL, SLOW, name="oil_temperature", unit="K")], comment="slow")
        log.save(path, overwrite=True)
    return path


def ulog(path: Path, *, dropout: bool = False) -> Path:
    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    for text in (
        b"fast:uint64_t timestamp;double pressure_a;double motor_speed;float[2] pair;",
        b"slow:uint64_t timestamp;double oil_temperature;",
    ):
        content += message("F", text)
    content += message("A", struct.pack("<BH", 0, 0) + b"fast")
    content += message("A", struct.pack("<BH", 0, 1) + b"slow")
    for k in range(COUNT):
        body = struct.pack("<HQddff", 0, k * 1000, PRESSURE[k], SPEED[k], k, -k)
        content += message("D", body)
        if k % 10 == 0:
            content += message("D", struct.pack("<HQd", 1, k * 1000, OIL[k // 10]))
        if dropout and k == 100:
            content += message("O", struct.pack("<H", 25))
    path.write_bytes(content)
    return path


MADE = {"a.h5": hdf5, "a.tdms": tdms, "a.mf4": mdf, "a.ulg": ulog}


@pytest.mark.parametrize("name", MADE)
def test_groups_with_rates_of_their_own(tmp_path: Path, name: str) -> None:
    clock = {"time": {"column": "time", "unit": "s"}} if name == "a.h5" else {}
    found = recordings.read(MADE[name](tmp_path / name), channels={**MAP, **clock})
    size = len(found)
    assert size == COUNT - 9  # the slow group ends nine samples earlier
    assert np.allclose(found.time, TIME[:size], atol=1e-9)
    assert np.array_equal(found["pressure_a"], PRESSURE[:size] * 1e5)
    assert np.allclose(found["motor_speed"], SPEED[:size] * 2 * np.pi / 60, rtol=1e-14)
    assert np.allclose(found["oil_temperature"], 300 + found.time, rtol=1e-12)
    assert any("interpolated linearly" in note for note in found.notes)


@pytest.mark.parametrize("name", ["a.h5", "a.tdms", "a.mf4"])
def test_names_and_units_are_taken_over(tmp_path: Path, name: str) -> None:
    found = recordings.read(MADE[name](tmp_path / name))
    assert found.units == {"pressure_a": "Pa", "motor_speed": "rad/s", "oil_temperature": "K"}
    assert np.array_equal(found["pressure_a"], PRESSURE[: len(found)] * 1e5)
    described = info(tmp_path / name)
    assert described.format == {"a.h5": "hdf5", "a.tdms": "tdms", "a.mf4": "mdf"}[name]
    units = {value.name: value.unit for topic in described.topics for value in topic.values}
    assert units["pressure_a"] == "bar"
    if name == "a.tdms":
        assert found.epoch_ns == 1_740_830_400_000_000_000


@pytest.mark.parametrize("compression", [0, 2])
def test_samples_beyond_the_count_of_an_mdf_are_said(tmp_path: Path, compression: int) -> None:
    path = tmp_path / "a.mf4"
    with MDF(version="4.10") as log:
        log.append([Signal(PRESSURE, TIME, name="pressure_a", unit="bar")])
        log.save(path, overwrite=True, compression=compression)
    whole = info(path)
    assert (whole.health, whole.notes) == ("good", ())
    content = bytearray(path.read_bytes())
    group = content.index(b"##CG")
    links = struct.unpack_from("<Q", content, group + 16)[0]
    place = group + 24 + 8 * links + 8
    assert struct.unpack_from("<Q", content, place)[0] == COUNT
    struct.pack_into("<Q", content, place, COUNT // 2)
    path.write_bytes(content)
    found = info(path)
    assert found.health == "damaged"
    assert f"declares {COUNT // 2} samples, its data hold {COUNT}" in found.notes[0]


def test_a_log_with_one_number_for_two_topics_is_refused(tmp_path: Path) -> None:
    path = ulog(tmp_path / "a.ulg")
    content = path.read_bytes()
    head = content.index(b"A" + struct.pack("<BH", 0, 0)) - 2
    length, _ = struct.unpack_from("<HB", content, head)
    again = struct.pack("<HB", 7, ord("A")) + struct.pack("<BH", 0, 0) + b"else"
    whole = head + 3 + length
    path.write_bytes(content[:whole] + again + content[whole:])
    with pytest.raises(RecordingError, match=r"topic 0 is declared twice, as '.*' and 'else'"):
        info(path)


def test_ulog_arrays_and_dropouts(tmp_path: Path) -> None:
    entry = {"topic": "fast", "field": "pair[1]", "unit": "A"}
    path = ulog(tmp_path / "a.ulg", dropout=True)
    found = recordings.read(path, channels={"channels": {"current": entry}})
    assert np.array_equal(found["current"], -np.arange(COUNT))
    assert any("lost messages 1 times, 25 ms" in note for note in found.notes)


def mat73(path: Path) -> Path:
    with h5py.File(path, "w", userblock_size=512) as file:

        def put(name: str, values: Any, kind: bytes = b"double") -> h5py.Dataset:
            made = file.create_dataset(name, data=values)
            made.attrs["MATLAB_class"] = np.bytes_(kind)
            return made

        put("t", TIME[None, :])
        put("log/p", PRESSURE[None, :])
        put("y", np.vstack([PRESSURE, SPEED]))  # MATLAB: COUNT rows, two columns
        put("title", np.frombuffer(b"rig", dtype=np.uint8).astype(np.uint16)[:, None], b"char")
        refs = [put(f"#refs#/{k}", (k + 1) * PRESSURE[None, :]).ref for k in range(2)]
        cells = file.create_dataset("c", data=np.array([refs], dtype=h5py.ref_dtype))
        cells.attrs["MATLAB_class"] = np.bytes_(b"cell")
        field = np.array([refs], dtype=h5py.ref_dtype)
        file.create_dataset("signals/values", data=field)
    content = bytearray(path.read_bytes())
    content[:512] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("column", "factor"),
    [("log.p", 1), ("y[0]", 1), ("c[1]", 2), ("signals[1].values", 2)],
)
def test_mat_73(tmp_path: Path, column: str, factor: int) -> None:
    mapping = {
        "time": {"column": "t"},
        "channels": {"pressure_a": {"column": column, "unit": "bar"}},
    }
    found = recordings.read(mat73(tmp_path / "a.mat"), channels=mapping)
    assert np.array_equal(found["pressure_a"], factor * PRESSURE * 1e5)
    assert info(tmp_path / "a.mat").format == "mat"


DBC = """VERSION ""
NS_ :
BS_:
BU_: D
BO_ 256 Drive: 8 D
 SG_ motor_speed : 0|16@1- (0.5,0) [-10000|10000] "rpm" D
BO_ 257 Block: 8 D
 SG_ PressA : 7|16@0+ (0.1,0) [0|6000] "bar" D
"""


def test_raw_can_frames_are_decoded_by_a_dbc(tmp_path: Path) -> None:
    frames = []
    for k in range(COUNT):
        frames.append((k / 1000, 256, struct.pack("<h6x", 4 * k)))
        if k % 5 == 0:
            frames.append((k / 1000 + 1e-4, 257, struct.pack(">H6x", 100 + k)))
    kind = np.dtype(
        [
            ("CAN_DataFrame.BusChannel", "u1"), ("CAN_DataFrame.ID", "<u4"),
            ("CAN_DataFrame.IDE", "u1"), ("CAN_DataFrame.DLC", "u1"),
            ("CAN_DataFrame.DataLength", "u1"), ("CAN_DataFrame.DataBytes", "u1", (8,)),
        ]
    )  # fmt: skip
    rows = np.zeros(len(frames), kind)
    rows["CAN_DataFrame.BusChannel"] = 1
    rows["CAN_DataFrame.DLC"] = rows["CAN_DataFrame.DataLength"] = 8
    rows["CAN_DataFrame.ID"] = [frame[1] for frame in frames]
    rows["CAN_DataFrame.DataBytes"] = [list(frame[2]) for frame in frames]
    bus = Source("CAN", "CAN", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    with MDF(version="4.10") as log:
        stamps = np.array([frame[0] for frame in frames])
        log.append(Signal(rows, stamps, name="CAN_DataFrame", source=bus))
        log.save(tmp_path / "can.mf4")
    (tmp_path / "rig.dbc").write_text(DBC)
    (tmp_path / "channels.yaml").write_text(
        "dbc: rig.dbc\nchannels:\n"
        "  motor_speed: {topic: Drive, field: motor_speed, unit: rpm}\n"
        "  pressure_a: {column: PressA, unit: bar}\n"
    )
    found = recordings.read(tmp_path / "can.mf4", channels=tmp_path / "channels.yaml")
    assert found["motor_speed"][0] == pytest.approx(2.0 * 1 * 2 * np.pi / 60)
    assert found["pressure_a"][:2] == pytest.approx([1e6 + 0.1e5 * 0.9, 1e6 + 0.1e5 * 1.9])
    (tmp_path / "channels.yaml").write_text(
        "dbc: other.dbc\nchannels:\n  pressure_a: {column: PressA, unit: bar}\n"
    )
    with pytest.raises(InputError, match=r"channels\.yaml:1, key 'dbc': there is no file"):
        recordings.read(tmp_path / "can.mf4", channels=tmp_path / "channels.yaml")


def test_invalid_samples_of_mdf_are_nan(tmp_path: Path) -> None:
    invalid = np.zeros(COUNT, dtype=bool)
    invalid[5:8] = True
    with MDF(version="4.10") as log:
        signal = Signal(PRESSURE, TIME, name="p", unit="bar", invalidation_bits=invalid)
        log.append(signal)
        log.save(tmp_path / "a.mf4")
    entry = {"pressure_a": {"column": "p", "unit": "bar"}}
    found = recordings.read(tmp_path / "a.mf4", channels={"channels": entry})
    assert np.array_equal(np.isnan(found["pressure_a"]), invalid)
    assert any("3 samples are marked as invalid" in note for note in found.notes)


def test_nothing_outside_of_an_hdf5_file_is_opened(tmp_path: Path) -> None:
    hdf5(tmp_path / "other.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = TIME
        file["p"] = PRESSURE
        file["linked"] = h5py.ExternalLink("other.h5", "/fast/pressure_a")
        layout = h5py.VirtualLayout((COUNT,), "f8")
        layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "fast/pressure_a", (COUNT,))
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("unwritten", (10**12,), "f8", chunks=(1000,))
    found = info(tmp_path / "a.h5")
    assert [topic.name for topic in found.topics] == ["p", "time"]
    said = " ".join(found.notes)
    assert "linked (a link)" in said
    assert "virtual (its data are in another file)" in said
    assert "unwritten (declared, but never written)" in said


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == "a.mf4" else ()) for name in MADE]
)
def test_a_cut_file_is_one_sentence_or_says_so(tmp_path: Path, name: str) -> None:
    content = MADE[name](tmp_path / name).read_bytes()
    path = tmp_path / f"cut-{name}"
    for share in (0.1, 0.5, 0.9, 0.99):
        path.write_bytes(content[: int(share * len(content))])
        try:
            found = info(path)
        except RecordingError:
            continue
        readable = all(not topic.readable for topic in found.topics)
        assert found.health == "damaged" or not readable or name == "a.ulg"


@pytest.fixture
def recording() -> Recording:
    generator = np.random.default_rng(5)
    return Recording(
        np.arange(COUNT) * 0.001,
        {
            "pressure_a": generator.normal(size=COUNT) * 1e5,
            "reference": np.ones(COUNT),
            "spool_position": generator.normal(size=COUNT) * 1e-3,
            "share": generator.random(COUNT),
        },
        {"reference": "Pa", "spool_position": "m", "share": ""},
        epoch_ns=1_760_000_000_123_456_789,
        metadata={"trial": "step"},
        notes=("a note",),
    )


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mf4"])
def test_what_is_exported_comes_back_bit_for_bit(
    tmp_path: Path, recording: Recording, suffix: str
) -> None:
    recordings.export(tmp_path / f"a{suffix}", recording)
    back = recordings.read(tmp_path / f"a{suffix}")
    assert np.array_equal(back.time, recording.time)
    for name in recording.values:
        assert np.array_equal(back[name], recording[name]), name
    assert back.unit("spool_position") == "m"
    if suffix != ".csv":
        assert back.epoch_ns == recording.epoch_ns
        assert back.metadata["trial"] == "step"
        assert back.unit("reference") == "Pa"
    assert [path.name for path in tmp_path.iterdir()] == [f"a{suffix}"]


def test_an_unknown_format_is_not_written(tmp_path: Path, recording: Recording) -> None:
    with pytest.raises(InputError, match=r"\.parquet"):
        recordings.export(tmp_path / "a.parqet", recording)
    with pytest.raises(RecordingError, match="cannot be written"):
        recordings.export(tmp_path / "no" / "a.csv", recording)


EIGHT = ("a.mcap", "a.csv", "a.parquet", "a.mf4", "a.h5", "a.mat", "a.json", "a.jsonl", "a.tdms")


def written(path: Path, recording: Recording) -> Path:
    """Write a recording as a user of the format would; times as they are."""
    columns = {"time": recording.time, **recording.values}
    match path.suffix:
        case ".mcap":
            recordings.write(path, recording)
        case ".csv" | ".parquet" | ".mf4":
            recordings.export(path, recording)
        case ".h5":
            with h5py.File(path, "w") as file:
                for name, values in columns.items():
                    file[name] = values
        case ".mat":
            from scipy.io import savemat

            savemat(path, columns)
        case ".json":
            import json

            path.write_text(json.dumps({name: list(v) for name, v in columns.items()}))
        case ".jsonl":
            import json

            rows = zip(*columns.values(), strict=True)
            lines = (json.dumps(dict(zip(columns, map(float, row), strict=True))) for row in rows)
            path.write_text("\n".join(lines))
        case ".tdms":
            with TdmsWriter(path) as writer:
                writer.write_segment([ChannelObject("run", n, v) for n, v in columns.items()])
    return path


@pytest.mark.parametrize("name", EIGHT[1:])
def test_one_run_in_every_lossless_format_scores_bit_identically(
    tmp_path: Path, repository: Path, name: str
) -> None:
    from eha_bench.metrics import score
    from eha_bench.suites import load_suite

    trial = load_suite(repository / "suites" / "smoke.yaml").trials[0]
    clock = np.arange(int(1000 * trial.duration)) * 0.001  # no nearest doubles of milliseconds
    generator = np.random.default_rng(2)
    values = {
        channel: generator.normal(size=clock.size)
        for channel in ("current_command", "current", "motor_speed", "pressure_a", "pressure_b")
    }
    made = Recording(clock, {**values, "reference": np.ones(clock.size)}, {"reference": "Pa"})
    ours = recordings.read(written(tmp_path / "a.mcap", made))
    other = recordings.read(written(tmp_path / name, made))
    assert other.time.tobytes() == ours.time.tobytes()
    for channel in ours.values:
        assert other[channel].tobytes() == ours[channel].tobytes(), channel
    plain = score(ours, trial)
    assert any(item.value is not None for item in plain)
    assert repr(score(other, trial)) == repr(plain)


def test_a_tdms_whose_counts_are_damaged_is_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "run.tdms"
    with TdmsWriter(path) as writer:
        force, clock = np.arange(50.0), np.arange(50) / 1000
        writer.write_segment(
            [ChannelObject("rig", "force", force), ChannelObject("rig", "t", clock)]
        )
    whole = path.read_bytes()
    count = (50).to_bytes(8, "little")
    assert whole.count(count) == 2
    path.write_bytes(whole.replace(count, (2**40).to_bytes(8, "little"), 1))
    found = info(path)
    assert str(found.health) != "good"
    assert any("its counts are damaged" in note for note in found.notes)


def test_a_reader_that_has_ended_gives_its_reason_again_and_again(tmp_path: Path) -> None:
    from eha_bench.recordings.opening import open_source
    from eha_bench.recordings.tables.apart import Hdf5Table

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = np.arange(10.0)
        file["p"] = np.arange(10.0)
    source = open_source(tmp_path / "a.h5")
    assert isinstance(source, Hdf5Table)
    assert not source.damaged
    source._process.kill()
    source._process.wait()
    for _ in range(3):
        with pytest.raises(RecordingError, match="the library that reads hdf5 files was stopped"):
            source.column("p")
    assert source.damaged
    assert len(source.notes) == 1
