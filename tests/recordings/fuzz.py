"""Damages recordings of every format and reads them: an error is one sentence, or it is a defect.

    python tests/recordings/fuzz.py --count 20000 [--seed 1] [--data FOLDER] [--structured]

With --structured not bytes but what is recorded is altered (structured.py), checksums put right.

What counts as a defect: an exception that is not eha-bench's own (a warning is one as well), a
message of several lines, more than ten seconds, or more memory than twice the sizes that the file
states, with 16 MiB for the libraries.
"""

from __future__ import annotations

import argparse
import random
import signal
import struct
import sys
import tempfile
import tracemalloc
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.errors import EhaBenchError
from eha_bench.recordings import info, read, recover, write
from eha_bench.recordings.budget import ReadingBudget, ReadingLimits
from eha_bench.recordings.mcap.file import MAGIC, Chunk, open_mcap

sys.path.insert(0, str(Path(__file__).parent))  # it is run as a script as well
from structured import BY_SUFFIX, alter

APART = frozenset({".h5", ".tdms", ".mf4", ".ulg"})
"""Read by a process of its own."""
SECONDS = 10
LIBRARIES = 16 << 20

Map = dict[str, Any]


@dataclass(frozen=True)
class Seed:
    """A sound recording to be damaged, and the map that reads it."""

    name: str
    content: bytes
    mapping: Map | None


def seeds(folder: Path) -> list[Seed]:
    """Small recordings of every format, made here."""
    made = [*_tables(folder), *_mcap(folder), *_bags(folder), *_others(folder)]
    for path, mapping in made:
        read(path, channels=mapping)  # libraries are loaded before memory is counted
    return [Seed(path.name, path.read_bytes(), mapping) for path, mapping in made]


def _tables(folder: Path) -> Iterator[tuple[Path, Map | None]]:
    import pandas as pd
    from scipy.io import savemat

    count = 50
    frame = pd.DataFrame(
        {"t": np.arange(count) / 100, "p": np.sin(np.arange(count)), "n": range(count)}
    )
    mapping = {
        "time": {"column": "t", "unit": "s"},
        "channels": {
            "pressure_a": {"column": "p", "unit": "bar"},
            "current": {"column": "n", "unit": "A"},
        },
    }
    frame.to_csv(folder / "a.csv", index=False)
    yield folder / "a.csv", mapping
    frame.to_csv(folder / "b.csv", index=False, sep=";", decimal=",")
    yield folder / "b.csv", mapping
    text = "Logger X\n\n" + frame.to_csv(index=False, sep=";").replace("\n", "\ns;bar;1\n", 1)
    (folder / "c.csv").write_text(text)
    yield folder / "c.csv", mapping
    dates = frame.assign(t=pd.to_datetime((frame["t"] * 1e9).astype("int64"), utc=True))
    dates.to_csv(folder / "d.csv", index=False)
    yield folder / "d.csv", mapping
    frame.to_parquet(folder / "a.parquet")
    yield folder / "a.parquet", mapping
    nested = dates.assign(p=[{"x": [float(k), 1.0]} for k in range(count)])
    nested.to_parquet(folder / "b.parquet")
    inside = {"pressure_a": {"column": "p.x[1]", "unit": "bar"}}
    yield folder / "b.parquet", {**mapping, "channels": inside}
    columns = {name: frame[name].to_numpy() for name in frame}
    savemat(folder / "plain.mat", columns)
    yield folder / "plain.mat", mapping
    cells = np.empty(2, dtype=object)
    cells[0], cells[1] = columns["p"], "text"
    savemat(folder / "cells.mat", {"t": columns["t"], "c": cells, "s": {"in": {"z": 1.0}}})
    first = {"pressure_a": {"column": "c[0]", "unit": "bar"}}
    yield folder / "cells.mat", {**mapping, "channels": first}
    savemat(folder / "packed.mat", {**columns, "s": {"a": 1.0}}, do_compression=True)
    yield folder / "packed.mat", mapping


def _mcap(folder: Path) -> Iterator[tuple[Path, Map | None]]:
    from mcap.writer import CompressionType, Writer
    from mcap_ros2.writer import Writer as Ros2Writer

    from eha_bench.core.recording import Recording

    clock = np.arange(300) / 1000
    own = Recording(
        clock,
        {"current": np.sin(clock), "pressure_a": clock},
        metadata={"trial": "x"},
        attachments={"suite.yaml": b"suite: s\n"},
    )
    yield write(folder / "own.mcap", own), None
    state = (
        "std_msgs/Header header\nstring[] name\nfloat64[] velocity\n" + "=" * 80
        + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + "=" * 80
        + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )  # fmt: skip
    for kind in CompressionType:
        path = folder / f"state-{kind.name}.mcap"
        with path.open("wb") as stream:
            writer = Ros2Writer(stream, chunk_size=2000, compression=kind)
            schema = writer.register_msgdef("sensor_msgs/msg/JointState", state)
            for k in range(60):
                names = ["a", "motor"] if k % 7 else ["motor"]
                message = {
                    "header": {"stamp": {"sec": k, "nanosec": 5}, "frame_id": "f" * (k % 3)},
                    "name": names,
                    "velocity": [float(k)] * len(names),
                }
                writer.write_message("/state", schema, message, k * 1000, k * 1000)
            writer.finish()
        field = {"topic": "/state", "field": "velocity[motor]", "unit": "rpm"}
        yield path, {"clock": "header", "channels": {"motor_speed": field}}
    yield _joints(folder)
    path = folder / "json.mcap"
    with path.open("wb") as stream:
        plain = Writer(stream, chunk_size=500)
        plain.start()
        schema = plain.register_schema("a", "jsonschema", b"{}")
        channel = plain.register_channel("/a", "json", schema)
        for k in range(40):
            plain.add_message(channel, k * 1000, b'{"a": {"b": [1, %d]}}' % k, k * 1000)
        plain.finish()
    yield path, {"channels": {"current": {"topic": "/a", "field": "a.b[1]", "unit": "A"}}}
    yield (
        _protobuf(folder),
        {"channels": {"current": {"topic": "/p", "field": "seconds", "unit": "A"}}},
    )


def _others(folder: Path) -> Iterator[tuple[Path, Map | None]]:
    """JSON in both forms, HDF5, TDMS, ULog and MDF."""
    import json

    import h5py
    from asammdf import MDF, Signal
    from nptdms import ChannelObject, TdmsWriter

    clock = np.arange(50) / 100
    values = {"p": np.sin(clock), "n": np.arange(50.0)}
    entries = {
        "pressure_a": {"column": "p", "unit": "bar"}, "current": {"column": "n", "unit": "A"}
    }  # fmt: skip
    timed = {"time": {"column": "t", "unit": "s"}, "channels": entries}
    rows = [
        {"t": t, "p": p, "s": {"n": [n, 1]}}
        for t, p, n in zip(clock, *values.values(), strict=True)
    ]
    inside = {**entries, "current": {"column": "s.n[0]", "unit": "A"}}
    (folder / "a.jsonl").write_text("\n".join(map(json.dumps, rows)))
    yield folder / "a.jsonl", {**timed, "channels": inside}
    (folder / "a.json").write_text(
        json.dumps({"m": 1, "t": clock.tolist(), **{k: v.tolist() for k, v in values.items()}})
    )
    yield folder / "a.json", timed
    with h5py.File(folder / "a.h5", "w") as file:
        file["t"] = clock
        for name, column in values.items():
            file[f"rig/{name}"] = column
            file[f"rig/{name}"].attrs["unit"] = "bar"
        file["rig/y"] = np.column_stack(list(values.values()))
    yield folder / "a.h5", timed
    with TdmsWriter(folder / "a.tdms") as writer:
        made = [
            ChannelObject("rig", name, column, {"unit_string": "bar"})
            for name, column in values.items()
        ]
        writer.write_segment([ChannelObject("rig", "t", clock), *made])
    yield folder / "a.tdms", timed
    with MDF(version="4.10") as log:
        log.append(
            [Signal(v, clock, name=name, unit="bar") for name, v in values.items()], comment="rig"
        )
        log.append(Signal(values["p"][::5], clock[::5], name="slow"), comment="slow")
        log.save(folder / "a.mf4", overwrite=True)
    yield folder / "a.mf4", {"channels": entries}
    content = b"ULog\x01\x12\x35\x01" + bytes(8)
    parts = [("B", bytes(40)), ("F", b"rig:uint64_t timestamp;double p;float[2] n;")]
    parts.append(("A", b"\0\0\0rig"))
    parts += [("D", struct.pack("<HQdff", 0, k * 1000, k / 7, k, 0)) for k in range(50)]
    content += b"".join(struct.pack("<HB", len(b), ord(kind)) + b for kind, b in parts)
    (folder / "a.ulg").write_bytes(content)
    first = {**entries, "current": {"topic": "rig", "field": "n[0]", "unit": "A"}}
    yield folder / "a.ulg", {"channels": first}


def _joints(folder: Path) -> tuple[Path, Map]:
    """Messages in messages, found by their names, with a wide string that nobody writes alike."""
    from mcap.writer import Writer

    definition = (
        "wstring w\nJoint[] joints\n" + "=" * 80 + "\nMSG: p/Joint\nstring name\nfloat32 speed\n"
    )
    path = folder / "joints.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=900)
        writer.start()
        schema = writer.register_schema("p/msg/T", "ros2msg", definition.encode())
        channel = writer.register_channel("/j", "cdr", schema)
        for k in range(50):
            wide = struct.pack("<I", k % 3) + b"ab" * (k % 3)
            body = wide + bytes(-len(wide) % 4) + struct.pack("<I", 2)
            for name in (b"a\0\0\0", b"motor\0\0\0"):
                body += struct.pack("<I", len(name)) + name + struct.pack("<f", k)
            writer.add_message(channel, k * 1000, b"\0\1\0\0" + body, k * 1000)
        writer.finish()
    field = {"topic": "/j", "field": "joints[motor].speed", "unit": "rpm"}
    return path, {"channels": {"motor_speed": field}}


def _protobuf(folder: Path) -> Path:
    from google.protobuf.timestamp_pb2 import Timestamp
    from mcap_protobuf.writer import Writer

    path = folder / "proto.mcap"
    with path.open("wb") as stream, Writer(stream) as writer:
        for k in range(40):
            writer.write_message("/p", Timestamp(seconds=k), k * 1000, k * 1000)
    return path


def _bags(folder: Path) -> Iterator[tuple[Path, Map | None]]:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    mapping = {"channels": {"current": {"topic": "/f", "field": "data", "unit": "A"}}}
    for compression in (None, Writer1.CompressionFormat.LZ4, Writer1.CompressionFormat.BZ2):
        path = folder / f"{compression.name if compression else 'plain'}.bag"
        store = get_typestore(Stores.ROS1_NOETIC)
        kind = store.types["std_msgs/msg/Float64"]
        bag = Writer1(path)
        if compression:
            bag.set_compression(compression)
        with bag:
            connection = bag.add_connection("/f", kind.__msgtype__, typestore=store)
            for k in range(60):
                raw = store.serialize_ros1(kind(float(k)), kind.__msgtype__)
                bag.write(connection, k * 1000, raw)
        yield path, mapping
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["std_msgs/msg/Float64"]
    with Writer2(folder / "two", version=9, storage_plugin=StoragePlugin.SQLITE3) as two:
        connection2 = two.add_connection("/f", kind.__msgtype__, typestore=store)
        for k in range(60):
            two.write(connection2, k * 1000, store.serialize_cdr(kind(float(k)), kind.__msgtype__))
    yield folder / "two" / "two.db3", mapping
    from rosbags.rosbag2 import CompressionFormat, CompressionMode

    for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
        bag2 = Writer2(folder / mode.name, version=9, storage_plugin=StoragePlugin.MCAP)
        bag2.set_compression(mode, CompressionFormat.ZSTD)
        with bag2:
            connection2 = bag2.add_connection("/f", kind.__msgtype__, typestore=store)
            for k in range(60):
                raw2 = store.serialize_cdr(kind(float(k)), kind.__msgtype__)
                bag2.write(connection2, k * 1000, raw2)
        yield next(f for f in (folder / mode.name).iterdir() if ".mcap" in f.name), mapping


def damage(content: bytes, choice: random.Random) -> bytes:
    """Return the content with one to eight things wrong with it."""
    data = bytearray(content)
    for _ in range(choice.choice((1, 1, 1, 2, 4, 8))):
        if not data:
            break
        # most of what decides stands at the beginning and at the end
        place = choice.choice(
            (
                choice.randrange(len(data)),
                choice.randrange(min(len(data), 400)),
                len(data) - 1 - choice.randrange(min(len(data), 400)),
            )
        )
        width = choice.choice((1, 2, 4, 8))
        match choice.randrange(8):
            case 0:
                data[place] ^= 1 << choice.randrange(8)
            case 1:
                data[place : place + width] = choice.randbytes(width)
            case 2:
                edge = choice.choice((0, 1, 2**7, 2**15, 2**31, 2**32 - 1, 2**60, 2**63, 2**64 - 1))
                data[place : place + width] = (edge % 2 ** (8 * width)).to_bytes(width, "little")
            case 3:
                del data[place:]
            case 4:
                del data[place : place + choice.randrange(1, 200)]
            case 5:
                data[place:place] = choice.randbytes(choice.randrange(1, 40))
            case 6:
                other = choice.randrange(len(data))
                data[place:place] = data[other : other + choice.randrange(1, 300)]
            case 7:
                data[place : place + 64] = bytes(64)
    return bytes(data)


class Hang(BaseException):
    """A recording took too long."""


@contextmanager
def limited() -> Iterator[None]:
    """Stop after some seconds of work; a busy machine is not a defect."""

    def stop(*_: object) -> None:
        raise Hang

    earlier = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, earlier)


def attempt(path: Path, mapping: Map | None) -> str:
    """Read, describe and recover a damaged file; return what became of it.

    Raises:
        AssertionError: a defect, with what it was.
    """
    outcome = "read"
    for name, act in (
        ("read", lambda: read(path, channels=mapping)),
        ("info", lambda: info(path)),
        ("recover", lambda: recover(path, path.with_suffix(".recovered"))),
    ):
        before = forget_peak()
        if not _sound(name, act):
            outcome = "refused" if name == "read" else outcome
        if peak_memory() - before < LIBRARIES:
            continue
        # looked at again, and closely: tracing what is allocated makes it three times as slow
        tracemalloc.start()
        try:
            _sound(name, act)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        if peak > LIBRARIES:
            stated = stated_size(path)
            assert peak < 2 * stated + LIBRARIES, f"{name} took {peak} bytes, {stated} are stated"
    return outcome


def _sound(name: str, act: Callable[[], object]) -> bool:
    """Do something with a damaged file; return whether it could be done.

    Raises:
        AssertionError: it ended otherwise than in one sentence, or not at all.
    """
    try:
        with limited():
            act()
    except EhaBenchError as error:
        text = str(error)
        if "\n" in text or len(text) > 3000:
            raise AssertionError(f"{name}: not one sentence: {text}") from error
        return False
    except Hang:
        raise AssertionError(f"{name} took more than {SECONDS} s") from None
    except Exception as error:
        raise AssertionError(f"{name}: {type(error).__name__}: {error}") from error
    return True


def forget_peak() -> int:
    """Let the system's peak of this process' memory begin again; return what it has, bytes."""
    Path("/proc/self/clear_refs").write_text("5")
    return peak_memory()


def peak_memory() -> int:
    """Return the most memory that this process has had since then, bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return 1024 * int(line.split()[1])
    raise OSError("the system does not say how much memory a process had")


def stated_size(path: Path) -> int:
    """Return the bytes that a file has and says to have inside its chunks."""
    total = path.stat().st_size
    if path.read_bytes()[:8] == MAGIC:
        allowed = ReadingBudget("", total, ReadingLimits()).memory
        chunks = [part for part in open_mcap(path).parts if isinstance(part, Chunk)]
        total += sum(c.uncompressed_size for c in chunks if c.uncompressed_size <= allowed)
    return total


def run(
    count: int, seed: int, folder: Path, more: list[Path], *, structured: bool = False
) -> tuple[Counter[str], list[str]]:
    """Damage and read `count` recordings; return outcomes and defects."""
    material = seeds(folder)
    if structured:
        material = [seed for seed in material if Path(seed.name).suffix in BY_SUFFIX]
    for path in more:
        content = path.read_bytes()
        if len(content) < 2_000_000:
            material.append(Seed(path.name, content, _any_map(path)))
    outcomes: Counter[str] = Counter()
    defects = []
    for number in range(count):
        choice = random.Random(seed * 1_000_003 + number)
        chosen = choice.choices(material, [_weight(seed) for seed in material])[0]
        path = folder / f"case-{chosen.name}"
        changed = (
            alter(chosen.name, chosen.content, choice)
            if structured
            else damage(chosen.content, choice)
        )
        path.write_bytes(changed)
        try:
            outcomes[attempt(path, chosen.mapping)] += 1
        except AssertionError as error:
            outcomes["defect"] += 1
            defects.append(f"seed {seed} number {number} {chosen.name}: {error}")
            print(defects[-1], file=sys.stderr)
            kept = folder / f"defect-{seed}-{number}-{chosen.name}"
            path.rename(kept)
        if number % 500 == 499:
            print(f"{number + 1}: {dict(outcomes)}", file=sys.stderr)
    return outcomes, defects


def _weight(seed: Seed) -> float:
    """What a process of its own reads takes a hundred times as long, and comes less often."""
    return 0.05 if Path(seed.name).suffix in APART else 1.0


def _any_map(path: Path) -> Map | None:
    """A map for the first topics of somebody's log: any field that is a number will do."""
    if "rig_samples" in str(path):
        field = {"topic": "/drive/state", "field": "velocity[0]", "unit": "rpm"}
        return {"channels": {"motor_speed": field}}
    if path.suffix == ".bag":
        return {"channels": {"force": {"topic": "/turtle1/pose", "field": "x", "unit": "N"}}}
    if "cdr_test" in path.name:
        field = {"topic": "/array_topic", "field": "float64_values[1]", "unit": "N"}
        return {"channels": {"force": field}}
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=Path, help="a folder with more recordings to damage")
    warnings.simplefilter("error")
    parser.add_argument("--keep", type=Path, help="where to keep what showed a defect")
    parser.add_argument("--structured", action="store_true", help="alter what is recorded")
    given = parser.parse_args()
    more = sorted(given.data.rglob("*")) if given.data else []
    kinds = {".mcap", ".bag", ".db3", ".mat", ".csv", ".parquet"}
    with tempfile.TemporaryDirectory() as name:
        folder = given.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        files = [path for path in more if path.suffix in kinds]
        outcomes, defects = run(given.count, given.seed, folder, files, structured=given.structured)
    print(dict(outcomes))
    print("\n".join(defects))
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
