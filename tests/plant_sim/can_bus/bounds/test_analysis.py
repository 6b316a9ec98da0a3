"""Worst-case response times: the published counter-example, and bounds against simulation."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.plant_sim.can_bus import DELIVERED, ERROR, REFUSED
from canroll.plant_sim.can_bus.bounds.analysis import (
    ErrorModel,
    response_bounds,
    worst_case_utilisation,
)
from canroll.plant_sim.can_bus.kernel.ledger import drain
from canroll.plant_sim.can_bus.kernel.network import (
    BusFault,
    NetworkSpec,
    Node,
    Segment,
    Source,
    build_network,
)
from canroll.plant_sim.can_bus.kernel.scheduler import advance
from canroll.plant_sim.can_bus.simulation.response_times import traffic_spec
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, arbitration_key, worst_case_bits
from tests.support.simulated_set import simulated_responses

MS = 1_000_000


def counter_example():
    """Davis et al. 2007, table 2: three frames of 1 ms at 125 kbit/s."""
    return [
        BusMessage(name, ident, 0, period, name, bits=125)
        for name, ident, period in (
            ("A", 1, 2_500_000),
            ("B", 2, 3_500_000),
            ("C", 3, 3_500_000),
        )
    ]


def test_the_counter_example_of_2007():
    """The analysis of 1994, which looks at the first instance alone, allows C only 3 ms."""
    bounds = response_bounds(counter_example(), bitrate=125_000)
    assert [b.bound_ns for b in bounds] == [2_000_000, 3_000_000, 3_500_000]


def test_the_simulator_reaches_the_counter_example_exactly():
    seen = simulated_responses(counter_example(), bitrate=125_000, duration_s=1.0)
    assert seen["C"].max() == 3_500_000


def test_no_bound_where_the_bus_is_overloaded():
    messages = [BusMessage(f"m{i}", i, 8, 1 * MS, "n") for i in range(5)]
    bounds = response_bounds(messages, bitrate=500_000)
    assert [b.bound_ns is None for b in bounds] == [False, False, False, True, True]
    assert "overloaded" in bounds[-1].reason


def test_a_fifo_queue_is_as_urgent_as_its_least_message_by_hand():
    """Frames of 270 µs at 500 kbit/s: the urgent one waits behind its neighbour in the queue."""
    messages = [
        BusMessage("urgent", 1, 8, 10 * MS, "x", fifo=True),
        BusMessage("other", 2, 8, 10 * MS, "y"),
        BusMessage("late", 3, 8, 10 * MS, "x"),
        BusMessage("last", 4, 8, 10 * MS, "z"),
    ]
    bounds = {b.message.name: b.bound_ns for b in response_bounds(messages, bitrate=500_000)}
    # blocked by last, behind late in the queue, with other between
    assert bounds["urgent"] == bounds["late"] == 4 * 270_000
    # blocked by late, behind urgent, which may have waited so long that it meets the next one
    assert bounds["other"] == 3 * 270_000
    priority = [replace(m, fifo=False) for m in messages]
    assert response_bounds(priority, bitrate=500_000)[0].bound_ns == 2 * 270_000


def test_offsets_keep_the_messages_of_a_node_apart_by_hand():
    """Four frames of a node, 2.5 ms apart: another node's waits for one of them, not for four."""
    own = [BusMessage(f"m{i}", i, 8, 10.0 * MS, "x", offset_ns=int(i * 2.5 * MS)) for i in range(4)]
    messages = [*own, BusMessage("victim", 9, 8, 10.0 * MS, "y")]
    together = response_bounds(messages, bitrate=500_000)[-1]
    apart = response_bounds(messages, bitrate=500_000, offsets=True)[-1]
    assert together.bound_ns == 5 * 270_000
    assert apart.bound_ns == 2 * 270_000
    jittery = [replace(m, jitter_ns=int(2.4 * MS)) for m in own]
    bound = response_bounds([*jittery, messages[-1]], bitrate=500_000, offsets=True)[-1]
    assert bound.bound_ns == 3 * 270_000


def test_simulated_offsets_keep_to_their_bounds_and_these_to_the_plain_ones():
    rng = np.random.default_rng(12)
    tighter = 0
    for number in range(80):
        messages, bitrate = random_set(rng)
        periods = [float(rng.choice([5, 10, 20, 40])) * MS * 4 for _ in messages]
        messages = [
            replace(
                m,
                sender=f"n{i % 3}",
                period_ns=period,
                jitter_ns=min(m.jitter_ns, int(period / 4)),
                offset_ns=int(rng.integers(period)),
            )
            for i, (m, period) in enumerate(zip(messages, periods, strict=True))
        ]
        plain = response_bounds(messages, bitrate=bitrate)
        bounds = response_bounds(messages, bitrate=bitrate, offsets=True)
        seen = simulated_responses(
            messages, bitrate=bitrate, duration_s=0.7, seed=number, worst_case_lengths=True
        )
        for bound, other in zip(bounds, plain, strict=True):
            responses = seen[bound.message.name]
            assert bound.bound_ns <= other.bound_ns
            assert responses.max() <= bound.queued_ns
            tighter += bound.bound_ns < other.bound_ns
    assert tighter > 50


def test_errors_lengthen_the_bound_and_simulated_errors_keep_to_it():
    messages = [BusMessage(f"m{i}", i, 8, (5 + i) * MS, f"n{i}") for i in range(6)]
    plain = response_bounds(messages, bitrate=500_000)
    disturbed = response_bounds(messages, bitrate=500_000, errors=ErrorModel(20 * MS))
    assert all(d.bound_ns > p.bound_ns for d, p in zip(disturbed, plain, strict=True))
    # the error model by hand for the most urgent message: blocking, one error, itself
    longest = 270_000 + 31 * 2000
    assert disturbed[0].bound_ns == 270_000 + longest + 270_000


def test_disturbed_frames_keep_to_the_bound_of_their_error_model():
    rng = np.random.default_rng(8)
    interval = 25 * MS
    for number in range(40):
        messages, bitrate = random_set(rng)
        errors = ErrorModel(interval)
        bounds = response_bounds(messages, bitrate=bitrate, errors=errors)
        times = np.cumsum(rng.integers(interval, 2 * interval, size=20))
        spec = traffic_spec(messages, bitrate=bitrate, seed=number)
        kinds = (
            {"kind": "disturb", "value": int(rng.integers(1, 120))},
            {"kind": "refuse", "target": "Listener"},
        )
        faults = tuple(
            BusFault(**kinds[i % 2], from_ns=int(t), count=1) for i, t in enumerate(times)
        )
        network = build_network(replace(spec, faults=faults))
        advance(network, 10**9)
        entries, _, missed = drain(network, 0)
        assert missed == 0
        assert (entries["outcome"] == ERROR).sum() >= 5
        assert (entries["outcome"] == REFUSED).sum() >= 5
        for node, bound in enumerate(bounds):
            mine = entries[(entries["sender"] == node) & (entries["outcome"] == DELIVERED)]
            response = mine["t_end"] - mine["t_queued"]
            assert bound.bound_ns is None or len(mine) == 0 or response.max() <= bound.bound_ns


def random_set(rng):
    """A message set below 95 % load with periods, jitter and payloads as they come."""
    count = int(rng.integers(2, 12))
    bitrate = int(rng.choice([125_000, 250_000, 500_000]))
    idents = rng.choice(0x7FF, size=count, replace=False)
    messages = []
    for i in range(count):
        flags = EXTENDED if rng.integers(4) == 0 else 0
        ident = int(idents[i]) << 18 | i if flags else int(idents[i])
        length = int(rng.integers(0, 9))
        period = int(rng.integers(2_000, 20_000)) * 1000
        jitter = int(rng.integers(0, period // 2)) if rng.integers(2) else 0
        messages.append(
            BusMessage(f"m{i}", ident, length, period, f"n{i}", jitter_ns=jitter, flags=flags)
        )
    used = worst_case_utilisation(messages, bitrate=bitrate)
    target = rng.uniform(0.3, 0.95)
    scale = max(1.0, used / target)
    return [
        BusMessage(
            m.name,
            m.ident,
            m.length,
            round(m.period_ns * scale / 1000) * 1000.0,
            m.sender,
            jitter_ns=m.jitter_ns,
            flags=m.flags,
        )
        for m in messages
    ], bitrate


def critical_instant(messages, victim, bitrate, bounds):
    """Simulate the instant a bound is made of: the longest lower frame just before, all at once.

    With jitter every more urgent message comes at once after the longest delay, then on time.
    """
    end = int(bounds[victim] * 1.5) + 50 * MS
    start = 1 * MS
    nodes = tuple(Node(m.sender, policy="priority", capacity=4096) for m in messages)
    chosen = messages[victim]
    sources = []
    worst = [worst_case_bits(m.length, m.flags)[0] for m in messages]
    key = arbitration_key(chosen.ident, chosen.flags)
    lower = [i for i, m in enumerate(messages) if arbitration_key(m.ident, m.flags) > key]
    blocker = max(lower, key=lambda i: worst[i], default=None)
    for i, m in enumerate(messages):
        if i in lower and i != blocker:
            continue
        at = start - 1 if i == blocker else start
        period = 10**12 if i == blocker else m.period_ns
        if m.jitter_ns and i != blocker:
            # the first frame as late as can be, the others without delay
            sources.append(
                Source(m.sender, m.ident, m.length, 1e12, at, flags=m.flags, bits=worst[i])
            )
            at = start + int(period) - m.jitter_ns
        sources.append(
            Source(m.sender, m.ident, m.length, period, at, flags=m.flags, bits=worst[i])
        )
    network = build_network(
        NetworkSpec((Segment(bitrate),), (*nodes, Node("listener")), tuple(sources))
    )
    advance(network, end)
    entries, _, _ = drain(network, 0)
    mine = entries[entries["sender"] == victim]
    # nominal releases are a jitter before the first frame and a period apart
    nominal = start - chosen.jitter_ns + np.arange(len(mine)) * chosen.period_ns
    return int((mine["t_end"] - nominal).max())


def check_sets(count, seed, *, critical_every=1):
    rng = np.random.default_rng(seed)
    reached = tried = 0
    for number in range(count):
        messages, bitrate = random_set(rng)
        bounds = [b.bound_ns for b in response_bounds(messages, bitrate=bitrate)]
        assert None not in bounds
        seen = simulated_responses(
            messages, bitrate=bitrate, duration_s=0.2, seed=number, worst_case_lengths=True
        )
        for message, bound in zip(messages, bounds, strict=True):
            responses = seen[message.name]
            assert len(responses) == 0 or responses.max() <= bound
        if number % critical_every == 0:
            victim = int(rng.integers(len(messages)))
            worst = critical_instant(messages, victim, bitrate, bounds)
            bit = 10**9 // bitrate
            assert worst <= bounds[victim]
            tried += 1
            reached += worst >= bounds[victim] - bit
    return reached / tried


def test_simulated_responses_keep_to_their_bounds():
    share = check_sets(60, seed=1)
    assert share > 0.5


@pytest.mark.long
def test_ten_thousand_random_sets_keep_to_their_bounds():
    share = check_sets(10_000, seed=2, critical_every=5)
    assert share > 0.5
