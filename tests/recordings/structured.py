"""Changes what recordings say, not their bytes: decoded, altered, and written with right checksums.

Bytes that are flipped die at the first checksum. Here the values inside are altered and everything
around them is put right again, so that what stands behind the checksums is tried as well.
"""

from __future__ import annotations

import bz2
import io
import json
import math
import random
import sqlite3
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, Footer, McapRecord, Statistics
from mcap.stream_reader import StreamReader

EDGES = (
    0,
    1,
    2,
    255,
    2**15,
    2**16,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**53,
    2**63 - 1,
    2**63,
    2**64 - 1,
)
WORDS = (
    "", " ", "time", "reference", "pressure_a", "\0", "\n", "\x1b[2J", "../../x", "é" * 50,
    "a" * 5000,
    "m", "bar", "l", "m/s", "**", "1e999", "nan", "std_msgs/msg/Header", "float64[] x", "=" * 80,
    "int8 a", "string s", "T t", "wstring w", "float64[4294967295] x", "eha_bench.format",
)  # fmt: skip


def edge(choice: random.Random, bits: int) -> int:
    return choice.choice((*EDGES, choice.getrandbits(bits))) % (1 << bits)


def word(choice: random.Random, old: str) -> str:
    if old and choice.random() < 0.5:
        place = choice.randrange(len(old))
        return old[:place] + choice.choice(WORDS)[:40] + old[place + choice.randrange(3) :]
    return choice.choice(WORDS)


def altered_bytes(choice: random.Random, data: bytes) -> bytes:
    raw = bytearray(data)
    for _ in range(choice.choice((1, 1, 3))):
        if not raw:
            break
        place = choice.randrange(len(raw))
        match choice.randrange(4):
            case 0:
                width = choice.choice((1, 2, 4, 8))
                raw[place : place + width] = edge(choice, 8 * width).to_bytes(width, "little")
            case 1:
                del raw[place : place + choice.randrange(1, 40)]
            case 2:
                raw[place:place] = bytes(choice.randrange(1, 40))
            case 3:
                raw[place] ^= 1 << choice.randrange(8)
    return bytes(raw)


# --- MCAP --------------------------------------------------------------------


def mcap(content: bytes, choice: random.Random) -> bytes:
    """Alter records of an MCAP, also inside its chunks; all checksums are right."""
    stream = StreamReader(io.BytesIO(content), emit_chunks=True, record_size_limit=None)
    records = list(stream.records)
    for _ in range(choice.choice((1, 1, 2, 4))):
        place = choice.randrange(len(records))
        match choice.randrange(5):
            case 0:
                del records[place]
            case 1:
                records.insert(choice.randrange(len(records)), records[place])
            case 2 if len(records) > 1:
                other = choice.randrange(len(records))
                records[place], records[other] = records[other], records[place]
            case _:
                records[place] = _altered(records[place], choice)
        if not records:
            break
    return _joined(records, keep_statistics=choice.random() < 0.5)


def _altered(record: McapRecord, choice: random.Random) -> McapRecord:
    if isinstance(record, Chunk) and choice.random() < 0.8:
        return _rechunked(record, choice)
    names = [name for name in vars(record) if not name.startswith("_")]
    if not names:
        return record
    name = choice.choice(names)
    value = getattr(record, name)
    match value:
        case bool():
            pass
        case int():
            setattr(
                record, name, edge(choice, 16 if name in ("id", "channel_id", "schema_id") else 32)
            )
        case str():
            setattr(record, name, word(choice, value))
        case bytes():
            setattr(record, name, altered_bytes(choice, value))
        case dict() if value:
            key = choice.choice(list(value))
            if isinstance(value[key], str):
                setattr(
                    record,
                    name,
                    {**value, choice.choice((key, word(choice, key))): word(choice, value[key])},
                )
            else:
                setattr(record, name, {**value, key: edge(choice, 32)})
        case _:
            pass
    return record


def _rechunked(chunk: Chunk, choice: random.Random) -> Chunk:
    raw = bytearray(_unpacked(chunk))
    # one record inside: its length, its head, or what it holds
    places, position = [], 0
    while position + 9 <= len(raw):
        places.append(position)
        position += 9 + struct.unpack_from("<Q", raw, position + 1)[0]
    for _ in range(choice.choice((1, 2, 5))):
        if not places:
            break
        at = choice.choice(places)
        match choice.randrange(4):
            case 0:
                raw[at] = choice.choice((0, 1, 3, 4, 5, 6, 9, 15, 255))
            case 1:
                raw[at + 1 : at + 9] = edge(choice, 64).to_bytes(8, "little")
            case 2:
                raw[at + 9 : at + 31] = altered_bytes(choice, bytes(raw[at + 9 : at + 31]))[
                    :22
                ].ljust(22, b"\0")
            case 3:
                stop = min(at + 9 + 200, len(raw))
                raw[at + 31 : stop] = altered_bytes(choice, bytes(raw[at + 31 : stop]))
    data = bytes(raw)
    chunk.data = _packed(chunk.compression, data)
    chunk.uncompressed_size = len(data)
    chunk.uncompressed_crc = choice.choice((zlib.crc32(data), 0))
    return chunk


def _unpacked(chunk: Chunk) -> bytes:
    if chunk.compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data)
    return lz4.frame.decompress(chunk.data) if chunk.compression == "lz4" else chunk.data


def _packed(compression: str, data: bytes) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=1).compress(data)
    return lz4.frame.compress(data) if compression == "lz4" else data


def _joined(records: list[McapRecord], *, keep_statistics: bool) -> bytes:
    magic = b"\x89MCAP0\r\n"
    out = bytearray(magic)
    summary: int | None = None
    for record in records:
        if isinstance(record, Statistics) and not keep_statistics:
            continue
        if isinstance(record, DataEnd):
            record.data_section_crc = zlib.crc32(out)
        if isinstance(record, Footer):
            start = summary or 0
            head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
            crc = zlib.crc32(bytes(out[start or len(out) :]) + head)
            record.summary_start, record.summary_offset_start, record.summary_crc = start, 0, crc
        builder = RecordBuilder()
        try:
            record.write(builder)
        except (struct.error, OverflowError, UnicodeEncodeError):
            continue  # it cannot even be written
        out += builder.end()
        if isinstance(record, DataEnd):
            summary = len(out)
    return bytes(out + magic)


# --- ROS 1 -------------------------------------------------------------------


def bag(content: bytes, choice: random.Random) -> bytes:
    """Alter fields and lengths of a bag's records, also inside its chunks."""
    head = content[:13]
    records = _bag_records(content[13:])
    for _ in range(choice.choice((1, 1, 2, 4))):
        if not records:
            break
        place = choice.randrange(len(records))
        fields, data = records[place]
        match choice.randrange(5):
            case 0:
                del records[place]
            case 1:
                records.insert(choice.randrange(len(records)), (dict(fields), data))
            case 2 if fields.get(b"op") == b"\x05":
                kind = fields.get(b"compression", b"none")
                try:
                    unpack = {b"bz2": bz2.decompress, b"lz4": lz4.frame.decompress}
                    inner = _bag_records(unpack.get(kind, bytes)(data))
                except (ValueError, OSError, RuntimeError, EOFError, struct.error):
                    continue  # an earlier alteration has spoilt it
                if inner:
                    where = choice.randrange(len(inner))
                    inner[where] = _altered_bag_record(*inner[where], choice)
                again = _bag_bytes(inner)
                data = {b"bz2": bz2.compress, b"lz4": lz4.frame.compress}.get(kind, bytes)(again)
                fields = {**fields, b"size": struct.pack("<I", len(again))}
                records[place] = fields, data
            case _:
                records[place] = _altered_bag_record(fields, data, choice)
    return head + _bag_bytes(records)


def _altered_bag_record(
    fields: dict[bytes, bytes], data: bytes, choice: random.Random
) -> tuple[dict[bytes, bytes], bytes]:
    if choice.random() < 0.4:
        return fields, altered_bytes(choice, data)
    key = choice.choice(list(fields))
    return {**fields, key: altered_bytes(choice, fields[key])}, data


def _bag_records(raw: bytes) -> list[tuple[dict[bytes, bytes], bytes]]:
    records, position = [], 0
    while position + 4 <= len(raw):
        (size,) = struct.unpack_from("<I", raw, position)
        fields, at, stop = {}, position + 4, position + 4 + size
        while at < stop:
            (length,) = struct.unpack_from("<I", raw, at)
            name, _, value = raw[at + 4 : at + 4 + length].partition(b"=")
            fields[name] = value
            at += 4 + length
        (size,) = struct.unpack_from("<I", raw, stop)
        records.append((fields, raw[stop + 4 : stop + 4 + size]))
        position = stop + 4 + size
    return records


def _bag_bytes(records: list[tuple[dict[bytes, bytes], bytes]]) -> bytes:
    out = bytearray()
    for fields, data in records:
        head = b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in fields.items()
        )
        out += struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data
    return bytes(out)


# --- tables and others -------------------------------------------------------


def sqlite(content: bytes, choice: random.Random) -> bytes:
    """Alter cells, tables and their definitions of a database."""
    base = sqlite3.connect(":memory:")
    base.deserialize(content)
    values = (
        None,
        -1,
        2**62,
        1e300,
        float("inf"),
        "x",
        b"",
        bytes(choice.randrange(200)),
        "é" * 99,
    )
    for _ in range(choice.choice((1, 2, 4))):
        table, columns = choice.choice(
            (
                ("topics", ("id", "name", "type", "serialization_format")),
                ("messages", ("id", "topic_id", "timestamp", "data")),
            )
        )
        rows = choice.choice(("1=1", "rowid % 7 = 3", "rowid = 1"))
        statements = (
            f"UPDATE {table} SET {choice.choice(columns)} = ? WHERE {rows}",
            f"DELETE FROM {table} WHERE {rows}",
            f"ALTER TABLE {table} RENAME TO x{choice.randrange(9)}",
            f"CREATE VIEW v{choice.randrange(9)} AS SELECT * FROM {table}",
            f"ALTER TABLE {table} ADD COLUMN c{choice.randrange(99)}",
            f"ALTER TABLE {table} RENAME COLUMN {choice.choice(columns)} TO y",
        )
        statement = choice.choice((statements[0], *statements))
        try:
            base.execute(statement, (choice.choice(values),) if "?" in statement else ())
        except sqlite3.Error:
            continue
    base.commit()
    made = base.serialize()
    base.close()
    return made


def parsed_json(content: bytes, choice: random.Random) -> bytes:
    """Alter values, keys and shapes of JSON or JSON lines."""
    text = content.decode()
    lines = text.count("\n") > 3 and text.lstrip().startswith("{")
    documents = [json.loads(line) for line in text.splitlines()] if lines else [json.loads(text)]
    for _ in range(choice.choice((1, 2, 4))):
        place = choice.randrange(len(documents))
        documents[place] = _altered_json(documents[place], choice, 0)
    return "\n".join(map(json.dumps, documents)).encode()


def _altered_json(value: Any, choice: random.Random, depth: int) -> Any:
    if isinstance(value, dict) and value and choice.random() < 0.9:
        key = choice.choice(list(value))
        if choice.random() < 0.2:
            value[word(choice, key)] = value.pop(key)
        else:
            value[key] = _altered_json(value[key], choice, depth + 1)
        return value
    if isinstance(value, list) and value and choice.random() < 0.9:
        place = choice.randrange(len(value))
        if choice.random() < 0.1:
            del value[place]
        else:
            value[place] = _altered_json(value[place], choice, depth + 1)
        return value
    return choice.choice(
        (None, True, -1, 10**400, 1e308, math.inf, math.nan, "", word(choice, "t"), [], {}, [[]],
         [1, "a"], {"a": {"b": [1]}}, [[1, 2], [3]], ["a", "b"])
    )  # fmt: skip


def csv(content: bytes, choice: random.Random) -> bytes:
    """Alter cells, names and shapes of a table in text."""
    delimiter = max(",;\t", key=content.decode().count)
    rows = [line.split(delimiter) for line in content.decode().splitlines()]
    cells = (
        "", "-", "nan", "inf", "1e999", "9" * 400, "1,5", '"', '"a', "#N/A", "12:00:61",
        "2025-03-01T12:00", "x", "\0", "é", "1_000", "0x10", "True", "1e", "p", "time", "[",
        "pressure_a [bar]", "= 1 + 1",
    )  # fmt: skip
    for _ in range(choice.choice((1, 2, 5))):
        row = choice.choice((0, choice.randrange(len(rows)), len(rows) - 1))
        match choice.randrange(5):
            case 0:
                rows.insert(row, list(rows[row]))
            case 1:
                rows[row] = rows[row] * (choice.choice((0, 2, 300)) if len(rows[row]) < 1000 else 1)
            case 2:
                column = choice.randrange(8)
                fill = choice.choice(cells)
                rows = [[*r[:column], fill, *r[column + 1 :]] for r in rows]
            case _:
                place = choice.randrange(max(len(rows[row]), 1))
                rows[row][place : place + 1] = [choice.choice(cells)]
    return "\n".join(delimiter.join(row) for row in rows).encode()


def parquet(content: bytes, choice: random.Random) -> bytes:
    """Alter types and names of a Parquet file's columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(content))
    count = table.num_rows
    columns = (
        pa.array([None] * count), pa.array(["x"] * count), pa.array([b"\xff"] * count),
        pa.array([[1.0, 2.0]] * count), pa.array([[]] * count, pa.list_(pa.float64())),
        pa.array([{"x": 1}] * count),
        pa.array([[("k", 1.0)]] * count, pa.map_(pa.string(), pa.float64())),
        pa.array([10**30] * count, pa.decimal256(40)), pa.array([1] * count, pa.time32("s")),
        pa.array([2**62] * count, pa.timestamp("us")), pa.array([1] * count, pa.duration("s")),
        pa.array(["a", "b"] * (count // 2) + ["a"] * (count % 2)).dictionary_encode(),
        pa.array([math.nan, math.inf] * (count // 2) + [0.0] * (count % 2)),
        pa.array([2**64 - 1] * count, pa.uint64()), pa.array([True] * count),
    )  # fmt: skip
    names = table.schema.names
    for _ in range(choice.choice((1, 2))):
        place = choice.randrange(len(names))
        name = choice.choice((names[place], word(choice, names[place]).replace("\0", "")))
        table = table.set_column(place, name, choice.choice(columns))
    if choice.random() < 0.3:
        described = choice.choice(
            (b"{", b"[]", b'{"epoch_ns": 1e999, "units": 3}', b'{"epoch_ns": "x"}')
        )
        table = table.replace_schema_metadata({b"eha_bench": described})
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()


def mat5(content: bytes, choice: random.Random) -> bytes:
    """Alter tags, shapes and numbers of a MAT file's arrays, also of compressed ones."""
    head, rest, out = content[:128], content[128:], bytearray(content[:128])
    position = 0
    while position + 8 <= len(rest):
        kind, size = struct.unpack_from("<II", rest, position)
        body = rest[position + 8 : position + 8 + size]
        if kind == 15:
            raw = zlib.decompress(body)
            if choice.random() < 0.5:
                raw = raw[:8] + altered_bytes(choice, raw[8:120]) + raw[120:]
            body = zlib.compress(raw)
            out += struct.pack("<II", kind, len(body)) + body
        else:
            if choice.random() < 0.5:
                body = altered_bytes(choice, body[:120]) + body[120:]
            out += struct.pack("<II", kind, len(body)) + body
        position += 8 + size
    del head
    return bytes(out)


def hdf5(content: bytes, choice: random.Random) -> bytes:
    """Alter types, shapes, names and links of an HDF5 file."""
    import h5py

    stream = io.BytesIO(content)
    with h5py.File(stream, "r+") as file:
        paths: list[str] = []
        file.visit(paths.append)
        for _ in range(choice.choice((1, 2, 3))):
            path = choice.choice(paths)
            if path not in file:
                continue
            values: tuple[Any, ...] = (
                np.zeros(0), np.float64(1), np.zeros((2, 3, 4)), np.array(["a"] * 5, dtype="S3"),
                np.full(50, 2**63, dtype="u8"), np.zeros(5, dtype=[("a", "f8"), ("b", "S2")]),
                np.full(400, np.nan), np.ones((400, 2)), np.ones(400, bool), np.ones(400, complex),
            )  # fmt: skip
            match choice.randrange(4):
                case 0:
                    del file[path]
                case 1:
                    file[path].attrs[choice.choice(("unit", "units", "x"))] = choice.choice(
                        (word(choice, "bar").replace("\0", ""), 3, b"\xff", np.zeros(3))
                    )
                case 2:
                    file[f"l{choice.randrange(99)}"] = choice.choice(
                        (
                            h5py.SoftLink("/l1"),
                            h5py.SoftLink("/nothing"),
                            h5py.ExternalLink("x", "/y"),
                        )
                    )
                case 3:
                    del file[path]
                    file[path] = choice.choice(values)
    return stream.getvalue()


def ulog(content: bytes, choice: random.Random) -> bytes:
    """Alter messages of a ULog."""
    head, position, messages = content[:16], 16, []
    while position + 3 <= len(content):
        size, kind = struct.unpack_from("<HB", content, position)
        messages.append((kind, content[position + 3 : position + 3 + size]))
        position += 3 + size
    for _ in range(choice.choice((1, 2, 4))):
        place = choice.randrange(choice.choice((min(6, len(messages)), len(messages))))
        kind, body = messages[place]
        match choice.randrange(4):
            case 0:
                del messages[place]
            case 1:
                messages.insert(choice.randrange(len(messages)), messages[place])
            case 2:
                messages[place] = choice.choice(b"BFADSOILRPQMC"), body
            case 3:
                messages[place] = kind, altered_bytes(choice, body)
        if not messages:
            break
    return head + b"".join(struct.pack("<HB", len(body), kind) + body for kind, body in messages)


def tdms(content: bytes, choice: random.Random) -> bytes:
    """Alter properties, types and numbers of a TDMS file's metadata."""
    lead = 28
    (offset,) = struct.unpack_from("<Q", content, 20)
    metadata = altered_bytes(choice, content[lead : lead + offset])
    raw = content[lead + offset :]
    head = bytearray(content[:lead])
    struct.pack_into("<QQ", head, 12, len(metadata) + len(raw), len(metadata))
    return bytes(head) + metadata + raw


def mdf(content: bytes, choice: random.Random) -> bytes:
    """Alter links and numbers of an MDF's blocks: it has no checksums."""
    raw = bytearray(content)
    for _ in range(choice.choice((1, 2, 4))):
        blocks = [k for k in range(0, len(raw) - 24, 8) if raw[k : k + 2] == b"##"]
        at = choice.choice(blocks)
        (links,) = struct.unpack_from("<Q", raw, at + 16)
        if choice.random() < 0.5 and 0 < links < 20:
            place = at + 24 + 8 * choice.randrange(links)
            target = choice.choice((0, at, choice.choice(blocks), edge(choice, 64)))
            struct.pack_into("<Q", raw, min(place, len(raw) - 8), target)
        else:
            place = at + choice.randrange(160)
            width = choice.choice((1, 2, 4, 8))
            raw[place : place + width] = edge(choice, 8 * width).to_bytes(width, "little")
    return bytes(raw)


Alter = Callable[[bytes, random.Random], bytes]
BY_SUFFIX: dict[str, Alter] = {
    ".mcap": mcap, ".bag": bag, ".db3": sqlite, ".json": parsed_json, ".jsonl": parsed_json,
    ".csv": csv, ".parquet": parquet, ".mat": mat5, ".h5": hdf5, ".ulg": ulog, ".tdms": tdms,
    ".mf4": mdf,
}  # fmt: skip


def alter(name: str, content: bytes, choice: random.Random) -> bytes:
    """Return a recording that says something else."""
    return BY_SUFFIX[Path(name).suffix](content, choice)
