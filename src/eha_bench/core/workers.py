"""Where many of the same run: here, in local processes, on a Dask or a Ray cluster, by joblib.

Everything that is done many times (trials on a simulator, candidates, blind cases, sweeps) goes
through `Workers.outcomes`: the same functions on the same items give the same results wherever they
run. A worker that dies is replaced, and what it was doing is tried again; an item that takes its
worker down again and again is reported as a separate error, and all others are finished.
"""

from __future__ import annotations

import re
import threading
import traceback
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Generic, Protocol, TypeVar

from eha_bench.core.errors import BUG, EhaBenchError, InputError
from eha_bench.core.extras import way_to_install
from eha_bench.core.packed import Packed, pack
from eha_bench.core.processors import usable_processors

Item = TypeVar("Item")
Value = TypeVar("Value")

TRIES = 3
"""How often an item is tried that takes its worker down."""


class WorkError(EhaBenchError):
    """An item could not be done; `exit_status` is that of the error it stands for."""

    def __init__(self, what: str, *, trace: str = "", status: int = 2) -> None:
        super().__init__(what)
        self.trace = trace
        self.exit_status = status  # type: ignore[misc]  # that of the error it stands for


@dataclass(frozen=True)
class ItemOutcome(Generic[Value]):
    """What became of an item: its value, or the error that it ended with.

    Attributes:
        index: place of the item.
        value: what the function returned; None after an error.
        error: one sentence; the trace of an error that is none of ours in `error.trace`.
    """

    index: int
    value: Value | None = None
    error: WorkError | None = None

    def get(self) -> Value:
        """Return the value.

        Raises:
            WorkError: there is none.
        """
        if self.error is not None:
            raise self.error
        value: Value = self.value  # type: ignore[assignment]  # no error: the function's own None
        return value


class Workers(ABC):
    """Somewhere to run a function on many items."""

    @property
    @abstractmethod
    def count(self) -> int:
        """How many items run at a time."""

    @abstractmethod
    def _each(
        self, function: Callable[[Item], Value], numbered: Sequence[tuple[int, Item]]
    ) -> Generator[ItemOutcome[Value], None, None]:
        """Yield outcomes as they come; the error of a worker that died ends it."""

    def outcomes(
        self, function: Callable[[Item], Value], items: Sequence[Item]
    ) -> Generator[ItemOutcome[Value], None, None]:
        """Yield the outcome of each item as it comes, in any order; every item comes once.

        Args:
            function: of one item; what it holds is pickled once and sent once to every worker.
            items: what to do, each picklable.
        """
        waiting = dict(enumerate(items))
        tries = dict.fromkeys(waiting, 0)
        lost = 0
        while waiting:
            # one at a time once a worker has died twice: then it is known which item did it
            alone = lost >= TRIES - 1
            try:
                chosen = list(waiting)[: 2 * self.count if alone else None]
            except EhaBenchError as error:
                yield from _unserved_items(waiting, error)
                return
            for group in [[index] for index in chosen] if alone else [chosen]:
                try:
                    with closing(self._each(function, [(n, waiting[n]) for n in group])) as each:
                        for outcome in each:
                            del waiting[outcome.index]
                            yield outcome
                except Exception as error:
                    if lost and isinstance(error, EhaBenchError):
                        yield from _unserved_items(waiting, error)
                        return
                    if not _is_lost_worker(error):
                        raise
                    lost += 1
                    if alone and group[0] in waiting:
                        tries[group[0]] += 1
                    if group[0] in waiting and tries[group[0]] >= TRIES:
                        del waiting[group[0]]
                        reason = f"its worker died each of {TRIES} times ({type(error).__name__})"
                        yield ItemOutcome(group[0], error=WorkError(reason, status=3))
            if alone and not set(chosen) & set(waiting):
                lost = 0

    def ordered(
        self, function: Callable[[Item], Value], items: Sequence[Item]
    ) -> Generator[ItemOutcome[Value], None, None]:
        """Yield the outcomes in the order of the items, each as soon as all before it are there."""
        early: dict[int, ItemOutcome[Value]] = {}
        expected = 0
        with closing(self.outcomes(function, items)) as outcomes:
            for outcome in outcomes:
                early[outcome.index] = outcome
                while expected in early:
                    yield early.pop(expected)
                    expected += 1

    def map(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """Return the values in the order of the items.

        Raises:
            WorkError: an item could not be done; all others were.
        """
        return [outcome.get() for outcome in list(self.ordered(function, items))]


def _outcome_of(
    function: Callable[[], Callable[[Item], Value]], index: int, item: Item
) -> ItemOutcome[Value]:
    """Return an item's outcome; errors travel as text, as not all of them can be pickled."""
    try:
        return ItemOutcome(index, function()(item))
    except EhaBenchError as error:
        return ItemOutcome(index, error=WorkError(str(error), status=error.exit_status))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return ItemOutcome(index, error=WorkError(reason, trace=traceback.format_exc(), status=BUG))


_LOST = {
    "TerminatedWorkerError", "BrokenProcessPool",  # loky
    "KilledWorker", "FutureCancelledError",  # Dask; the second where what was sent is lost, too
    "RayActorError", "WorkerCrashedError",  # Ray
}  # fmt: skip


def _is_lost_worker(error: Exception) -> bool:
    return any(kind.__name__ in _LOST for kind in type(error).__mro__)


def _unserved_items(waiting: Iterable[int], error: EhaBenchError) -> Iterator[ItemOutcome[Any]]:
    """Yield what becomes of items that no worker can do any more."""
    what = f"the workers are lost, and cannot be reached again: {error.what}"
    for index in waiting:
        yield ItemOutcome(index, error=WorkError(what, status=3))


@dataclass(frozen=True)
class InProcess(Workers):
    """This process, one item after the other."""

    @property
    def count(self) -> int:
        """One."""
        return 1

    def _each(
        self, function: Callable[[Item], Value], numbered: Sequence[tuple[int, Item]]
    ) -> Generator[ItemOutcome[Value], None, None]:
        for index, item in numbered:
            yield _outcome_of(lambda: function, index, item)


IN_PROCESS: Final = InProcess()
"""One after the other in this process, which is what happens where nothing else is asked for."""


class SentFunction(Protocol):
    """What stands for a function where it was sent to."""

    def unpacked(self) -> Callable[[Any], Any]:
        """Return the function."""
        ...


class _Joblib(Workers):
    """Other processes, by one of joblib's backends."""

    _returns_one_by_one: ClassVar[bool] = True

    @abstractmethod
    def _backend(self, function: Packed) -> AbstractContextManager[SentFunction]:
        """Enter the backend, and send there what all items share."""

    def _each(
        self, function: Callable[[Item], Value], numbered: Sequence[tuple[int, Item]]
    ) -> Generator[ItemOutcome[Value], None, None]:
        from joblib import Parallel, delayed

        with self._backend(pack(function)) as sent:
            calls = (delayed(_outcome_there)(sent, index, item) for index, item in numbered)
            if not self._returns_one_by_one:
                yield from Parallel()(calls)
                return
            # one item a batch, and few ahead: what dies takes little with it
            outcomes = Parallel(
                return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs"
            )(calls)
            try:
                for outcome in outcomes:  # noqa: UP028 - `yield from` would close it, and warn
                    yield outcome
            finally:
                with warnings.catch_warnings(), _stopping():
                    # whoever leaves early knows that there was more
                    warnings.simplefilter("ignore", UserWarning)
                    outcomes.close()


@contextmanager
def _stopping() -> Iterator[None]:
    """A context in which the thread that hands items to loky's processes may end in a KeyError.

    Stopped between two items, it looks for one that has been taken from it; its traceback would be
    all that is seen of a stop that went well.
    """
    before = threading.excepthook

    def tell(args: threading.ExceptHookArgs) -> None:
        of_loky = args.thread is not None and args.thread.name == "ExecutorManagerThread"
        if not (of_loky and args.exc_type is KeyError):
            before(args)

    threading.excepthook = tell
    try:
        yield
    finally:
        threading.excepthook = before


def _outcome_there(function: SentFunction, index: int, item: Item) -> ItemOutcome[Any]:
    return _outcome_of(function.unpacked, index, item)


@dataclass(frozen=True)
class Processes(_Joblib):
    """Processes on this machine."""

    processes: int

    @property
    def count(self) -> int:
        """The processes."""
        return self.processes

    @contextmanager
    def _backend(self, function: Packed) -> Iterator[SentFunction]:
        from joblib import parallel_config

        # never one: joblib would run it in this process, which a bad item could take down
        count = max(2, self.processes)
        with parallel_config(backend="loky", n_jobs=count, inner_max_num_threads=1):
            yield function


_CLIENTS: dict[str, Any] = {}
_PATIENCE = 10.0
"""Time for a scheduler to answer, s."""


@dataclass(frozen=True)
class DaskCluster(_Joblib):
    """Workers of a Dask cluster; its scheduler tries what a dead worker did on another one."""

    address: str

    @property
    def count(self) -> int:
        """Threads of all workers that are there now."""
        threads: dict[str, int] = self._client().nthreads()
        return max(1, sum(threads.values()))

    def _client(self) -> Any:
        try:
            import distributed
        except ImportError as error:
            raise InputError(
                "--workers dask://... needs Dask", hint=way_to_install("dask")
            ) from error
        client = _CLIENTS.get(self.address)
        if client is not None and client.status == "running":
            return client
        connect: Any = distributed.Client
        try:
            _CLIENTS[self.address] = connect(self.address, timeout=_PATIENCE, set_as_default=False)
        except OSError as error:
            raise InputError(
                f"no Dask scheduler answers at {self.address}",
                hint="start one with `dask scheduler`, and workers with `dask worker`",
            ) from error
        return _CLIENTS[self.address]

    @contextmanager
    def _backend(self, function: Packed) -> Iterator[SentFunction]:
        from joblib import parallel_config

        # to all workers: one that dies does not take the only copy with it
        with parallel_config(backend="dask", client=self._client(), n_jobs=-1, scatter=[function]):
            yield function


@dataclass(frozen=True)
class RayCluster(_Joblib):
    """Workers of a Ray cluster."""

    address: str
    _returns_one_by_one: ClassVar[bool] = False

    @property
    def count(self) -> int:
        """Processors of the cluster."""
        self._connect()
        import ray

        return max(1, int(ray.cluster_resources().get("CPU", 1)))

    def _connect(self) -> None:
        try:
            import ray
            from ray.util.joblib import register_ray
        except ImportError as error:
            raise InputError("--workers ray://... needs Ray", hint="pip install ray") from error
        if not ray.is_initialized():
            try:
                ray.init(address=self.address, log_to_driver=False)
            except Exception as error:  # Ray raises errors of many kinds, some of many lines
                reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
                raise InputError(f"no Ray cluster answers at {self.address} ({reason})") from error
        register_ray()

    @contextmanager
    def _backend(self, function: Packed) -> Iterator[SentFunction]:
        self._connect()
        import ray
        from joblib import parallel_config

        with parallel_config(backend="ray", n_jobs=-1):
            yield _InRay(ray.put(function))


@dataclass(frozen=True)
class _InRay:
    """A function in Ray's store, of which each machine keeps a copy."""

    reference: Any

    def unpacked(self) -> Callable[[Any], Any]:
        import ray

        function: Packed = ray.get(self.reference)
        return function.unpacked()


_CLUSTER = re.compile(r"(dask|ray)://([^/\s]+:\d+)/?")


def workers_from(text: str | int | None) -> Workers:
    """Return the workers that `--workers` names.

    Args:
        text: a number of processes (0: one a processor), `dask://host:port`, `ray://host:port`;
            nothing: this process.

    Raises:
        InputError: none of these.
    """
    if text is None or text == "":
        return IN_PROCESS
    if str(text).isdecimal():
        count = int(text) or usable_processors()
        return Processes(count) if count > 1 else IN_PROCESS
    match = _CLUSTER.fullmatch(str(text))
    if match is None:
        raise InputError(
            f"--workers '{text}' is not understood",
            hint="give a number of processes, dask://host:port or ray://host:port",
        )
    return DaskCluster(f"tcp://{match[2]}") if match[1] == "dask" else RayCluster(str(text))
