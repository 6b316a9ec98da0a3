"""Where cases are driven: this process, processes of this machine, or a Dask cluster."""

import pickle
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from multiprocessing.context import ForkServerContext, ForkServerProcess
from multiprocessing.process import BaseProcess
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any, TypeVar

from canroll.cases.store import Store
from canroll.errors import CanrollError, VerdictError, optional, reason

LOCAL = "local"
AHEAD = 2
"""Tasks in work or waiting for a process, for each process."""
RETRIES = 3
"""How often Dask repeats a task whose worker died."""
PATIENCE_S = 10
"""How long a Dask scheduler may take to answer."""

T = TypeVar("T")
Task = tuple[str, Callable[..., T], tuple[Any, ...]]
"""Name of a row in the store, function that returns it, and arguments."""


@dataclass(frozen=True, slots=True)
class Engine:
    """What drives tasks. ``executor`` None: this process does, one after the other.

    ``common`` makes of a value an argument of many tasks that is sent to a process once.
    """

    executor: Executor | None = None
    slots: int = 1
    common: Callable[[Any], Any] = lambda value: value

    def submit(self, work: Callable[..., T], *arguments: Any) -> "Future[T]":  # noqa: ANN401
        """Start work and return its future result."""
        done: Future[T] = Future()
        try:
            if self.executor is not None:
                return self.executor.submit(_driven, work, *arguments)
            done.set_result(work(*arguments))
        except (CanrollError, BrokenProcessPool) as error:
            done.set_exception(error)
        return done


HERE = Engine()


@dataclass(frozen=True, slots=True)
class _Common:
    """An argument in a file, read once by a process."""

    path: Path


@lru_cache(maxsize=2)
def _read(path: Path) -> Any:  # noqa: ANN401
    return pickle.loads(path.read_bytes())


def _driven(work: Callable[..., T], *arguments: Any) -> T:  # noqa: ANN401
    """Do work in another process."""
    try:
        return work(
            *(_read(each.path) if isinstance(each, _Common) else each for each in arguments)
        )
    except CanrollError as error:
        # of one argument, unlike some subclasses: it has to travel between processes
        kind = VerdictError if isinstance(error, VerdictError) else CanrollError
        raise kind(str(error)) from None


@contextmanager
def engine(scheduler: str, jobs: int) -> Iterator[Engine]:
    """Return the engine of a scheduler: "local" or the address of a Dask scheduler.

    Raises:
        CanrollError: no scheduler answers there.
        MissingExtraError: distributed is not installed.
    """
    if scheduler != LOCAL:
        with _cluster(scheduler) as cluster:
            yield cluster
        return
    if jobs == 1:
        yield HERE
        return
    # workers are forked from a process that has everything imported and no threads
    context = _Context()
    context.set_forkserver_preload(["canroll.runs.experiment"])
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_undisturbed)
    with TemporaryDirectory(prefix="canroll-") as folder:

        def common(value: object) -> _Common:
            path = Path(folder, token_hex(8))
            path.write_bytes(pickle.dumps(value))
            return _Common(path)

        for _ in range(jobs):
            # processes start while cases are planned
            pool.submit(int)
        try:
            yield Engine(pool, jobs, common)
        finally:
            pool.shutdown(cancel_futures=True)


class _Worker(ForkServerProcess):
    """A process that does not begin with the user's script, which it needs nothing of.

    As a rule a script has no main guard: each process would do all over again what it does.
    """

    @staticmethod
    def _Popen(process: BaseProcess) -> Any:  # noqa: ANN401, N802 - a method of the base
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return ForkServerProcess._Popen(process)
        finally:
            sys.modules["__main__"] = script


class _Context(ForkServerContext):
    Process = _Worker


def _undisturbed() -> None:
    """Leave Ctrl-C to the parent, which keeps the tasks in work."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _cluster(address: str) -> Iterator[Engine]:
    distributed = optional("distributed", "--scheduler", "cluster")
    try:
        client = distributed.Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise CanrollError(
            f"--scheduler {address}: no Dask scheduler answers there ({reason(error)}): start one "
            "with 'dask scheduler'"
        ) from error
    with client:
        cores = sum(client.ncores().values())
        if not cores:
            raise CanrollError(
                f"--scheduler {address}: it has no workers: start some with 'dask worker {address}'"
            )
        with client.get_executor(retries=RETRIES, pure=False) as executor:
            # as a task's result it is made again where a worker that holds it dies
            yield Engine(executor, cores, partial(client.submit, _same, pure=False))


def _same(value: T) -> T:
    return value


def results(
    where: Engine, store: Store[T] | None, tasks: Iterable[Task[T]]
) -> Iterator[tuple[str, T, bool]]:
    """Yield name and row of each task in their order, and whether it was there already.

    Tasks are started as results are taken: at most a few for each process wait. A result is written
    as soon as those before it are; on Ctrl-C those in work are finished and written.

    Args:
        where: the engine.
        store: where results are kept, and taken from; None: nowhere.
        tasks: name, function and arguments of each.

    Raises:
        CanrollError: a task failed, or a process died.
    """
    waiting: deque[tuple[str, Future[T] | None]] = deque()
    remaining = iter(tasks)
    try:
        while True:
            while len(waiting) < AHEAD * where.slots or not where.executor:
                task = next(remaining, None)
                if task is None:
                    break
                name, work, arguments = task
                there = store is not None and store.has(name)
                waiting.append((name, None if there else where.submit(work, *arguments)))
                if not where.executor:
                    break
            if not waiting:
                return
            name, future = waiting[0]
            row, kept = _finished(store, name, future)
            waiting.popleft()
            yield name, row, kept
    except KeyboardInterrupt:
        for name, future in waiting:
            if future is not None and not future.cancel():
                _finished(store, name, future)
        raise
    finally:
        for _, future in waiting:
            if future is not None:
                future.cancel()


def _finished(store: Store[T] | None, name: str, future: "Future[T] | None") -> tuple[T, bool]:
    """Return the row of a task, written, and whether it was there already."""
    if future is None:
        assert store is not None
        return store.read(name), True
    try:
        row = future.result()
    except BrokenProcessPool as error:
        raise CanrollError(
            "a process was killed (out of memory?): continue with --resume, and fewer --jobs"
        ) from error
    except Exception as error:
        if type(error).__module__.partition(".")[0] != "distributed":
            raise
        raise CanrollError(
            f"--scheduler: {reason(error)}: fix the cluster and continue with --resume"
        ) from error
    if store is not None:
        store.write(name, row)
    return row, False
