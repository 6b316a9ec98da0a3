"""How much load, and how many errors, until a deadline falls."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from plant_sim.can_bus import DELIVERED, advance, build_network, drain
from plant_sim.can_bus.bounds.analysis import ErrorModel, response_bounds
from plant_sim.can_bus.bounds.sensitivity import breakdown, error_tolerance, late
from plant_sim.can_bus.simulation.response_times import traffic_spec
from plant_sim.can_bus.traffic.messages import BusMessage

MS = 1_000_000
BITRATE = 500_000


def bounds_at(messages, errors):
    return response_bounds(messages, bitrate=BITRATE, errors=errors)


def a_set(count=10, *, deadline=0):
    return [
        BusMessage(f"m{i}", i + 1, 8, (5.0 + i) * MS, f"n{i}", deadline_ns=deadline)
        for i in range(count)
    ]


def test_a_single_message_can_fill_the_bus():
    only = [BusMessage("a", 1, 8, 10.0 * MS, "a", deadline_ns=MS)]
    found = breakdown(only, bounds_at, bitrate=BITRATE)
    assert found.utilisation == pytest.approx(1.0, abs=2e-3)
    assert found.factor == pytest.approx(10 / 0.27, rel=2e-3)


def test_the_deadline_that_falls_first_is_named_just_above_the_factor():
    messages = a_set()
    messages[6] = replace(messages[6], deadline_ns=int(2.5 * MS))
    found = breakdown(messages, bounds_at, bitrate=BITRATE)
    assert found.first == ("m6",)

    def faster(factor):
        return [
            replace(m, period_ns=float(round(m.period_ns / factor)), deadline_ns=m.due_ns)
            for m in messages
        ]

    assert late(bounds_at(faster(found.factor), None)) == []
    assert late(bounds_at(faster(found.factor * 1.002), None)) == ["m6"]


def test_a_deadline_that_has_fallen_gives_a_factor_below_one():
    messages = a_set(deadline=int(1.0 * MS))
    assert late(bounds_at(messages, None))
    assert breakdown(messages, bounds_at, bitrate=BITRATE).factor < 0.01
    near = a_set(deadline=int(3.1 * MS))
    assert breakdown(near, bounds_at, bitrate=BITRATE).factor > 0.1


def test_the_errors_that_a_message_survives_by_hand():
    """Alone: itself 270 µs, each error 270 + 62 µs more, at a deadline of 1 ms: two of them."""
    only = [BusMessage("a", 1, 8, 10.0 * MS, "a", deadline_ns=MS)]
    (found,) = error_tolerance(only, bounds_at, errors_per_s=20.0)
    assert found.errors == 2
    assert found.probability == pytest.approx(stats.poisson.sf(2, 20.0 * 1e-3))
    (missed,) = error_tolerance(
        [replace(only[0], deadline_ns=200_000)], bounds_at, errors_per_s=20.0
    )
    assert (missed.errors, missed.probability) == (-1, 1.0)


def test_more_errors_and_shorter_deadlines_are_never_less_probable_to_miss():
    shares = [
        [f.probability for f in error_tolerance(a_set(deadline=d), bounds_at, errors_per_s=rate)]
        for d, rate in ((6 * MS, 5.0), (6 * MS, 50.0), (4 * MS, 50.0))
    ]
    for less, more in pairwise(shares):
        assert all(a <= b for a, b in zip(less, more, strict=True))
    assert all(0.0 <= p <= 1.0 for p in np.ravel(shares))


def test_simulated_bit_errors_miss_deadlines_no_more_often_than_bounded():
    """Bits disturbed at random, 300 a second; deadlines that one or two errors exceed."""
    messages = [replace(m, deadline_ns=540_000 + 270_000 * i) for i, m in enumerate(a_set(6))]
    network = build_network(traffic_spec(messages, bitrate=BITRATE, seed=1))
    network.segments["bit_error_rate"] = 6e-4
    sent, missed, cursor = {}, {}, 0
    for now in range(100, 120_001, 100):
        advance(network, now * MS)
        entries, cursor, _ = drain(network, cursor)
        done = entries[entries["outcome"] == DELIVERED]
        for message in messages:
            own = done[done["ident"] == message.ident]
            response = own["t_end"] - own["t_queued"]
            sent[message.name] = sent.get(message.name, 0) + len(own)
            count = int((response > message.due_ns).sum())
            missed[message.name] = missed.get(message.name, 0) + count
    assert sum(missed.values()) > 20
    for found in error_tolerance(messages, bounds_at, errors_per_s=6e-4 * BITRATE):
        name = found.message.name
        # three standard deviations of what was counted
        spread = 3.0 * np.sqrt(max(missed[name], 1))
        assert missed[name] - spread <= found.probability * sent[name]


def test_an_error_model_of_a_burst_is_what_the_tolerance_counts():
    messages = a_set(deadline=4 * MS)
    for found in error_tolerance(messages, bounds_at, errors_per_s=1.0):
        place = messages.index(found.message)
        for count, holds in ((found.errors, True), (found.errors + 1, False)):
            model = ErrorModel(1 << 60, count) if count else None
            assert (late([bounds_at(messages, model)[place]]) == []) == holds
