"""A diagnosis whose candidates are fitted on a cluster is that of one process, to the last bit.

That processes of this machine find the same is a test of `test_interruption`.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import psutil
import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "core"))

from cluster import two_workers
from drive_data import write_drive

import eha_bench
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_drive(tmp_path_factory.mktemp("drive"), seconds=1.0)


def assert_same(one: Diagnosis, two: Diagnosis) -> None:
    assert one.to_dict() | {"seconds": 0} == two.to_dict() | {"seconds": 0}
    assert one.revised.to_yaml() == two.revised.to_yaml()
    np.testing.assert_array_equal(one.revised.vector(), two.revised.vector())


def kill_at_work(victim: subprocess.Popen[bytes], over: threading.Event) -> None:
    """Kill a worker as soon as it computes: by its own time, since no wall clock says when."""
    used = psutil.Process(victim.pid).cpu_times
    at_rest = used().user
    while not over.wait(0.01):
        if used().user > at_rest + 0.2:
            victim.kill()
            return


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_cluster_finds_the_same_though_a_worker_is_killed(dataset: Path, tmp_path: Path) -> None:
    over = threading.Event()
    with two_workers(tmp_path) as cluster:
        victim = cluster.workers[0]
        killer = threading.Thread(target=kill_at_work, args=(victim, over))

        def tell(stage: str, _: float) -> None:
            if stage == "search" and not killer.ident:
                killer.start()

        there = eha_bench.diagnose(dataset, progress=tell, workers=cluster.name)
        over.set()
        killer.join()
        victim.wait(timeout=10.0)
    assert victim.returncode == -signal.SIGKILL
    assert_same(eha_bench.diagnose(dataset), there)
