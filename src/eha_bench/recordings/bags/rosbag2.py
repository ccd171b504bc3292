"""rosbag2 folders: one recording split over files, described by metadata.yaml."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from eha_bench.core.errors import InputError, Place, RecordingError
from eha_bench.core.temporary_folder import TemporaryFolder
from eha_bench.core.yaml_file import load
from eha_bench.recordings.budget import budget
from eha_bench.recordings.formats import open_file
from eha_bench.recordings.naming import printable
from eha_bench.recordings.source import Source, TimeSpan, Topic, TopicRequest
from eha_bench.recordings.track import Track

_FILES = ("*.mcap", "*.db3", "*.mcap.zstd", "*.db3.zstd")


class Rosbag2Source(Source):
    """An opened rosbag2 folder, or one compressed file of it; read file after file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._notes: list[str] = []
        self._torn = False
        self._unpacked: dict[str, str] = {}
        self._folders: list[TemporaryFolder] = []
        described = self._describe() if path.is_dir() else {"relative_file_paths": [path.name]}
        self._folder = path if path.is_dir() else path.parent
        self._parts = [self._open(file) for file in self._files(described)]
        if not self._parts:
            raise RecordingError(
                "the folder holds no recording (no metadata.yaml, *.mcap or *.db3)",
                where=Place(file=str(path)),
                hint="give a recording or a rosbag2 folder",
            )

    @property
    def path(self) -> str:
        """The folder, for messages."""
        return str(self._path)

    @property
    def parts(self) -> tuple[Source, ...]:
        """The files, in order."""
        return tuple(self._parts)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found so far, each with the file that it was found in."""
        inner = [
            f"{Path(part.path).name}: {note}" if len(self._parts) > 1 else note
            for part in self._parts
            for note in part.notes
        ]
        return (*self._notes, *inner)

    @property
    def damaged(self) -> bool:
        """Whether something of a part was lost."""
        return self._torn or any(part.damaged for part in self._parts)

    @property
    def format(self) -> str:
        """`rosbag2`."""
        return "rosbag2"

    def topics(self) -> tuple[Topic, ...]:
        """The topics of all files."""
        found: dict[str, Topic] = {}
        for part in self._parts:
            for topic in part.topics():
                found.setdefault(topic.name, topic)
        return tuple(found.values())

    def tracks(
        self, wanted: Mapping[str, TopicRequest], span: TimeSpan | None = None
    ) -> dict[str, Track]:
        """Return the samples of the wanted topics, file after file.

        Raises:
            RecordingError: a topic cannot be decoded.
        """
        collected: dict[str, list[Track]] = {topic: [] for topic in wanted}
        for part in self._parts:
            here = {topic.name for topic in part.topics()}
            inside = {topic: what for topic, what in wanted.items() if topic in here}
            with self._as_given():
                for topic, track in part.tracks(inside, span).items():
                    collected[topic].append(track)
        return {topic: _joined(topic, tracks) for topic, tracks in collected.items()}

    def example(self, topic: str) -> bytes:
        """Return the first message of a topic; empty if there is none."""
        return next((found for part in self._parts if (found := part.example(topic))), b"")

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Metadata of all files."""
        found: dict[str, dict[str, str]] = {}
        for part in self._parts:
            for name, record in part.metadata().items():
                found.setdefault(name, {}).update(record)
        return found

    def attachments(self) -> Mapping[str, bytes]:
        """Attachments of all files."""
        return {name: data for part in self._parts for name, data in part.attachments().items()}

    def damaged_attachments(self) -> tuple[str, ...]:
        """Damaged attachments of all files."""
        return tuple(name for part in self._parts for name in part.damaged_attachments())

    def _describe(self) -> dict[str, Any]:
        file = self._path / "metadata.yaml"
        if not file.exists():
            return {}
        try:
            # not turned into plain dicts: a file of a few aliases would then fill the memory
            content = load(file)
        except InputError as error:
            self._notes.append(f"its metadata.yaml was ignored ({error})")
            return {}
        inside = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
        return inside if isinstance(inside, dict) else {}

    def _files(self, described: Mapping[str, Any]) -> list[Path]:
        """Return the files that the description names, or all that the folder holds."""
        named = described.get("relative_file_paths")
        if not isinstance(named, list) or not named:
            found = {file for pattern in _FILES for file in self._path.glob(pattern)}
            if found and not described:
                self._notes.append("there is no metadata.yaml; its files were read by name")
            return sorted(found, key=_natural)
        files = []
        for written in map(str, named):
            # only the name counts: a description never leads out of its folder
            name = PurePath(written).name
            if name != written:
                self._notes.append(
                    f"metadata.yaml names {printable([written])}; {printable([name])} was read"
                )
            file = self._folder / name
            if not file.is_file():  # no pipe either
                raise RecordingError(
                    f"a part of the recording is missing: {printable([name])}",
                    where=Place(file=str(self._path)),
                    hint="put the file back, or remove metadata.yaml to read the other files",
                )
            files.append(file)
        return files

    def _open(self, file: Path) -> Source:
        if file.suffix == ".zstd":
            original, file = file, self._unpack(file)
            self._unpacked[str(file)] = str(original)
        with file.open("rb") as stream:
            head = stream.read(4096)
        with self._as_given():
            if not head:
                raise RecordingError("the file is empty", where=Place(file=str(file)))
            return open_file(file, head)

    @contextmanager
    def _as_given(self) -> Iterator[None]:
        """Name the compressed file in an error, not the temporary one that it was unpacked to."""
        try:
            yield
        except RecordingError as error:
            original = self._unpacked.get(error.where.file)
            if original is None:
                raise
            where = error.where._replace(file=original)
            raise RecordingError(error.what, where=where, hint=error.hint) from error

    def _unpack(self, file: Path) -> Path:
        """Decompress a file into a temporary folder that goes when the source goes."""
        import zstandard

        folder = TemporaryFolder("eha-bench-bag-")
        self._folders.append(folder)
        target = folder.path / file.stem
        written = 0
        allowed = budget()
        try:
            with file.open("rb") as source, target.open("wb") as sink:
                for part in zstandard.ZstdDecompressor().read_to_iter(source):
                    written += len(part)
                    allowed.hold(written, "what it decompresses to")
                    allowed.tick()
                    sink.write(part)
        except zstandard.ZstdError:
            self._torn = True
            self._notes.append(f"{file.name}: its compression is torn; the part before was read")
        except OSError as error:
            raise RecordingError(
                f"it cannot be decompressed to {folder.path} ({error.strerror or error})",
                where=Place(file=str(file)),
                hint="make room there, or set TMPDIR",
            ) from error
        return target


def _natural(path: Path) -> tuple[object, ...]:
    """Sort bag_2 before bag_10."""
    digits = "".join(c if c.isdigit() else " " for c in path.stem).split()
    return (*(int(d) for d in digits[-1:]), path.name) if digits else (-1, path.name)


def _joined(topic: str, tracks: list[Track]) -> Track:
    filled = [track for track in tracks if len(track)]
    if len(filled) <= 1:
        return (
            filled[0] if filled else (tracks[0] if tracks else Track(topic, np.empty(0, np.int64)))
        )
    columns = {
        name: np.concatenate([track.columns[name] for track in filled])
        for name in filled[0].columns
    }
    kinds = {name: kind for track in filled for name, kind in track.kinds.items()}
    return Track(topic, np.concatenate([track.stamps for track in filled]), columns, kinds)
