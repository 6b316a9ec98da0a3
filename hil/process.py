"""Real-time settings of a process: core, priority, locked memory, no garbage collection."""

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from canroll.errors import reason

ECU_PRIORITY = 60
PLANT_PRIORITY = 50
"""SCHED_FIFO priorities: where both share a core, the ECU goes first."""

_MCL_CURRENT, _MCL_FUTURE = 1, 2
TIMER_SLACK = Path("/proc/self/timerslack_ns")
"""Lateness of this thread's timers; writing 0 sets the default."""


def cores() -> list[int]:
    """Return the cores this process may run on, ascending."""
    if sys.platform == "linux":
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def prepare(*, cpu: int | None, priority: int) -> list[str]:
    """Request real-time settings from the system; return a note on each refusal.

    Args:
        cpu: core to be pinned to; None: not pinned.
        priority: of SCHED_FIFO, 1 to 99.
    """
    if sys.platform != "linux":
        return ["no exclusive core, real-time priority or locked memory: Linux only"]
    notes = []
    if cpu is not None:
        try:
            os.sched_setaffinity(0, {cpu})
        except OSError as error:
            notes.append(f"not pinned to core {cpu}: {reason(error)}")
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        notes.append(f"no real-time priority ({reason(error)}): run as root or 'ulimit -r 99'")
        # timers of ordinary processes are late by 50 us unless they ask for better
        if TIMER_SLACK.exists():
            TIMER_SLACK.write_text("1", encoding="ascii")
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE):
        refusal = os.strerror(ctypes.get_errno())
        notes.append(f"memory not locked ({refusal}): run as root or 'ulimit -l unlimited'")
    return notes


@contextmanager
def prepared(*, cpu: int | None, priority: int) -> Iterator[list[str]]:
    """:func:`prepare` inside; afterwards the process is scheduled as before, and is not locked.

    For a loop in a process that lives on: it and all that it starts would keep the priority.
    """
    if sys.platform != "linux":
        yield prepare(cpu=cpu, priority=priority)
        return
    cores_before = os.sched_getaffinity(0)
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield prepare(cpu=cpu, priority=priority)
    finally:
        os.sched_setscheduler(0, *before)
        os.sched_setaffinity(0, cores_before)
        if TIMER_SLACK.exists():
            TIMER_SLACK.write_text("0", encoding="ascii")
        ctypes.CDLL(None).munlockall()


def paced(pace: str, *, cpu: int | None, priority: int) -> AbstractContextManager[list[str]]:
    """Return :func:`prepared` for pace ``realtime``; in lock step nothing is asked for."""
    if pace == "realtime":
        return prepared(cpu=cpu, priority=priority)
    return nullcontext([])


@contextmanager
def collector_off() -> Iterator[None]:
    """Disable the garbage collector inside, and freeze the objects that exist by then."""
    was_on = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_on:
            gc.enable()


@dataclass(slots=True)
class Stop:
    """Stop request by SIGINT or SIGTERM; a loop checks ``requested`` once per period."""

    requested: bool = False


@contextmanager
def stop_on_signals() -> Iterator[Stop]:
    """Turn SIGINT and SIGTERM into a request to stop."""
    stop = Stop()

    def request(_number: int, _frame: FrameType | None) -> None:
        stop.requested = True

    before = {number: signal.signal(number, request) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
