"""The calendar gives releases back in order of time, and at one time in that of scheduling."""

import heapq

import numpy as np
import pytest

from canroll.plant_sim.can_bus.kernel import layout
from canroll.plant_sim.can_bus.kernel.calendar import schedule, take
from canroll.plant_sim.kernels.jit import njit


@njit
def put(network, t_ns, value):
    schedule(network.state[0], t_ns, value)


@njit
def first(network):
    return take(network.state[0])


@pytest.mark.parametrize("span", [1, 1 << 17, 1 << 25, 1 << 32, 1 << 45])
def test_releases_come_in_the_order_of_time_then_of_scheduling(span):
    """Against a plain heap: times at once, in one slot, over the ring, far beyond it."""
    rng = np.random.default_rng(span % 1000)
    bus = layout.empty(log=16, seed=0)
    reference, now, order = [], 0, 0
    free = list(range(-layout.MAX_SOURCES, layout.MAX_FRAMES))
    rng.shuffle(free)
    taken = 0
    for _ in range(6000):
        if free and (not reference or rng.random() < 0.55):
            value = free.pop()
            # some far ahead, some now, most in between
            due = now + int(rng.integers(0, span + 1)) * int(rng.integers(0, 3))
            put(bus, due, value)
            heapq.heappush(reference, (due, order, value))
            order += 1
        else:
            assert bus.clock[layout.RELEASES] > 0
            assert bus.part("release_times")[0] == reference[0][0]
            due, _, value = heapq.heappop(reference)
            assert first(bus) == value
            now = due
            free.append(value)
            taken += 1
    while reference:
        assert first(bus) == heapq.heappop(reference)[2]
    assert bus.clock[layout.RELEASES] == bus.clock[layout.WAITING] == bus.clock[layout.DISTANT] == 0
    assert taken > 2000


def test_what_is_scheduled_earlier_than_the_slot_reached_still_comes_first():
    bus = layout.empty(log=16, seed=0)
    put(bus, 10**10, 1)
    put(bus, 10**9, 2)
    put(bus, 10**9 - 1, 3)
    assert [first(bus) for _ in range(3)] == [3, 2, 1]
