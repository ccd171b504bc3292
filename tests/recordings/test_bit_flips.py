"""One flipped bit anywhere in a recording of ours is found, or changes nothing."""

from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench import recordings
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.recording import Recording
from eha_bench.recordings import LiveWriter


@pytest.fixture(scope="module")
def ours(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ours")
    suite = folder / "suite.yaml"
    suite.write_text(
        "name: flips\ntrials:\n"
        "  - {id: step, mode: pressure, setup: {piston: locked, bypass: closed}, duration: 0.1 s,\n"
        "     sample_rate: 1 kHz, signal: {kind: step, final: 1 MPa},\n"
        "     accept: {overshoot: <= 50 %}}\n"
    )
    eb.run(suite, target="simulator", out=folder / "out")
    return next((folder / "out").rglob("*.mcap"))


def same(one: Recording, other: Recording) -> bool:
    return (
        one.time.tobytes() == other.time.tobytes()
        and list(one.values) == list(other.values)
        and dict(one.units) == dict(other.units)
        and dict(one.metadata) == dict(other.metadata)
        and dict(one.attachments) == dict(other.attachments)
        and one.epoch_ns == other.epoch_ns
        and all(one[name].tobytes() == other[name].tobytes() for name in one.values)
    )


def unnoticed(path: Path, count: int, folder: Path) -> list[int]:
    """Flip `count` bits, one at a time; return the places where that changed something unsaid."""
    content = path.read_bytes()
    whole = recordings.read(path)
    assert recordings.info(path).health == "good"
    target = folder / "flipped.mcap"
    missed = []
    for place in np.linspace(0, 8 * len(content) - 1, count).astype(int).tolist():
        flipped = bytearray(content)
        flipped[place // 8] ^= 1 << place % 8
        target.write_bytes(flipped)
        try:
            found = recordings.read(target)
        except EhaBenchError:
            continue  # refused: nothing is judged by it
        if set(found.notes) <= set(whole.notes) and not same(found, whole):
            missed.append(place)
    return missed


def test_no_flipped_bit_changes_anything_without_a_note(ours: Path, tmp_path: Path) -> None:
    assert unnoticed(ours, 250, tmp_path) == []


@pytest.mark.slow
def test_none_of_2500_flipped_bits_changes_anything_without_a_note(
    ours: Path, tmp_path: Path
) -> None:
    assert unnoticed(ours, 2500, tmp_path) == []


def test_a_torn_recording_keeps_a_checksum_of_its_names_and_units(tmp_path: Path) -> None:
    path = tmp_path / "live.mcap"
    writer = LiveWriter(path, {"spool_position": "m", "pressure_a": "Pa"}, epoch_ns=10**18)
    for tick in range(200):
        writer.append(tick / 1000, [1e-3, 1e5])
    writer.flush()
    content = path.read_bytes()  # as a kill leaves it: neither index nor checksum of all data
    writer.close()
    torn = tmp_path / "torn.mcap"
    head = content.index(b"float64")
    whole = None
    for place in range(40 * 8, head * 8, 7):
        flipped = bytearray(content)
        flipped[place // 8] ^= 1 << place % 8
        torn.write_bytes(content)
        whole = whole or recordings.read(torn)
        torn.write_bytes(flipped)
        try:
            found = recordings.read(torn)
        except EhaBenchError:
            continue
        said = set(found.notes) - set(whole.notes)
        assert said or same(found, whole), place
