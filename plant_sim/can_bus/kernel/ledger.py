# ruff: noqa: PLR0917
"""The account of every frame: what became of it, in the log, the totals and its message."""

from plant_sim.can_bus.kernel.layout import (
    DELIVERED,
    FREE_FRAME,
    LOG_PLACE,
    LOG_SIZE,
    LOGGED,
    SUPERSEDED,
    State,
)
from plant_sim.kernels.jit import njit


@njit
def finish(bus: State, slot: int, outcome: int, t_start: int, t_received: int, t_end: int) -> None:
    """Log the end of a frame, count it and free its slot."""
    write_log(bus, slot, outcome, t_start, t_received, t_end)
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
    bus: State, slot: int, outcome: int, t_start: int, t_received: int, t_end: int
) -> None:
    """Append what happened to a frame to the ring log and to the segment's totals."""
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
    stored = bus.payloads[slot]
    for index in range(frame.length):
        entry.payload[index] = stored[index]
    for index in range(frame.length, 8):
        entry.payload[index] = 0
    clock[LOGGED] = total + 1
