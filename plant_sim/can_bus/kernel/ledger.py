# ruff: noqa: PLR0917
"""The outcome of every frame, recorded in the log, the totals and its message."""

from dataclasses import dataclass

import numpy as np

from canroll.plant_sim.can_bus.kernel import layout
from canroll.plant_sim.can_bus.kernel.layout import (
    DELIVERED,
    FREE_FRAME,
    LOG_PLACE,
    LOG_SIZE,
    LOGGED,
    REFUSED,
    SUPERSEDED,
    Network,
    State,
)
from canroll.plant_sim.kernels.jit import njit


@njit
def took(outcome: int, missed: int, node: int) -> bool:
    """Return whether ``node`` received the frame of a log entry."""
    return (outcome in (DELIVERED, REFUSED)) and missed != node


@njit
def finish(
    bus: State,
    slot: int,
    outcome: int,
    t_start: int,
    t_received: int,
    t_end: int,
    missed: int = -1,
) -> None:
    """Log the final outcome of a frame, count it, and free its slot."""
    write_log(bus, slot, outcome, t_start, t_received, t_end, missed)
    frame = bus.frames[slot]
    message = bus.messages[frame.message]
    message.attempts += frame.attempts
    if outcome == DELIVERED:
        message.delivered += 1
        response = t_end - frame.t_queued
        message.response_sum += response
        message.response_min = min(message.response_min, response)
        message.response_max = max(message.response_max, response)
    elif outcome == SUPERSEDED:
        message.superseded += 1
    else:
        message.lost += 1
    frame.next = bus.clock[FREE_FRAME]
    bus.clock[FREE_FRAME] = slot


@njit
def write_log(
    bus: State,
    slot: int,
    outcome: int,
    t_start: int,
    t_received: int,
    t_end: int,
    missed: int = -1,
) -> None:
    """Append an outcome to the ring log and to the segment's totals."""
    frame = bus.frames[slot]
    segment = bus.nodes[frame.node].segment
    bus.totals[segment, outcome] += 1
    clock = bus.clock
    total = clock[LOGGED]
    place = clock[LOG_PLACE]
    clock[LOG_PLACE] = place + 1 if place + 1 < clock[LOG_SIZE] else 0
    entry = bus.log[place]
    entry.t_origin = frame.t_origin
    entry.t_queued = frame.t_queued
    entry.t_start = t_start
    entry.t_received = t_received
    entry.t_end = t_end
    entry.ident = frame.ident
    entry.sender = frame.node
    entry.segment = segment
    entry.flags = frame.flags
    entry.length = frame.length
    entry.outcome = outcome
    entry.attempts = frame.attempts
    entry.missed = missed
    stored = bus.payloads[slot]
    for index in range(frame.length):
        entry.payload[index] = stored[index]
    for index in range(frame.length, 8):
        entry.payload[index] = 0
    clock[LOGGED] = total + 1


def drain(network: Network, cursor: int) -> tuple[np.ndarray, int, int]:
    """Return the log entries from number ``cursor`` on, the next cursor, and the number missed.

    Entries are missed if more were written since ``cursor`` than the ring holds.
    """
    total = int(network.clock[layout.LOGGED])
    size = len(network.log)
    first = max(cursor, total - size)
    # at most two pieces of the ring, copied as such: entry by entry takes several times as long
    start, end = first % size, first % size + total - first
    entries = np.concatenate((network.log[start:end], network.log[: max(end - size, 0)]))
    return entries, total, first - cursor


@dataclass(frozen=True, slots=True)
class Account:
    """Number of frames of one segment by outcome; ``offered``: all that were queued."""

    offered: int
    outcomes: dict[str, int]
    waiting: int

    @property
    def balanced(self) -> bool:
        """Whether every frame is accounted for."""
        return self.offered == sum(self.outcomes.values()) + self.waiting


def account(network: Network, segment: int) -> Account:
    """Return the account of every frame that was queued on ``segment``."""
    on_segment = network.nodes["segment"] == segment
    totals = network.totals[segment]
    outcomes = {
        name: int(totals[code])
        for code, name in enumerate(layout.OUTCOMES)
        if code not in (layout.ERROR, layout.REFUSED)
    }
    waiting = int(network.nodes["pending"][on_segment].sum())
    return Account(int(totals[layout.OFFERED]), outcomes, waiting)


def load(network: Network, segment: int) -> float:
    """Return the load of ``segment`` up to now, 0 to 1, interframe spaces included."""
    now = int(network.clock[layout.NOW])
    return int(network.segments["busy_ns"][segment]) / now if now else 0.0
