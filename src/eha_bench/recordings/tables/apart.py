"""Files that a library in C reads, in a separate process: what crashes there ends no bench.

The other process opens the file with limits of memory and time, says what it holds, and hands over
one column at a time: a line of JSON and the numbers behind it, nothing that could be executed.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
import weakref
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from eha_bench.core.errors import EhaBenchError, Place, RecordingError
from eha_bench.recordings.budget import (
    OutOfTime,
    OverBudget,
    ReadingBudget,
    budget,
    reading_budget,
    spending,
)
from eha_bench.recordings.channel_map import ChannelMap
from eha_bench.recordings.tables.grouped import GroupedTable, Series
from eha_bench.recordings.track import Stamps

_KINDS = {
    "hdf5": "hdf5:Hdf5Source",
    "mat": "hdf5:Mat73Source",
    "mdf": "mdf:MdfSource",
    "tdms": "tdms:TdmsSource",
    "ulog": "ulog:UlogSource",
}
_LIBRARIES = {
    "hdf5": "h5py", "mat": "h5py", "mdf": "asammdf", "tdms": "nptdms", "ulog": "pyulog"
}  # fmt: skip
_SLACK = 256 << 20
"""Bytes that a library may reserve in addition to what the file takes."""
_PATIENCE = 60.0
"""Seconds of waiting beyond the budget: the other process starts, and the machine may be busy."""
_GRACE = 2
"""Seconds of processor time beyond the budget, left to report that it is used up."""
_LONGEST = 64 << 20
_OVER = (OutOfTime, OverBudget)


class ApartTable(GroupedTable):
    """A file that another process reads."""

    kind = ""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._allowed = budget()
        self._failure: RecordingError | None = None
        self._process = subprocess.Popen(
            [
                sys.executable, "-m", "eha_bench.recordings.tables.apart", self.kind, str(path),
                str(self._allowed.memory), repr(self._allowed.seconds),
            ],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
        weakref.finalize(self, _end, self._process)
        self._take(self._answer()[0])

    @property
    def format(self) -> str:
        """The format that the other process found."""
        return self._format

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """What the file says besides its columns."""
        return self._metadata

    def in_columns(self, mapping: ChannelMap) -> ChannelMap:
        """Return the map by columns; CAN frames are decoded where it names a DBC.

        Raises:
            RecordingError: a DBC cannot be read, or there is no such column.
        """
        if mapping.dbc and self.kind == "mdf":
            self._take(self._ask({"dbc": [str(Path(file).absolute()) for file in mapping.dbc]})[0])
        return super().in_columns(mapping)

    def clock(self, name: str) -> NDArray[Any]:
        """Return a column of times, shape (n,): numbers, dates, or texts that are times.

        Raises:
            RecordingError: it holds something else.
        """
        self._check(name)
        values = self._array(self._ask({"clock of": name}))
        return values if values.dtype.kind in "mM" else values.astype(np.float64)

    def _take(self, answer_head: Mapping[str, Any]) -> None:
        """Keep what the other process says that the file holds."""
        self._format = str(answer_head["format"])
        self._metadata = {
            str(name): {str(key): str(value) for key, value in record.items()}
            for name, record in answer_head["metadata"].items()
        }
        self.own_epoch = answer_head["own_epoch"]
        self._hear(answer_head)
        self._series = [
            Series(group, name, partial(self._values_of, place), unit, clock)
            for place, (group, name, unit, clock) in enumerate(answer_head["series"])
        ]
        self._clocks = {group: partial(self._stamps_of, group) for group in answer_head["clocks"]}
        self.forget_names()

    def _hear(self, answer_head: Mapping[str, Any]) -> None:
        """Take over what was found while the last question was answered."""
        self._torn |= bool(answer_head["torn"])
        self._notes += [note for note in answer_head["notes"] if note not in self._notes]

    def _values_of(self, place: int) -> NDArray[Any]:
        return self._array(self._ask({"values": place}))

    def _stamps_of(self, group: str) -> Stamps:
        answer_head, raw = self._ask({"stamps": group})
        stamps: Stamps = self._array((answer_head, raw)).astype(np.int64)
        if answer_head.get("exact"):
            seconds = self._array(self._ask({"seconds": group}))
            self.exact_seconds[group or self.path] = seconds.astype(np.float64)
        return stamps

    def _array(self, answer: tuple[Mapping[str, Any], bytes]) -> NDArray[Any]:
        answer_head, raw = answer
        if "texts" in answer_head:
            return np.array(answer_head["texts"], dtype=object)
        values: NDArray[Any] = np.frombuffer(raw, dtype=np.dtype(answer_head["dtype"]))
        return values.reshape(answer_head["shape"])

    def _ask(self, question: Mapping[str, Any]) -> tuple[Mapping[str, Any], bytes]:
        assert self._process.stdin is not None
        if self._failure is not None:
            raise self._failure
        with suppress(OSError):  # one that has ended says so by its silence
            self._process.stdin.write(json.dumps(question).encode() + b"\n")
            self._process.stdin.flush()
        answer = self._answer()
        self._hear(answer[0])
        return answer

    def _answer(self) -> tuple[Mapping[str, Any], bytes]:
        """Return what the other process says.

        Raises:
            RecordingError: it cannot read the file, it crashed, or it took too long.
        """
        stream = self._process.stdout
        assert stream is not None
        until = time.monotonic() + _PATIENCE + 10 * self._allowed.seconds
        while not select.select([stream], [], [], max(until - time.monotonic(), 0.0))[0]:
            if time.monotonic() >= until:
                raise self._end_with(
                    OverBudget("it takes too long to read", where=Place(file=self.path))
                )
        line = stream.readline(_LONGEST)
        try:
            answer_head = json.loads(line)
        except ValueError:
            raise self._crash_error() from None
        size = int(answer_head.get("bytes", 0))
        self._allowed.hold(size, "a column")
        raw = stream.read(size) if size else b""
        if len(raw) < size:
            raise self._crash_error()
        if "error" in answer_head:
            self._torn |= bool(answer_head["torn"])
            kind = next(
                (kind for kind in _OVER if kind.__name__ in answer_head["over"]), RecordingError
            )
            place = {key: answer_head["place"][key] for key in ("file", "line", "key", "topic")}
            raise kind(answer_head["error"], where=Place(**place), hint=answer_head["hint"])
        return answer_head, raw

    def _end_with(self, how: RecordingError) -> RecordingError:
        """End the other process; whatever else is asked has the same answer."""
        self._failure = how
        self._torn = True
        self._notes.append(how.what)
        _end(self._process)
        return how

    def _crash_error(self) -> RecordingError:
        _end(self._process)
        code = self._process.returncode
        late = code in (-signal.SIGXCPU, -signal.SIGKILL)
        how = "was stopped: it took more than a file of this size may take" if late else "crashed"
        return self._end_with(
            RecordingError(
                f"the file is damaged: the library that reads {self.kind} files {how}",
                where=Place(file=self.path),
                hint="record or export it again",
            )
        )


class Hdf5Table(ApartTable):
    """An HDF5 file."""

    kind = "hdf5"


class Mat73Table(ApartTable):
    """A MAT file of version 7.3."""

    kind = "mat"


class MdfTable(ApartTable):
    """An MDF file."""

    kind = "mdf"


class TdmsTable(ApartTable):
    """A TDMS file."""

    kind = "tdms"


class UlogTable(ApartTable):
    """A ULog file."""

    kind = "ulog"


def _end(process: subprocess.Popen[bytes]) -> None:
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with suppress(OSError):
                stream.close()
    try:
        process.wait(0.2)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


# --- the other process ---------------------------------------------------------


def serve(kind: str, path: Path, questions: BinaryIO, answers: BinaryIO) -> None:
    """Open a file, say what it holds, and answer until the other end closes."""
    module, _, name = _KINDS[kind].partition(":")
    source: GroupedTable | None = None

    def say(content: Mapping[str, Any], raw: bytes = b"") -> None:
        answers.write(json.dumps({**content, "bytes": len(raw)}).encode() + b"\n" + raw)
        answers.flush()

    def attempt(act: Any) -> bool:
        try:
            content, raw = act()
            found = {"notes": list(source.notes), "torn": source.damaged} if source else {}
            say({**content, **found}, raw)
        except MemoryError:
            refuse(OverBudget("there is not enough memory to read it", where=Place(file=str(path))))
            return False
        except EhaBenchError as error:
            refuse(error)
            return False
        return True

    def refuse(error: EhaBenchError) -> None:
        where = error.where
        place = {"file": where.file, "line": where.line, "key": where.key, "topic": where.topic}
        over = [kind.__name__ for kind in _OVER if isinstance(error, kind)][:1]
        torn = source is not None and source.damaged
        say({"error": error.what, "hint": error.hint, "place": place, "over": over, "torn": torn})

    def opened() -> tuple[Mapping[str, Any], bytes]:
        nonlocal source
        source = made(path)
        return _holds(source), b""

    made = getattr(import_module(f"eha_bench.recordings.tables.{module}"), name)
    with suppress(ImportError):  # reported where it is used
        import_module(_LIBRARIES[kind])
    with spending(path) as allowed:  # one budget for all questions
        _limit(allowed)
        if not attempt(opened):
            return
        assert source is not None
        for line in iter(questions.readline, b""):
            attempt(partial(_answer_to, source, json.loads(line)))


def _limit(allowed: ReadingBudget) -> None:
    """Let the process take so much beyond what it has, where a library does not look itself."""
    import resource

    with suppress(OSError, ValueError):
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        most = taken + allowed.memory + _SLACK
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
    with suppress(OSError, ValueError):
        last = int(time.process_time() + allowed.seconds) + _GRACE
        resource.setrlimit(resource.RLIMIT_CPU, (last, last))


def _holds(source: GroupedTable) -> dict[str, Any]:
    return {
        "format": source.format,
        "metadata": source.metadata(),
        "own_epoch": source.own_epoch,
        "series": [[s.group, s.name, s.unit, s.clock] for s in source.series],
        "clocks": list(source.clocks),
    }


def _answer_to(
    source: GroupedTable, question: Mapping[str, Any]
) -> tuple[Mapping[str, Any], bytes]:
    budget().tick()
    match question:
        case {"dbc": files}:
            source.in_columns(_only_dbc(files))
            return _holds(source), b""
        case {"values": int(place)}:
            return _serialise(source.series[place].values())
        case {"clock of": str(name)}:
            return _serialise(source.clock(name))
        case {"stamps": str(group)}:
            answer_head, raw = _serialise(source.clocks[group]())
            return {**answer_head, "exact": group in source.exact_seconds}, raw
        case {"seconds": str(group)}:
            return _serialise(source.exact_seconds[group])
        case _:
            raise RecordingError("unknown request")


def _only_dbc(files: list[str]) -> ChannelMap:
    # as it is: the channels are looked up by who asks
    return ChannelMap.model_construct(dbc=tuple(files), channels={})


def _serialise(values: NDArray[Any]) -> tuple[dict[str, Any], bytes]:
    if values.dtype.kind in "OSU":
        texts = [
            v.decode("utf-8", "replace") if isinstance(v, bytes) else v for v in values.tolist()
        ]
        return {"texts": [v if isinstance(v, (str, int, float)) else None for v in texts]}, b""
    plain = np.ascontiguousarray(values)
    return {"dtype": plain.dtype.str, "shape": list(plain.shape)}, plain.tobytes()


def main() -> None:
    """Entry point of the other process: KIND PATH MEMORY SECONDS."""
    kind, path, memory, seconds = sys.argv[1:5]
    # what libraries print must not come between the answers
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with reading_budget(int(memory), float(seconds)), suppress(BrokenPipeError):
        serve(kind, Path(path), sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
