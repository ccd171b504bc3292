"""Reading and writing recordings beside the peers: ratios against plain (de)compression.

    python -m benchmarks.recordings [--ticks 600000] [--json FILE] [--no-peers] [--seconds 10]

Every ratio is the best of several rounds, the two sides taking turns, so that a busy machine slows
both. `wall` is what a user waits for, `cpu` what the machine does: two threads decompress. The wide
log of 600,000 ticks is ten minutes at 1 kHz with twelve channels, which `ten_minutes` makes for
other benchmarks as well.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import zstandard

from eha_bench.core.recording import Recording
from eha_bench.recordings import LiveWriter, read, write
from eha_bench.recordings.mcap.demux import MESSAGE, MESSAGE_HEAD
from eha_bench.recordings.mcap.file import Chunk, open_mcap
from eha_bench.recordings.mcap.sink import McapSink

EPOCH = 1_760_000_000_000_000_000
CHANNELS = 12
CHUNK = 1 << 20


@dataclass(frozen=True)
class Line:
    """One line of the table; `better` is `<` or `>`, with NaN as target where there is none."""

    name: str
    value: float
    better: str
    target: float
    note: str = ""

    @property
    def verdict(self) -> str:
        if np.isnan(self.target):
            return ""
        met = self.value <= self.target if self.better == "<" else self.value >= self.target
        return "met" if met else "missed"


def signals(ticks: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Smooth signals with noise, quantised like a rig's."""
    generator = np.random.default_rng(0)
    clock = np.arange(ticks) / 1000.0
    return clock, {
        f"c{k}": np.round(1000 * np.sin(0.6 * (k + 1) * clock) + generator.normal(size=ticks), 3)
        for k in range(CHANNELS)
    }


def ten_minutes(ticks: int = 600_000) -> Recording:
    """Ten minutes at 1 kHz with twelve channels, the same numbers each time."""
    clock, values = signals(ticks)
    return Recording(clock, values, dict.fromkeys(values, ""), epoch_ns=EPOCH)


def by_rosbags(path: Path) -> int:
    """Read and deserialize every message as a user of rosbags does; return how many there are."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    count = 0
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            count += 1
    return count


def by_mcap_ros2(path: Path) -> int:
    """Decode every message as a user of mcap-ros2-support does; return how many there are."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return sum(1 for _ in reader.iter_decoded_messages())


def write_twelve(path: Path, clock: np.ndarray, values: dict[str, np.ndarray]) -> None:
    """A topic a channel, header and float64 each, all at the same stamps."""
    definition = (
        "std_msgs/Header header\nfloat64 value\n" + "=" * 80 + "\nMSG: std_msgs/Header\n"
        "builtin_interfaces/Time stamp\nstring frame_id\n" + "=" * 80 + "\n"
        "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    record = np.dtype(
        [
            ("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
            ("log", "<u8"), ("publish", "<u8"), ("cdr", "<u4"), ("sec", "<i4"),
            ("nanosec", "<u4"), ("frame", "<u4"), ("padding", "<u4"), ("value", "<f8"),
        ]
    )  # fmt: skip
    with path.open("wb") as stream:
        sink = McapSink(stream)
        schema = sink.schema("rig_msgs/msg/Stamped", "ros2msg", definition.encode())
        ids = [sink.channel(f"/rig/{name}", "cdr", schema) for name in values]
        stamps = (EPOCH + np.rint(clock * 1e9).astype(np.int64)).astype(np.uint64)
        rows = CHUNK // (record.itemsize * len(ids))
        for start in range(0, clock.size, rows):
            part = stamps[start : start + rows]
            records = np.zeros((part.size, len(ids)), dtype=record)
            records["opcode"] = MESSAGE
            records["length"] = record.itemsize - 9
            records["cdr"], records["frame"] = 0x0100, 1
            records["channel"] = ids
            for name in ("log", "publish"):
                records[name] = part[:, None]
            records["sec"] = (part // 10**9)[:, None]
            records["nanosec"] = (part % 10**9)[:, None]
            for column, array in enumerate(values.values()):
                records["value"][:, column] = array[start : start + rows]
            places = np.arange(records.size, dtype=np.uint64) * np.uint64(record.itemsize)
            index = {
                number: (part, places[column :: len(ids)]) for column, number in enumerate(ids)
            }
            sink.chunk(records.view(np.uint8).reshape(-1), index)
        sink.finish()
    assert record.itemsize == 9 + MESSAGE_HEAD + 28


def decompress_only(path: Path) -> int:
    """What every reader has to do at least."""
    file = open_mcap(path)
    decompressor = zstandard.ZstdDecompressor()
    total = 0
    for part in file.parts:
        assert isinstance(part, Chunk)
        content = file.buffer.data[part.data_start : part.data_start + part.data_size]
        total += len(decompressor.decompress(content))
    return total


def compress_only(raw: list[bytes], path: Path) -> None:
    """What every writer has to do at least."""
    compressor = zstandard.ZstdCompressor(level=3)
    with path.open("wb") as stream:
        for part in raw:
            stream.write(compressor.compress(part))


def best(first: Callable[[], object], second: Callable[[], object], rounds: int) -> list[float]:
    """Return [wall of first, wall of second, cpu of first, cpu of second], the best of each."""
    found = [float("inf")] * 4
    for _ in range(rounds):
        for index, act in enumerate((first, second)):
            wall, cpu = time.perf_counter(), time.process_time()
            act()
            found[index] = min(found[index], time.perf_counter() - wall)
            found[index + 2] = min(found[index + 2], time.process_time() - cpu)
    return found


def reading(name: str, path: Path, target: float, rounds: int, channels: object) -> list[Line]:
    base, ours, base_cpu, ours_cpu = best(
        lambda: decompress_only(path),
        lambda: read(path, channels=channels),
        rounds,
    )
    return [
        Line(f"read {name} / decompress, wall", ours / base, "<", target, f"{ours * 1e3:.0f} ms"),
        Line(f"read {name} / decompress, cpu", ours_cpu / base_cpu, "<", float("nan")),
    ]


def memory(name: str, path: Path, channels: object) -> Line:
    read(path, channels=channels)
    tracemalloc.start()
    recording = read(path, channels=channels)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    arrays = recording.time.nbytes + sum(array.nbytes for array in recording.values.values())
    largest = max(p.uncompressed_size for p in open_mcap(path).parts if isinstance(p, Chunk))
    return Line(
        f"read {name}: memory beyond its arrays, in chunks", (peak - arrays) / largest, "<", 2
    )


def peers(path: Path, short: Path, ticks: int, short_ticks: int, rounds: int) -> list[Line]:
    lines = []
    for name, act, target in (("rosbags", by_rosbags, 40), ("mcap-ros2", by_mcap_ros2, 100)):
        theirs, ours, *_ = best(lambda act=act: act(short), lambda: read(path), rounds)
        ratio = (theirs / short_ticks) / (ours / ticks)
        lines.append(
            Line(f"{name} / ours, per message", ratio, ">", target, f"{theirs * 1e3:.0f} ms")
        )
    return lines


def writing(recording: Recording, folder: Path, rounds: int) -> list[Line]:
    path = write(folder / "block.mcap", recording)
    file = open_mcap(path)
    decompressor = zstandard.ZstdDecompressor()
    raw = [
        decompressor.decompress(file.buffer.data[p.data_start : p.data_start + p.data_size])
        for p in file.parts
        if isinstance(p, Chunk)
    ]
    base, ours, base_cpu, ours_cpu = best(
        lambda: compress_only(raw, folder / "raw.zst"),
        lambda: write(folder / "block.mcap", recording),
        rounds,
    )
    return [
        Line("write / compress and write, wall", ours / base, "<", 1.2, f"{ours * 1e3:.0f} ms"),
        Line("write / compress and write, cpu", ours_cpu / base_cpu, "<", float("nan")),
    ]


def live(folder: Path, seconds: float) -> list[Line]:
    """Call latency at 1 kHz; the machine's own jitter is in it."""
    names = {f"c{k}": "" for k in range(CHANNELS)}
    generator = np.random.default_rng(0)
    values = [list(row) for row in generator.normal(size=(1000, CHANNELS))]
    calls = []
    with LiveWriter(folder / "live.mcap", names, epoch_ns=EPOCH) as writer:
        start = time.perf_counter()
        for tick in range(int(seconds * 1000)):
            while time.perf_counter() < start + tick / 1000:
                time.sleep(0.0002)
            begun = time.perf_counter()
            writer.append(tick / 1000, values[tick % 1000])
            calls.append(time.perf_counter() - begun)
    return [
        Line("live writer, call at 1 kHz: median, µs", statistics.median(calls) * 1e6, "<", np.nan),
        Line(
            "live writer, call at 1 kHz: p99.9, µs",
            float(np.quantile(calls, 0.999)) * 1e6,
            "<",
            500,
        ),
        Line("live writer, call at 1 kHz: longest, µs", max(calls) * 1e6, "<", np.nan),
    ]


WRITER = """
import sys, time
from eha_bench.recordings import LiveWriter
with LiveWriter(sys.argv[1], {f"c{k}": "" for k in range(12)}, epoch_ns=0) as writer:
    begin, tick = time.monotonic(), 0
    print(begin, flush=True)
    while True:
        while tick <= (time.monotonic() - begin) * 1000:
            writer.append(tick / 1000, [time.monotonic()] * 12)
            tick += 1
        time.sleep(0.0005)
"""


def at_risk(folder: Path, kills: int) -> Line:
    """What a kill -9 takes: the time between the last sample that can be read and the kill."""
    generator = np.random.default_rng(1)
    lost = []
    for number in range(kills):
        path = folder / f"killed-{number}.mcap"
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(generator.uniform(0.4, 1.0))
            moment = time.monotonic()
            process.kill()
        lost.append(moment - float(read(path)["c0"][-1]))
    return Line(
        f"live writer: s of data lost by kill -9, worst of {kills}", max(lost), "<", 0.25,
        f"median {statistics.median(lost):.3f} s",
    )  # fmt: skip


def run(ticks: int, rounds: int, *, with_peers: bool, seconds: float) -> list[Line]:
    """Run all and return the table."""
    lines: list[Line] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = ten_minutes(ticks)
        clock, values = recording.time, dict(recording.values)
        wide = write(folder / "wide.mcap", recording)
        lines += reading("wide log", wide, 1.5, rounds, None)
        lines.append(memory("wide log", wide, None))
        if with_peers:
            count = max(ticks // 20, 1000)
            short = write(folder / "short.mcap", recording.between(0, count / 1000))
            lines += peers(wide, short, ticks, count, rounds)
        lines += writing(recording, folder, rounds)
        twelve = folder / "twelve.mcap"
        write_twelve(twelve, clock, values)
        channels = {
            "channels": {k: {"topic": f"/rig/{k}", "field": "value", "unit": ""} for k in values}
        }
        lines += reading("twelve-topic log", twelve, 2.5, rounds, channels)
        lines.append(memory("twelve-topic log", twelve, channels))
        if seconds:
            lines += live(folder, seconds)
            lines.append(at_risk(folder, max(int(seconds), 1)))
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=600_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the live run")
    parser.add_argument("--json", type=Path, help="also write the table here")
    parser.add_argument("--no-peers", action="store_true")
    given = parser.parse_args()
    lines = run(given.ticks, given.rounds, with_peers=not given.no_peers, seconds=given.seconds)
    width = max(len(line.name) for line in lines)
    for line in lines:
        target = "" if np.isnan(line.target) else f"{line.better}= {line.target:g}"
        text = f"{line.name:{width}}  {line.value:9.2f}  {target:8} {line.verdict:6} {line.note}"
        print(text.rstrip(), file=sys.stdout)
    if given.json:
        content = [asdict(line) | {"verdict": line.verdict} for line in lines]
        for entry in content:
            entry["target"] = None if np.isnan(entry["target"]) else entry["target"]
        given.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
