"""Many of the same: the same results wherever they run, and nobody's death costs the others."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from cluster import Cluster, two_workers
from poison import Shared, fails_on_three, kills_on_three, kills_once, slow_square, square

from eha_bench.core.errors import InputError
from eha_bench.core.processors import usable_processors
from eha_bench.core.workers import (
    DaskCluster,
    InProcess,
    Processes,
    RayCluster,
    WorkError,
    Workers,
    workers_from,
)
from locked import locked

ITEMS = [0.1 * k for k in range(20)]


@pytest.mark.parametrize("workers", [InProcess(), Processes(2)], ids=["here", "processes"])
def test_the_results_are_those_of_one_process_in_order(workers: Workers) -> None:
    assert workers.map(square, ITEMS) == [x * x for x in ITEMS]
    assert workers.map(square, []) == []


@pytest.mark.parametrize("workers", [InProcess(), Processes(2)], ids=["here", "processes"])
def test_an_error_costs_its_own_item_only(workers: Workers) -> None:
    found = list(workers.ordered(fails_on_three, range(6)))
    assert [outcome.value for outcome in found] == [0, 1, 2, None, 4, 5]
    assert str(found[3].error) == "ValueError: three is not a good"
    assert found[3].error is not None
    assert "fails_on_three" in found[3].error.trace
    with pytest.raises(WorkError, match="three is not a good"):
        workers.map(fails_on_three, range(6))


def test_what_all_items_share_is_sent_to_each_worker_once(tmp_path: Path) -> None:
    told = tmp_path / "arrivals"
    assert Processes(2).map(Shared(str(told)), ITEMS) == [x * x for x in ITEMS]
    places = told.read_text().split()
    assert 1 <= len(places) == len(set(places)) <= 2


def test_what_a_dead_worker_was_doing_is_done_again(tmp_path: Path) -> None:
    tasks = [(k, str(tmp_path / "died")) for k in range(8)]
    assert Processes(2).map(kills_once, tasks) == [10 * k for k in range(8)]
    assert (tmp_path / "died").exists()


@pytest.mark.slow
def test_what_kills_every_worker_is_told_and_the_rest_is_done() -> None:
    found = list(Processes(2).ordered(kills_on_three, range(12)))
    assert [outcome.value for outcome in found] == [None if k == 3 else 10 * k for k in range(12)]
    assert "its worker died each of 3 times" in str(found[3].error)


def test_workers_by_name() -> None:
    assert workers_from(None) == workers_from("") == workers_from("1") == InProcess()
    assert workers_from("3") == workers_from(3) == Processes(3)
    assert workers_from("0").count == usable_processors()
    assert workers_from("dask://10.0.0.1:8786") == DaskCluster("tcp://10.0.0.1:8786")
    assert workers_from("ray://head:10001") == RayCluster("ray://head:10001")
    for wrong in ("many", "-2", "dask://nowhere", "http://a:1", "2.5"):
        with pytest.raises(InputError, match=r"dask://host:port"):
            workers_from(wrong)


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_told() -> None:
    locked("distributed", "dask")
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        DaskCluster("tcp://127.0.0.1:1").map(square, ITEMS)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with two_workers(tmp_path) as started:
        yield started


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_dask_cluster_gives_the_same_though_a_worker_is_killed(cluster: Cluster) -> None:
    workers = workers_from(cluster.name)
    assert workers.count == 2
    found, places = [], set()
    for outcome in workers.ordered(slow_square, ITEMS):
        value, place = outcome.get()
        found.append(value)
        places.add(place)
        if len(found) == 4:
            cluster.workers[0].kill()
    assert found == [x * x for x in ITEMS]
    assert cluster.workers[1].pid in places
    assert len(places) == 2
    assert workers.map(math.sqrt, ITEMS) == [math.sqrt(x) for x in ITEMS]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_cluster_may_lose_all_workers_and_what_was_sent_to_them(cluster: Cluster) -> None:
    workers = workers_from(cluster.name)
    found = []
    for outcome in workers.ordered(slow_square, ITEMS):
        found.append(outcome.get()[0])
        if len(found) == 3:
            for process in cluster.workers:
                process.kill()
            cluster.more(2)
    assert found == [x * x for x in ITEMS]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_is_lost_costs_what_is_not_done_and_nothing_hangs(
    cluster: Cluster,
) -> None:
    found = []
    for outcome in workers_from(cluster.name).ordered(slow_square, ITEMS):
        found.append(outcome)
        if len(found) == 3:
            cluster.processes[0].kill()
    assert len(found) == len(ITEMS)
    assert [outcome.get()[0] for outcome in found[:3]] == [x * x for x in ITEMS[:3]]
    lost = found[-1].error
    assert lost is not None
    assert lost.exit_status == 3
    assert "the workers are lost" in str(lost)


@pytest.fixture
def in_ray() -> Iterator[Workers]:
    """Two workers of a Ray cluster on this machine, which takes some seconds to start."""
    reason = "Ray is not among the locked packages (214 MB): pip install ray"
    ray = pytest.importorskip("ray", reason=reason)
    there = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    also = {"env_vars": {"PYTHONPATH": there}}
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, runtime_env=also)
    try:
        yield RayCluster("the one that runs")
    finally:
        ray.shutdown()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_ray_gives_the_same_and_an_error_costs_its_own_item(
    in_ray: Workers, tmp_path: Path
) -> None:
    assert in_ray.count == 2
    assert in_ray.map(math.sqrt, ITEMS) == [math.sqrt(x) for x in ITEMS]
    told = tmp_path / "arrivals"
    assert in_ray.map(Shared(str(told)), ITEMS) == [x * x for x in ITEMS]
    places = told.read_text().split()
    assert 1 <= len(places) == len(set(places)) <= 2
    found = list(in_ray.ordered(fails_on_three, range(6)))
    assert [outcome.value for outcome in found] == [0, 1, 2, None, 4, 5]
    assert str(found[3].error) == "ValueError: three is not a good"
