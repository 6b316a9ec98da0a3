"""Where chunks are driven: processes of this machine, or a Dask cluster."""

import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from canroll.errors import CanrollError, optional, reason
from hil.campaign.plan import Columns
from hil.campaign.store import Store

LOCAL = "local"
AHEAD = 2
"""Chunks in work or waiting for a process, for each process."""
RETRIES = 3
"""How often Dask repeats a chunk whose worker died."""
PATIENCE_S = 10
"""How long a Dask scheduler may take to answer."""


@dataclass(frozen=True, slots=True)
class Engine:
    """What drives chunks. ``executor`` None: this process does, one after the other."""

    executor: Executor | None
    slots: int

    def submit(self, work: Callable[..., Columns], *arguments: Any) -> "Future[Columns]":  # noqa: ANN401
        """Start work and return its future result."""
        done: Future[Columns] = Future()
        try:
            if self.executor is not None:
                return self.executor.submit(work, *arguments)
            done.set_result(work(*arguments))
        except (CanrollError, BrokenProcessPool) as error:
            done.set_exception(error)
        return done


@contextmanager
def engine(scheduler: str, jobs: int) -> Iterator[Engine]:
    """Return the engine of a scheduler: "local" or the address of a Dask scheduler.

    Raises:
        CanrollError: no scheduler answers there.
        MissingExtraError: distributed is not installed.
    """
    if scheduler != LOCAL:
        with _cluster(scheduler) as found:
            yield found
        return
    if jobs == 1:
        yield Engine(None, 1)
        return
    # workers are forked from a process that has everything imported and no threads
    context = get_context("forkserver")
    context.set_forkserver_preload(["hil.campaign.plan"])
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_undisturbed)
    try:
        yield Engine(pool, jobs)
    finally:
        pool.shutdown(cancel_futures=True)


def _undisturbed() -> None:
    """Leave Ctrl-C to the parent, which keeps the chunks in work."""
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
            yield Engine(executor, cores)


def results(
    where: Engine,
    store: Store | None,
    tasks: Iterable[tuple[str, Callable[..., Columns], tuple[Any, ...]]],
) -> Iterator[tuple[str, Columns, bool]]:
    """Yield name and columns of each task in their order, and whether they were there already.

    Tasks are started as results are taken: at most a few for each process wait. A result is written
    as soon as those before it are; on Ctrl-C those in work are finished and written.

    Args:
        where: the engine.
        store: where results are kept, and taken from; None: nowhere.
        tasks: name, function and arguments of each.

    Raises:
        CanrollError: a task failed, or a process died.
    """
    waiting: deque[tuple[str, Future[Columns] | None]] = deque()
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
            columns, kept = _finished(store, name, future)
            waiting.popleft()
            yield name, columns, kept
    except KeyboardInterrupt:
        for name, future in waiting:
            if future is not None and not future.cancel():
                _finished(store, name, future)
        raise
    finally:
        for _, future in waiting:
            if future is not None:
                future.cancel()


def _finished(
    store: Store | None, name: str, future: "Future[Columns] | None"
) -> tuple[Columns, bool]:
    """Return the columns of a task, written, and whether they were there already."""
    if future is None:
        assert store is not None
        columns = store.read(name)
        assert columns is not None
        return columns, True
    try:
        columns = future.result()
    except BrokenProcessPool as error:
        raise CanrollError(
            "a process of the campaign was killed (out of memory?): continue with --resume, and "
            "fewer --jobs"
        ) from error
    except Exception as error:
        if type(error).__module__.partition(".")[0] != "distributed":
            raise
        raise CanrollError(
            f"--scheduler: {reason(error)}: mend the cluster and continue with --resume"
        ) from error
    if store is not None:
        store.write(name, columns)
    return columns, False
