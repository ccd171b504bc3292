"""MCAP with JSON, Protobuf and ROS 1 messages, and the odd ends of CDR."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from eha_bench import recordings
from eha_bench.core.errors import RecordingError
from eha_bench.recordings.encodings.decoder import Encoded, UnreadableTopic
from eha_bench.recordings.encodings.decoders import make_decoder
from eha_bench.recordings.encodings.definitions import DefinitionError, parse_idl, parse_msg
from eha_bench.recordings.encodings.field_path import FieldPath
from eha_bench.recordings.encodings.payloads import Payloads
from eha_bench.recordings.guessing import first_map


def one(topic: str, field: str, **options: Any) -> dict[str, Any]:
    return {"channels": {"probe": {"topic": topic, "field": field, "unit": "V"}}, **options}


def raw_log(
    path: Path, encoding: str, schema: tuple[str, str, bytes], payloads: list[bytes]
) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=700, compression=CompressionType.LZ4)
        writer.start()
        name, kind, data = schema
        channel = writer.register_channel("/x", encoding, writer.register_schema(name, kind, data))
        for k, payload in enumerate(payloads):
            writer.add_message(channel, k * 1_000_000, payload, k * 1_000_000)
        writer.finish()
    return path


def decode(encoded: Encoded, payloads: list[bytes], *fields: str) -> list[list[float]]:
    """Decode messages one after the other through one decoder."""
    decoder = make_decoder(encoded, tuple(map(FieldPath.parse, fields)))
    rows = []
    for payload in payloads:
        columns = [np.empty(1) for _ in fields]
        buffer = np.frombuffer(payload, dtype=np.uint8)
        decoder.decode(Payloads(buffer, 1, buffer.size, 0, buffer.size), columns)
        rows.append([float(column[0]) for column in columns])
    return rows


def test_json(tmp_path: Path) -> None:
    payloads = [
        json.dumps(
            {
                "header": {"stamp": {"sec": 5 + k, "nanosec": 3}},
                "pose": {"position": {"z": k / 3}},
                "name": ["a", "motor"],
                "velocity": [0, k],
                "on": k % 2 == 0,
            }
        ).encode()
        for k in range(100)
    ]
    path = raw_log(tmp_path / "j.mcap", "json", ("x", "jsonschema", b"{}"), payloads)
    for field, expected in (
        ("pose.position.z", [k / 3 for k in range(100)]),
        ("velocity[1]", list(range(100))),
        ("velocity[motor]", list(range(100))),
        ("on", [float(k % 2 == 0) for k in range(100)]),
    ):
        assert recordings.read(path, channels=one("/x", field))["probe"].tolist() == expected
    by_header = recordings.read(path, channels=one("/x", "pose.position.z", clock="header"))
    assert by_header.epoch_ns == 5_000_000_003
    assert by_header.time[1] == 1.0
    with pytest.raises(RecordingError, match="no message has an element pose"):
        recordings.read(path, channels=one("/x", "pose.z"))
    with pytest.raises(RecordingError, match="not a number but an array: add an index"):
        recordings.read(path, channels=one("/x", "velocity"))


def test_protobuf(tmp_path: Path) -> None:
    from google.protobuf.timestamp_pb2 import Timestamp
    from mcap_protobuf.writer import Writer as ProtobufWriter

    path = tmp_path / "p.mcap"
    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        for k in range(50):
            writer.write_message("/x", Timestamp(seconds=k, nanos=7), k * 1000, k * 1000)
    assert recordings.read(path, channels=one("/x", "seconds"))["probe"].tolist() == list(range(50))
    with pytest.raises(RecordingError, match=r"no field 'second'; did you mean 'seconds'\?"):
        recordings.read(path, channels=one("/x", "second"))


def test_ros1_in_mcap(tmp_path: Path) -> None:
    from mcap_ros1.writer import Writer as Ros1Writer

    del Ros1Writer  # it needs ROS's own classes: the bytes are made here instead
    definition = (
        b"Header header\nfloat32[] v\ntime at\n" + b"=" * 80
        + b"\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    )  # fmt: skip
    payloads = []
    for k in range(60):
        frame = b"f" * (k % 4)
        values = [k / 8, -k / 4][: 1 + k % 2]
        payloads.append(
            struct.pack("<III", k, 100 + k, 5)
            + struct.pack("<I", len(frame)) + frame
            + struct.pack("<I", len(values)) + struct.pack(f"<{len(values)}f", *values)
            + struct.pack("<II", 9, k)
        )  # fmt: skip
    path = raw_log(tmp_path / "r.mcap", "ros1", ("my/Thing", "ros1msg", definition), payloads)
    assert recordings.read(path, channels=one("/x", "v[0]"))["probe"].tolist() == [
        k / 8 for k in range(60)
    ]
    second = recordings.read(path, channels=one("/x", "v[1]", clock="header"))
    assert np.array_equal(
        second["probe"], [-k / 4 if k % 2 else np.nan for k in range(60)], equal_nan=True
    )
    assert second.epoch_ns == 100_000_000_005
    for name in ("at.nsecs", "at.nanosec"):
        assert recordings.read(path, channels=one("/x", name))["probe"][7] == 7.0


DEFINITION = """
uint8 a
float64 b
int16[3] c
string s
Inner[] d
bool flag
wstring<=5 w
float32[<=4] e
uint64 BIG=5 # a constant
string note "has a # in it"
================================================================================
MSG: pkg/Inner
int32 x
string label
float64[2] y
"""
ENCODED = Encoded("cdr", "pkg/msg/Outer", "ros2msg", DEFINITION.encode())


class Cdr:
    """Plain CDR written by the book, to check the reader against."""

    def __init__(self, order: str) -> None:
        self.order = order
        self.body = b""

    def put(self, code: str, value: Any) -> "Cdr":
        size = struct.calcsize(code)
        self.body += bytes(-len(self.body) % size) + struct.pack(self.order + code, value)
        return self

    def text(self, value: str) -> "Cdr":
        raw = value.encode() + b"\0"
        self.put("I", len(raw))
        self.body += raw
        return self

    def finish(self) -> bytes:
        return bytes([0, self.order == "<", 0, 0]) + self.body


texts = st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=9)
numbers = st.floats(allow_nan=False, width=32)
inner = st.tuples(st.integers(-(2**31), 2**31 - 1), texts, numbers)


@given(
    order=st.sampled_from("<>"),
    rows=st.lists(st.tuples(texts, st.lists(inner, max_size=3), texts), min_size=1, max_size=12),
)
def test_cdr_by_the_book(order: str, rows: list[Any]) -> None:
    payloads, expected = [], []
    for label, members, wide in rows:
        cdr = Cdr(order).put("B", 7).put("d", 1.5)
        for value in (-1, 2, -3):
            cdr.put("h", value)
        cdr.text(label).put("I", len(members))
        for x, name, y in members:
            cdr.put("i", x).text(name).put("d", y).put("d", -y)
        cdr.put("?", True).put("I", len(wide))
        cdr.body += wide.encode("utf-16-le" if order == "<" else "utf-16-be")
        cdr.put("I", 2).put("f", 0.25).put("f", 8.0).text("")
        payloads.append(cdr.finish())
        second = members[1] if len(members) > 1 else None
        expected.append(
            [1.5, -3.0, second[2] * -1 if second else np.nan, 1.0, 8.0,
             float(second[0]) if second else np.nan]
        )  # fmt: skip
    found = decode(ENCODED, payloads, "b", "c[2]", "d[1].y[1]", "flag", "e[1]", "d[1].x")
    assert np.array_equal(found, expected, equal_nan=True)


def test_messages_of_ever_changing_shape(tmp_path: Path) -> None:
    payloads = []
    generator = np.random.default_rng(2)
    for k in range(300):
        cdr = Cdr("<").put("I", 0)
        cdr.body = b""
        names = [f"j{n}" * int(generator.integers(1, 4)) for n in range(generator.integers(0, 5))]
        names.insert(int(generator.integers(0, len(names) + 1)), "motor")
        cdr.put("I", len(names))
        for name in names:
            cdr.text(name)
        cdr.put("I", len(names))
        for name in names:
            cdr.put("d", float(k) if name == "motor" else -1.0)
        payloads.append(cdr.finish())
    schema = ("pkg/msg/State", "ros2msg", b"string[] name\nfloat64[] position")
    path = raw_log(tmp_path / "s.mcap", "cdr", schema, payloads)
    back = recordings.read(path, channels=one("/x", "position[motor]"))
    assert back["probe"].tolist() == list(range(300))


def test_a_message_that_does_not_fit_is_an_error(tmp_path: Path) -> None:
    good = Cdr("<").put("d", 1.0).finish()
    schema = ("std_msgs/msg/Float64", "ros2msg", b"float64 data")
    for bad, message in (
        (good[:-1], "ends after 11 bytes"),
        (b"\x00\x20\x00\x00" + good[4:], "not those of plain CDR"),
        (b"", "first bytes are missing"),
    ):
        path = raw_log(tmp_path / "b.mcap", "cdr", schema, [good] * 5 + [bad])
        with pytest.raises(RecordingError, match=message):
            recordings.read(path, channels=one("/x", "data"))
    endless = Cdr("<").put("I", 2**32 - 1).finish()
    schema = ("p/msg/S", "ros2msg", b"E[] e\nfloat64 data\n" + b"=" * 80 + b"\nMSG: p/E\nint8 a\n")
    path = raw_log(tmp_path / "e.mcap", "cdr", schema, [endless] * 3)
    with pytest.raises(RecordingError, match="claims 4294967295 elements"):
        recordings.read(path, channels=one("/x", "data"))


def test_a_type_that_holds_itself_is_an_error(tmp_path: Path) -> None:
    schema = ("p/msg/A", "ros2msg", b"A inner\nfloat64 data")
    path = raw_log(tmp_path / "r.mcap", "cdr", schema, [Cdr("<").put("d", 1.0).finish()] * 3)
    with pytest.raises(RecordingError, match="nested deeper"):
        recordings.read(path, channels=one("/x", "data"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("float64 a\n---\nbool b", "service"),
        ("float64", "not a field"),
        ("? not a message", "not a field"),
    ],
)
def test_what_is_no_definition(text: str, message: str) -> None:
    with pytest.raises(DefinitionError, match=message):
        parse_msg("p/msg/A", text)


def test_idl_and_msg_say_the_same() -> None:
    idl = """module pkg { module msg {
      struct Outer { double a; sequence<float> b; long c[3]; string d; pkg::msg::Inner e; };
      struct Inner { @verbatim (language="comment", text="x") unsigned short x; };
    }; };"""
    text = "float64 a\nfloat32[] b\nint32[3] c\nstring d\nInner e\n" + "=" * 80
    text += "\nMSG: pkg/Inner\nuint16 x\n"
    assert parse_idl(idl) == parse_msg("pkg/msg/Outer", text)


def test_numbers_are_equal_to_those_of_rosbags_for_all_standard_types() -> None:
    from rosbags.typesys import Stores, get_typestore

    from eha_bench.recordings.encodings.definitions import standard

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["sensor_msgs/msg/Imu"]
    nested = store.types
    vector = nested["geometry_msgs/msg/Vector3"]
    message = kind(
        header=nested["std_msgs/msg/Header"](
            stamp=nested["builtin_interfaces/msg/Time"](sec=3, nanosec=4), frame_id="odd"
        ),
        orientation=nested["geometry_msgs/msg/Quaternion"](x=1.0, y=2.0, z=3.0, w=4.0),
        orientation_covariance=np.arange(9.0),
        angular_velocity=vector(x=5.0, y=6.0, z=7.0),
        angular_velocity_covariance=np.arange(9.0),
        linear_acceleration=vector(x=8.0, y=9.0, z=10.0),
        linear_acceleration_covariance=np.arange(9.0),
    )
    raw = bytes(store.serialize_cdr(message, kind.__msgtype__))
    assert "sensor_msgs/Imu" in standard()
    encoded = Encoded("cdr", "sensor_msgs/msg/Imu", "", b"")
    found = decode(
        encoded, [raw], "orientation.w", "orientation_covariance[8]", "linear_acceleration.y"
    )
    assert found == [[4.0, 8.0, 9.0]]


XCDR2 = Encoded(
    "cdr", "pkg/msg/T", "ros2msg", b"uint32 a\nfloat64 b\nstring[] n\nfloat32[] c\nuint8 d\n"
)


@pytest.mark.parametrize("kind", [6, 7, 16, 17])
def test_plain_xcdr2(kind: int) -> None:
    order = "<" if kind & 1 else ">"
    # doubles at multiples of four; a size before an array of texts, none before one of numbers
    body = struct.pack(f"{order}Id", 3, 0.5)
    body += struct.pack(f"{order}III", 10, 1, 2) + b"x\0" + bytes(2)
    body += struct.pack(f"{order}IffB", 2, 1.5, 2.5, 9)
    payload = bytes([0, kind, 0, 0]) + body
    assert decode(XCDR2, [payload], "a", "b", "c[1]", "d") == [[3.0, 0.5, 2.5, 9.0]]


@pytest.mark.parametrize(("kind", "what"), [(3, "parameter list"), (9, "delimited XCDR2")])
def test_what_is_no_plain_cdr_is_named(kind: int, what: str) -> None:
    with pytest.raises(UnreadableTopic, match=what):
        decode(XCDR2, [bytes([0, kind, 0, 0]) + bytes(40)], "a")


@pytest.mark.parametrize(("encoding", "count"), [("utf-16-le", 1), ("utf-32-le", 1)])
def test_wide_strings_of_either_width(encoding: str, count: int) -> None:
    encoded = Encoded("cdr", "pkg/msg/T", "ros2msg", b"wstring s\nfloat64 b\n")
    payloads = []
    for k in range(4):
        cdr = Cdr("<").put("I", k * count)
        cdr.body += ("\u00f6" * k).encode(encoding)
        payloads.append(cdr.put("d", k + 0.5).finish())
    assert decode(encoded, payloads, "b") == [[0.5], [1.5], [2.5], [3.5]]


def test_a_message_that_is_longer_than_its_type_is_an_error() -> None:
    encoded = Encoded("cdr", "pkg/msg/T", "ros2msg", b"float64 b\n")
    padded = Cdr("<").put("d", 1.0).finish() + bytes(3)
    assert decode(encoded, [padded], "b") == [[1.0]]
    with pytest.raises(UnreadableTopic, match="4 bytes longer than its type"):
        decode(encoded, [padded + bytes(1)], "b")


RULE = "=" * 80
JOINTS = f"Joint[] joints\n{RULE}\nMSG: pkg/Joint\nfloat64 speed\nstring name\nint16[2] raw\n"
CONTROL = f"Point actual\nstring[] joint_names\n{RULE}\nMSG: pkg/Point\nfloat64[] positions\n"
DYNAMIC = (
    f"string[] joint_names\nState[] states\n{RULE}\nMSG: pkg/State\n"
    "string[] interface_names\nfloat64[] values\n"
)


def test_elements_are_found_by_their_own_name() -> None:
    encoded = Encoded("cdr", "pkg/msg/T", "ros2msg", JOINTS.encode())
    payloads = []
    for order in (("a", "motor"), ("motor", "a"), ("a", "b"), ("long name", "motor")):
        cdr = Cdr("<").put("I", 2)
        for place, name in enumerate(order):
            cdr.put("d", place + 0.25).text(name).put("h", place).put("h", -place)
        payloads.append(cdr.finish())
    found = decode(encoded, payloads, "joints[motor].speed", "joints[motor].raw[1]")
    expected = [[1.25, -1.0], [0.25, 0.0], [np.nan, np.nan], [1.25, -1.0]]
    assert np.array_equal(found, expected, equal_nan=True)
    with pytest.raises(UnreadableTopic, match=r"say which element, e\.g\. \[0\]\.speed"):
        decode(encoded, payloads, "joints.speed")


def test_elements_are_found_by_a_list_of_names_around_them() -> None:
    encoded = Encoded("cdr", "pkg/msg/T", "ros2msg", CONTROL.encode())
    payloads = []
    for names in (("hip", "knee"), ("knee", "hip"), ("hip", "toe")):
        cdr = Cdr("<").put("I", 2).put("d", 1.0).put("d", 2.0).put("I", 2)
        for name in names:
            cdr.text(name)
        payloads.append(cdr.finish())
    found = decode(encoded, payloads, "actual.positions[knee]")
    assert np.array_equal(found, [[2.0], [1.0], [np.nan]], equal_nan=True)
    encoded = Encoded("cdr", "pkg/msg/T", "ros2msg", b"float64[] v\n")
    with pytest.raises(UnreadableTopic, match="nothing names the elements"):
        decode(encoded, payloads, "v[knee]")


def test_names_within_names() -> None:
    encoded = Encoded("cdr", "pkg/msg/T", "ros2msg", DYNAMIC.encode())
    cdr = Cdr("<").put("I", 2).text("hip").text("knee").put("I", 2)
    for base in (10.0, 20.0):
        cdr.put("I", 2).text("position").text("effort").put("I", 2)
        cdr.put("d", base).put("d", base + 1)
    fields = ("states[knee].values[effort]", "states[hip].values[position]")
    assert decode(encoded, [cdr.finish()], *fields) == [[21.0, 10.0]]


def test_keys_of_any_script(tmp_path: Path) -> None:
    message = json.dumps({"v": 1, "ünï": {"a": [2, 3]}}).encode()
    path = raw_log(tmp_path / "u.mcap", "json", ("x", "jsonschema", b"{}"), [message] * 3)
    (topic,) = recordings.info(path).topics
    assert [value.name for value in topic.values] == ["v", "ünï.a[0]", "ünï.a[1]"]
    mapping = first_map(path)
    assert 'field: "ünï.a[0]"' in mapping
    (tmp_path / "map.yaml").write_text(mapping, encoding="utf-8")
    assert len(recordings.read(path, channels=tmp_path / "map.yaml").values) == 3


def test_a_key_that_no_path_can_name_is_said_and_hides_nothing(tmp_path: Path) -> None:
    payloads = [b'{"v": 1, "p-a": 2, "": 3, "in": {"p-b": 4, "7": 5, "": 6}}'] * 3
    path = raw_log(tmp_path / "k.mcap", "json", ("x", "jsonschema", b"{}"), payloads)
    found = recordings.info(path)
    assert [value.name for value in found.topics[0].values] == ["v", "in[p-b]"]
    assert any("what stands under 'p-a', '' cannot be read" in note for note in found.notes)


def test_names_in_json() -> None:
    message = {
        "joints": [{"name": "a", "v": 1}, {"name": "motor", "v": 2}],
        "by key": 3,
        "map": {"press a": 4},
        "joint_names": ["hip", "knee"],
        "actual": {"positions": [5, 6]},
    }
    encoded = Encoded("json", "", "", b"")
    fields = ("joints[motor].v", "map[press a]", "actual.positions[knee]")
    assert decode(encoded, [json.dumps(message).encode()], *fields) == [[2.0, 4.0, 6.0]]


def test_a_number_that_no_double_holds(tmp_path: Path) -> None:
    path = raw_log(tmp_path / "b.mcap", "json", ("x", "", b""), [b'{"v": %s}' % (b"9" * 400)] * 3)
    with pytest.raises(RecordingError, match="too large for a number"):
        recordings.read(path, channels=one("/x", "v"))
    path = raw_log(tmp_path / "c.mcap", "json", ("x", "", b""), [b'{"pressure": 1}'] * 3)
    with pytest.raises(RecordingError, match=r"no message has an element presure; did you mean"):
        recordings.read(path, channels=one("/x", "presure"))


def test_protobuf_of_every_shape(tmp_path: Path) -> None:
    from google.protobuf import descriptor_pool, message_factory
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field
    from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet

    file = FileDescriptorProto(name="t.proto", package="p", syntax="proto3")
    states = file.enum_type.add(name="State")
    states.value.add(name="OFF", number=0)
    states.value.add(name="ON", number=5)
    inner = file.message_type.add(name="In")
    inner.field.add(name="z", number=1, type=Field.TYPE_DOUBLE, label=1)
    inner.field.add(name="n", number=2, type=Field.TYPE_SINT64, label=1)
    outer = file.message_type.add(name="Out")
    for number, (name, kind, label) in enumerate(
        [
            ("r", Field.TYPE_DOUBLE, 3), ("i", Field.TYPE_MESSAGE, 1),
            ("ri", Field.TYPE_MESSAGE, 3), ("e", Field.TYPE_ENUM, 1),
            ("names", Field.TYPE_STRING, 3), ("m", Field.TYPE_MESSAGE, 3),
        ],
        1,
    ):  # fmt: skip
        named = {"i": ".p.In", "ri": ".p.In", "e": ".p.State", "m": ".p.Out.MEntry"}.get(name)
        outer.field.add(name=name, number=number, type=kind, label=label, type_name=named)
    entry = outer.nested_type.add(name="MEntry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=Field.TYPE_STRING, label=1)
    entry.field.add(name="value", number=2, type=Field.TYPE_DOUBLE, label=1)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("p.Out"))
    messages = []
    for k in range(20):
        message = kind(r=[k, 2 * k], e=5 * (k % 2), names=["a", "motor"])
        message.ri.add(z=1)
        message.ri.add(z=k / 3, n=-k)
        message.m["speed"] = k * 1.5
        if k % 2:
            message.i.z = k
        messages.append(message.SerializeToString())
    schema = FileDescriptorSet(file=[file]).SerializeToString()
    path = raw_log(tmp_path / "p.mcap", "protobuf", ("p.Out", "protobuf", schema), messages)
    for field, expected in (
        ("r[1]", [2.0 * k for k in range(20)]),
        ("r[motor]", [2.0 * k for k in range(20)]),
        ("ri[1].z", [k / 3 for k in range(20)]),
        ("ri[1].n", [-float(k) for k in range(20)]),
        ("e", [5.0 * (k % 2) for k in range(20)]),
        ("m[speed]", [1.5 * k for k in range(20)]),
        ("i.z", [float(k) if k % 2 else np.nan for k in range(20)]),
    ):
        back = recordings.read(path, channels=one("/x", field))["probe"]
        assert np.array_equal(back, expected, equal_nan=True), field
    for field, message in (
        ("r", "not a number but an array: add an index"),
        ("i", r"not a number but a message: add one of its fields \(z, n\)"),
        ("names[0]", "not a number but text"),
        ("ri.z", r"say which element, e\.g\. \[0\]\.z"),
        ("e[0]", "takes an element of something that is not an array"),
    ):
        with pytest.raises(RecordingError, match=message):
            recordings.read(path, channels=one("/x", field))


def test_idl_as_it_stands_in_recordings(tmp_path: Path) -> None:
    idl = (
        RULE
        + """
IDL: pkg/msg/T
// generated from rosidl_adapter/resource/msg.idl.em
#include "std_msgs/msg/Header.idl"

module pkg { module msg {
  module T_Constants { const uint8 A = 3; };
  enum Mode { OFF, ON };
  @verbatim (language="comment", text="x" "y")
  struct T { unsigned long a; pkg::msg::Mode mode; double b; };
}; };
"""
    )
    payloads = [Cdr("<").put("I", k).put("I", 1).put("d", k / 2).finish() for k in range(9)]
    for kind, name in (("ros2idl", "pkg/msg/T"), ("omgidl", "pkg::msg::T")):
        path = raw_log(tmp_path / "i.mcap", "cdr", (name, kind, idl.encode()), payloads)
        assert recordings.read(path, channels=one("/x", "b"))["probe"][3] == 1.5
        assert recordings.read(path, channels=one("/x", "mode"))["probe"][3] == 1.0
