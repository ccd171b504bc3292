"""The MCAP project's reader for JavaScript, an independent one, finds what we wrote."""

import base64
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eha_bench import recordings
from eha_bench.core.recording import Recording
from eha_bench.recordings import LiveWriter, recover

SCRIPTS = Path(__file__).with_name("node")
EPOCH = 1_760_000_000_000_000_000


@pytest.fixture(scope="module")
def node(request: pytest.FixtureRequest) -> Path:
    """A folder with the script and its packages; skips where there is no node."""
    if not shutil.which("node") or not shutil.which("npm"):
        pytest.skip("node and npm are not there")
    assert request.config.cache is not None
    folder = Path(request.config.cache.mkdir("mcap-core"))
    for name in ("package.json", "package-lock.json", "read.mjs"):
        shutil.copy(SCRIPTS / name, folder / name)
    lock = folder / "node_modules" / ".package-lock.json"
    if not lock.exists() or lock.stat().st_mtime < (SCRIPTS / "package.json").stat().st_mtime:
        installed = subprocess.run(
            ["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"],
            cwd=folder, capture_output=True, text=True, check=False, timeout=300,
        )  # fmt: skip
        if installed.returncode:
            reason = f"npm ci failed: {installed.stderr.strip()[-300:]}"
            if os.environ.get("CI", "").lower() in {"1", "true", "yes"}:
                pytest.fail(reason)
            pytest.skip(reason)
    return folder


def by_node(folder: Path, path: Path) -> Any:
    done = subprocess.run(
        ["node", "read.mjs", str(path)], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def check(found: Any, recording: Recording) -> None:
    assert found["profile"] == "ros2"
    assert found["done"]
    assert found["messages"] == len(recording) == len(found["rows"])
    stamps = [int(row[0]) for row in found["rows"]]
    expected = recording.epoch_ns + np.rint(recording.time * 1e9).astype(np.int64)
    assert stamps == expected.tolist()
    assert [row[1] for row in found["rows"]] == list(range(len(recording)))
    assert [row[2] * 10**9 + row[3] for row in found["rows"]] == stamps
    for name in ("time", *recording.values):
        theirs = [row[4][name] for row in found["rows"]]
        ours = recording.time if name == "time" else recording[name]
        assert theirs == ours.tolist(), name


def test_block_live_and_recovered_files(node: Path, tmp_path: Path) -> None:
    generator = np.random.default_rng(4)
    count = 12_000
    clock = np.arange(count) / 1000
    values = {name: generator.normal(size=count) for name in ("pressure_a", "current", "force")}
    recording = Recording(
        clock, values, epoch_ns=EPOCH, metadata={"seed": "4"}, attachments={"s.yaml": b"suite\n"}
    )
    block = recordings.write(tmp_path / "block.mcap", recording)
    found = by_node(node, block)
    check(found, recording)
    assert found["metadata"]["eha_bench.metadata"] == {"seed": "4"}
    assert base64.b64decode(found["attachments"]["s.yaml"]) == b"suite\n"
    assert found["kinds"]["Message"] == count

    live = tmp_path / "live.mcap"
    with LiveWriter(live, list(values), epoch_ns=EPOCH) as writer:
        for tick in range(count):
            writer.append(clock[tick], [array[tick] for array in values.values()])
    check(by_node(node, live), recording)

    content = live.read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(content[: len(content) * 2 // 3])
    report = recover(torn, tmp_path / "clean.mcap")
    saved = report.messages["/eha_bench/sample"]
    assert 0.5 * count < saved < count
    check(by_node(node, tmp_path / "clean.mcap"), recording.between(0, clock[saved]))
