"""`read`: any recording, whatever its format, as a `Recording`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from eha_bench.core.errors import InputError
from eha_bench.core.recording import Recording
from eha_bench.recordings import sample
from eha_bench.recordings.budget import spending
from eha_bench.recordings.channel_map import ChannelMap, load_channel_map
from eha_bench.recordings.mapped import read_mapped, unmapped_error
from eha_bench.recordings.mapped import read_topics as read_mapped_topics
from eha_bench.recordings.opening import open_source
from eha_bench.recordings.own import read_own
from eha_bench.recordings.source import TimeSpan
from eha_bench.recordings.tables.table import TableSource


def read(
    path: str | Path,
    *,
    channels: str | Path | ChannelMap | Mapping[str, object] | None = None,
    start: float | None = None,
    stop: float | None = None,
) -> Recording:
    """Return a recording in SI on one clock, time zero at its first sample.

    Args:
        path: MCAP, ROS 1 bag, rosbag2 folder or one of its files, CSV, Parquet, MAT, HDF5, MDF,
            TDMS, ULog, JSON or JSON lines.
        channels: a `channels.yaml`, or its content; None for eha-bench's own recordings.
        start: only samples from here on, s on the recording's clock, whose zero stays where it is;
            an MCAP's chunks outside of the span are not even decompressed.
        stop: only samples before this time, s.

    Raises:
        RecordingError: missing, empty, damaged, no recording, its time does not increase, or it
            lacks a mapped topic, field or column.
        InputError: the channel map is wrong.
    """
    span = TimeSpan(-math.inf if start is None else start, math.inf if stop is None else stop)
    if not span.start < span.stop:
        raise InputError(f"a span from {span.start} s to {span.stop} s holds nothing")
    mapping = load_channel_map(channels) if channels is not None else None
    with spending(Path(path)):
        source = open_source(Path(path))
        if mapping is not None:
            return read_mapped(source, mapping, span)
        if isinstance(source, TableSource):
            return read_mapped(source, source.own_map(), span, described_itself=True)
        if sample.is_own(source.metadata()):
            return read_own(source, span)
        raise unmapped_error(source)


def read_topics(
    path: str | Path, *, channels: str | Path | ChannelMap | Mapping[str, object] | None = None
) -> tuple[Recording, ...]:
    """Return a recording for each topic of a log, at the topic's own stamps; time zero in common.

    Nothing is resampled. Topics that tick together are one recording, so a table or one of our own
    recordings is one, as `read` gives it.

    Args:
        path, channels: as `read`.

    Raises:
        RecordingError: as `read`.
        InputError: the channel map is wrong.
    """
    if channels is None:
        return (read(path),)
    with spending(Path(path)):
        return read_mapped_topics(open_source(Path(path)), load_channel_map(channels))
