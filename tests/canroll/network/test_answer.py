"""The answer of any network: what it judges, and what it prints."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.errors import VerdictError
from canroll.network.answer import Answer, LoopNames, MessageRow, PathDelay, SegmentAnswer, Times
from canroll.network.show import parts
from canroll.plant_sim.can_bus.bounds.analysis import response_bounds
from canroll.plant_sim.can_bus.bounds.delay_bounds import DelayBounds, Path
from canroll.plant_sim.can_bus.traffic.messages import BusMessage

MS = 1_000_000


def row(name, ident=1, *, most_ns=0, arrival_ns=9 * MS, way=("a",), **options):
    (bound,) = response_bounds([BusMessage(name, ident, 8, 10 * MS, **options)], bitrate=500_000)
    times = Times.of(np.array([most_ns], np.int64)) if most_ns else Times()
    return MessageRow(bound, times, way, arrival_ns, Times())


def answer(*segments, delay=None):
    return Answer(
        "net.toml",
        tuple(
            SegmentAnswer(name, 500_000, 0, rows, load=None, frames=0)
            for name, rows in zip("ab", segments, strict=False)
        ),
        LoopNames("Imu", "Command", 10.0),
        delay,
    )


def lines(found):
    return [part for part in parts(found) if isinstance(part, str)]


def test_a_simulated_time_above_its_bound_is_an_error_of_the_analysis():
    limit = row("Imu").bound.bound_ns
    answer([row("Imu", most_ns=limit)]).check()
    with pytest.raises(VerdictError, match=r"^Imu: simulated response .* above its bound"):
        answer([row("Imu", most_ns=limit + 1)]).check()
    forwarded = replace(
        row("Imu", arrival_ns=MS, way=("a", "b")), arrival=Times.of(np.array([MS + 1]))
    )
    with pytest.raises(VerdictError, match=r"^Imu on b: simulated response 1\.000 ms above"):
        answer([], [forwarded]).check()


def test_a_deadline_holds_from_the_first_sender():
    late = answer([row("Doors", arrival_ns=5 * MS, deadline_ns=4 * MS)], [row("Imu")])
    assert late.failed
    assert "deadline missed: Doors on a (5.000 of 4 ms)" in lines(late)
    assert not answer([row("Doors", arrival_ns=4 * MS, deadline_ns=4 * MS)]).failed
    # exceeding the period alone is no missed deadline
    assert not answer([row("Doors", arrival_ns=11 * MS)]).failed


def test_messages_without_a_bound_are_named_by_reason():
    twice = [row("a", 1), row("b", 2), row("c", 3)]
    none = [
        replace(r, bound=replace(r.bound, bound_ns=None, reason=reason, covered=covered))
        for r, reason, covered in zip(twice, ("x", "x", "y"), (True, True, False), strict=True)
    ]
    assert "without a bound, x: a, b" in lines(answer(none))
    assert "without a bound, y: c" in lines(answer(none))
    assert "without a bound, x: all messages" in lines(answer(none[:2]))
    assert answer(none).failed
    # not covered by the analysis: no fault of the network
    assert not answer(none[2:]).failed


def test_the_delay_is_printed_with_what_is_known():
    path = Path(0.001, 0.002)
    bounds = DelayBounds(0.001, 0.030, 0.001, 0.020, path, path)
    age = Times.of(np.array([2 * MS, 12 * MS]))
    start = "Imu to Command at a tick of 10 ms: "
    total = "total delay 1.00 to 30.00 ms, sample-to-force age at most 20.00 ms"
    for delay, text in (
        (PathDelay(bounds, Times()), total),
        (PathDelay(bounds, age), f"{total}, simulated 2.00 to 12.00 ms"),
        (PathDelay(None, Times(), "Imu: x"), "no bound of the delay, Imu: x"),
        (
            PathDelay(None, age, "x"),
            "no bound of the delay, x; sample-to-force age simulated 2.00 to 12.00 ms",
        ),
    ):
        assert lines(answer([row("Imu")], delay=delay))[-1] == start + text
    assert answer([row("Imu")], delay=PathDelay(None, age, "x", failed=True)).failed
