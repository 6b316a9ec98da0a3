"""Proposed priorities and offsets: optimal where that is known, never worse, by exhaustion."""

from dataclasses import replace
from functools import partial
from itertools import permutations

import numpy as np
import pytest

from canroll.errors import VerdictError
from plant_sim.can_bus.bounds.analysis import response_bounds
from plant_sim.can_bus.bounds.proposals import propose_offsets, propose_priorities
from plant_sim.can_bus.bounds.sensitivity import late
from plant_sim.can_bus.traffic.messages import BusMessage
from plant_sim.can_bus.wire.frame import EXTENDED
from tests.support.simulated_set import simulated_responses

MS = 1_000_000
BITRATE = 125_000


def bounds_at(messages, errors, *, offsets=False):
    return response_bounds(messages, bitrate=BITRATE, errors=errors, offsets=offsets)


def random_set(rng, count):
    """Deadlines that some orders keep and others don't."""
    return [
        BusMessage(
            f"m{i}",
            int(0x100 + 0x10 * i),
            int(rng.integers(0, 9)),
            float(rng.integers(4, 15)) * MS,
            f"n{i}",
            jitter_ns=int(rng.integers(0, 2 * MS)),
            deadline_ns=int(rng.integers(2 * MS, 9 * MS)),
        )
        for i in range(count)
    ]


def test_priorities_are_found_where_there_are_any_and_only_there():
    """Against all 120 orders of five messages."""
    rng = np.random.default_rng(3)
    found = none = 0
    for _ in range(25):
        messages = random_set(rng, 5)
        idents = [m.ident for m in messages]
        feasible = any(
            not late(
                bounds_at([replace(m, ident=i) for m, i in zip(messages, order, strict=True)], None)
            )
            for order in permutations(idents)
        )
        if feasible:
            answer = propose_priorities(messages, bounds_at)
            assert late(answer.bounds) == []
            assert sorted(m.ident for m in answer.messages) == idents
            assert [m.name for m in answer.messages] == [m.name for m in messages]
            found += 1
        else:
            with pytest.raises(VerdictError, match="no priorities meet all deadlines"):
                propose_priorities(messages, bounds_at)
            none += 1
    assert min(found, none) >= 4


def test_priorities_that_hold_are_left_as_they_are():
    messages = [BusMessage(f"m{i}", 5 * i + 1, 8, (10 + 5 * i) * 1.0 * MS, "n") for i in range(5)]
    assert propose_priorities(messages, bounds_at).messages == tuple(messages)


def test_identifiers_of_29_bits_stay_with_messages_of_29_bits():
    messages = [
        BusMessage("slow", 0x1, 8, 90.0 * MS, "a"),
        BusMessage("wide", 0x8 << 18, 8, 90.0 * MS, "b", flags=EXTENDED),
        BusMessage("fast", 0x100, 8, 20.0 * MS, "c", deadline_ns=int(2.5 * MS)),
        BusMessage("wider", 0x9 << 18, 8, 90.0 * MS, "d", flags=EXTENDED),
    ]
    answer = propose_priorities(messages, bounds_at)
    assert [m.ident for m in answer.messages] == [0x100, 0x8 << 18, 0x1, 0x9 << 18]


def test_proposed_offsets_shorten_bounds_that_the_simulator_keeps_to():
    rng = np.random.default_rng(5)
    for number in range(10):
        messages = [
            BusMessage(f"m{i}", 0x100 + i, 8, float(rng.choice([50, 100, 200])) * MS, f"n{i % 2}")
            for i in range(12)
        ]
        spread = propose_offsets(messages, partial(bounds_at, offsets=True))
        assert [(m.ident, m.period_ns) for m in spread.messages] == [
            (m.ident, m.period_ns) for m in messages
        ]
        before = bounds_at(messages, None, offsets=True)
        after = {b.message.name: b.bound_ns for b in spread.bounds}
        assert max(after.values()) < 0.6 * max(b.bound_ns for b in before)
        seen = simulated_responses(spread.messages, bitrate=BITRATE, duration_s=1.0, seed=number)
        for name, bound in after.items():
            assert seen[name].max() <= bound
