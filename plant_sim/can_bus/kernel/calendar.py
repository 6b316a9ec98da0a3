# ruff: noqa: PLR0917
"""Calendar of releases: those due soon in a heap, later ones in time slots.

The cost of a single heap would grow with the number of messages. The heap therefore holds only the
releases of the current slot; later ones are kept unsorted in a ring of slots, and those beyond the
ring in a second heap. ``RELEASES`` is the size of the first heap, which is empty only if no release
is scheduled at all. Releases at one instant keep the order in which they were scheduled.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.can_bus.kernel.layout import (
    DISTANT,
    MAX_SOURCES,
    RELEASES,
    RING_SLOTS,
    SEQUENCE,
    SLOT,
    WAITING,
    State,
)
from canroll.plant_sim.kernels.jit import njit

_SHIFT: Final = 17
"""A slot is 2¹⁷ ns, about one frame long."""
_MASK: Final = RING_SLOTS - 1
_WORD: Final = 32


Column = NDArray[np.int64]
"""Of a binary heap on plain arrays: (key, tie) ascending, each with a value."""


@njit
def push(
    keys: Column, ties: Column, values: Column, size: int, key: int, tie: int, value: int
) -> None:
    """Insert one entry into a heap of ``size`` entries; the caller updates the size."""
    child = size
    while child > 0:
        parent = (child - 1) >> 1
        if keys[parent] < key or (keys[parent] == key and ties[parent] <= tie):
            break
        keys[child] = keys[parent]
        ties[child] = ties[parent]
        values[child] = values[parent]
        child = parent
    keys[child] = key
    ties[child] = tie
    values[child] = value


@njit
def pop(keys: Column, ties: Column, values: Column, size: int) -> int:
    """Remove the smallest entry from a heap of ``size`` entries and return its value.

    The gap moves to the bottom along the smaller children, and the last entry is inserted from
    there. The child is selected arithmetically, because a branch would be mispredicted half of the
    time and make large heaps slow.
    """
    result: int = values[0]
    last = size - 1
    gap, child = 0, 1
    while child < last:
        other = min(child + 1, last - 1)
        less = (keys[other] < keys[child]) | (
            (keys[other] == keys[child]) & (ties[other] < ties[child])
        )
        child += int(less)
        keys[gap] = keys[child]
        ties[gap] = ties[child]
        values[gap] = values[child]
        gap = child
        child = 2 * gap + 1
    push(keys, ties, values, gap, keys[last], ties[last], values[last])
    return result


@njit
def schedule(bus: State, t_ns: int, value: int) -> None:
    """Add a release to the calendar: the slot of a frame, or −1 − the number of a source."""
    clock = bus.clock
    tie = clock[SEQUENCE]
    clock[SEQUENCE] = tie + 1
    slot = t_ns >> _SHIFT
    if slot <= clock[SLOT]:
        _due(bus, t_ns, tie, value)
    elif slot - clock[SLOT] < RING_SLOTS:
        place = slot & _MASK
        number = -1 - value if value < 0 else MAX_SOURCES + value
        entry = bus.ring[number]
        entry.t_ns, entry.tie, entry.value = t_ns, tie, value
        entry.next = bus.ring_heads[place]
        bus.ring_heads[place] = number
        bus.ring_filled[place // _WORD] |= 1 << place % _WORD
        clock[WAITING] += 1
    else:
        push(bus.distant_times, bus.distant_ties, bus.distant, clock[DISTANT], t_ns, tie, value)
        clock[DISTANT] += 1
    if clock[RELEASES] == 0:
        _turn(bus)


@njit
def take(bus: State) -> int:
    """Remove and return the earliest release; the calendar is not empty."""
    clock = bus.clock
    value = pop(bus.release_times, bus.release_ties, bus.releases, clock[RELEASES])
    clock[RELEASES] -= 1
    if clock[RELEASES] == 0:
        _turn(bus)
    taken: int = value
    return taken


@njit
def _due(bus: State, t_ns: int, tie: int, value: int) -> None:
    size = bus.clock[RELEASES]
    push(bus.release_times, bus.release_ties, bus.releases, size, t_ns, tie, value)
    bus.clock[RELEASES] = size + 1


@njit
def _turn(bus: State) -> None:
    """Advance to the next slot with a release, if any."""
    clock = bus.clock
    if clock[WAITING] == 0 and clock[DISTANT] == 0:
        return
    slot = clock[SLOT] + RING_SLOTS
    if clock[WAITING] > 0:
        slot = _next_filled(bus, clock[SLOT] + 1)
    if clock[DISTANT] > 0:
        first = bus.distant_times[0] >> _SHIFT
        slot = first if clock[WAITING] == 0 else min(slot, first)
    clock[SLOT] = slot
    place = slot & _MASK
    number = bus.ring_heads[place]
    while number >= 0:
        entry = bus.ring[number]
        _due(bus, entry.t_ns, entry.tie, entry.value)
        clock[WAITING] -= 1
        number = entry.next
    bus.ring_heads[place] = -1
    bus.ring_filled[place // _WORD] &= ~(1 << place % _WORD)
    while clock[DISTANT] > 0 and bus.distant_times[0] >> _SHIFT <= slot:
        t_ns, tie = bus.distant_times[0], bus.distant_ties[0]
        value = pop(bus.distant_times, bus.distant_ties, bus.distant, clock[DISTANT])
        clock[DISTANT] -= 1
        _due(bus, t_ns, tie, value)


@njit
def _next_filled(bus: State, slot: int) -> int:
    """Return the first non-empty slot from ``slot`` on; one must exist."""
    while True:
        bits = bus.ring_filled[(slot & _MASK) // _WORD] >> slot % _WORD
        if bits == 0:
            slot += _WORD - slot % _WORD
            continue
        while bits & 1 == 0:
            bits >>= 1
            slot += 1
        return slot
