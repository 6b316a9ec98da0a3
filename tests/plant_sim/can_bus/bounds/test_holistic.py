"""Bounds over gateways: by hand, and above every age of random networks of one to four segments."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from canroll.plant_sim.buses.topology import BusGateway, BusSegment, TimeSpread, Topology
from canroll.plant_sim.can_bus import advance, build_network, drain
from canroll.plant_sim.can_bus.bounds.analysis import (
    OVERLOADED,
    ErrorModel,
    response_bounds,
    worst_case_utilisation,
)
from canroll.plant_sim.can_bus.bounds.delay_bounds import path_of, total_delay
from canroll.plant_sim.can_bus.bounds.holistic import UNLIMITED, arrivals
from canroll.plant_sim.can_bus.network.network_spec import network_spec
from canroll.plant_sim.can_bus.network.routing import Hop, RoutedMessage, RoutedNetwork
from canroll.plant_sim.can_bus.simulation.ages import simulate_ages_of_network
from canroll.plant_sim.can_bus.simulation.response_times import listeners, simulate_network
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD, FD_LENGTHS

MS = 1_000_000


def tree(parents, rates, latencies=None):
    """Return segments, each but the first joined to its parent by a gateway."""
    segments = tuple(
        BusSegment(f"s{k}", rate, data_bitrate=data) for k, (rate, data) in enumerate(rates)
    )
    latencies = latencies or [(2 * MS, 2 * MS)] * len(parents)
    gateways = (
        BusGateway(f"g{k}", (near, k + 1), TimeSpread(*latency))
        for k, (near, latency) in enumerate(zip(parents, latencies, strict=True))
    )
    return Topology(segments, tuple(gateways))


def routed(topology, message, target):
    """Return a message of a node of segment 0, 1 … with its way; in a tree there is one."""
    home = int(message.sender[1])

    def find(segment, before):
        if segment == target:
            return ()
        for number, gateway in enumerate(topology.gateways):
            if segment in gateway.segments:
                there = sum(gateway.segments) - segment
                rest = None if there == before else find(there, segment)
                if rest is not None:
                    return (Hop(number, segment, there), *rest)
        return None

    return RoutedMessage(message, home, find(home, None))


def frame(name, ident, period_ms, segment, **options):
    """Eight bytes at 500 kbit/s: 222 µs at least, 270 µs at most, received 8 µs before the end."""
    return BusMessage(name, ident, 8, period_ms * MS, f"n{segment}", **options)


def test_three_segments_by_hand():
    topology = tree((0, 1), [(500_000, 0)] * 3, [(1 * MS, 3 * MS)] * 2)
    far = routed(topology, frame("far", 0x10, 10, 0), 2)
    others = [routed(topology, frame(f"other{s}", 0x700 + s, 10, s), s) for s in range(3)]
    way = arrivals(RoutedNetwork(topology, [far, *others]))[0]
    assert list(way) == [0, 1, 2]
    # one frame of lower priority and itself; behind a gateway the jitter comes on top
    first = 540_000
    second = first - 222_000 + 2 * MS + 540_000
    third = second - 222_000 + 2 * MS + 540_000
    assert [way[s].here.bound_ns for s in range(3)] == [first, second, third]
    # in the end each wait and each latency counts once
    assert [way[s].greatest_ns for s in range(3)] == [
        k * 540_000 + (k - 1) * 3 * MS for k in (1, 2, 3)
    ]
    assert [way[s].least_ns for s in range(3)] == [k * 214_000 + (k - 1) * MS for k in (1, 2, 3)]


def test_frames_that_a_gateway_holds_back_come_together():
    """A latency of up to 12 ms: two frames of one message meet a third party behind the gateway."""
    topology = tree((0,), [(500_000, 0)] * 2, [(0, 12 * MS)])
    burst = routed(topology, frame("burst", 0x10, 10, 0), 1)
    victim = routed(topology, frame("victim", 0x20, 10, 1), 1)
    assert arrivals(RoutedNetwork(topology, [burst, victim]))[1][1].greatest_ns == 3 * 270_000


def test_without_a_bound_in_front_of_a_gateway_there_is_none_behind_it():
    """Nor for what has less priority there, or waits in its queue; what has more keeps its own."""
    topology = tree((0,), [(125_000, 0), (500_000, 0)])
    crowd = [routed(topology, frame(f"crowd{i}", i, 3, 0), 0) for i in range(3)]
    lost = routed(topology, frame("lost", 0x100, 10, 0), 1)
    above = routed(topology, frame("above", 0x50, 10, 1), 1)
    below = routed(topology, frame("below", 0x200, 10, 1), 1)
    # a queue as urgent as the frame below the lost one: once its own urgent frame kept a bound
    queue = [
        RoutedMessage(frame(name, ident, 10, 9, fifo=True), 1)
        for name, ident in (("urgent", 0x60), ("late", 0x300))
    ]
    *_, first, second, third, fourth, fifth = arrivals(
        RoutedNetwork(topology, [*crowd, lost, above, below, *queue])
    )
    assert (first[0].here.bound_ns, first[0].here.reason) == (None, OVERLOADED)
    for found in (first, third, fourth, fifth):
        assert (found[1].here.bound_ns, found[1].here.reason) == (None, UNLIMITED)
    assert second[1].here.bound_ns == 2 * 270_000


def test_fifo_queues_that_delay_each_other_without_end_have_no_bound():
    """No segment is overloaded; but jitter from the one grows by what it causes on the other."""
    topology = tree((0, 1), [(125_000, 0)] * 3, [(0, 10_494_422), (0, 2_355_562)])
    rows = (
        # identifier, period in ms, from, to
        (112, 7.207777, 2, 0),
        (497, 3.203456, 0, 2),
        (1474, 18.419874, 0, 0),
        (1235, 4.805184, 2, 0),
        (100, 11.212097, 1, 1),
        (917, 12.012961, 1, 0),
        (726, 20.021602, 1, 2),
    )
    messages = [
        routed(topology, frame(f"m{k}", ident, period, home, fifo=True), target)
        for k, (ident, period, home, target) in enumerate(rows)
    ]
    for segment in range(3):
        here = [r.message for r in messages if segment in r.segments]
        assert worst_case_utilisation(here, bitrate=125_000) < 0.96
    found = arrivals(RoutedNetwork(topology, messages))
    assert {a.greatest_ns for bounds in found for a in bounds.values()} == {None}
    assert {a.here.reason for bounds in found for a in bounds.values()} == {UNLIMITED}


def test_errors_lengthen_every_hop():
    topology = tree((0, 1), [(500_000, 0)] * 3)
    far = routed(topology, frame("far", 0x10, 10, 0), 2)
    (plain,) = arrivals(RoutedNetwork(topology, [far]))
    (disturbed,) = arrivals(RoutedNetwork(topology, [far]), errors=ErrorModel(50 * MS))
    assert all(disturbed[s].greatest_ns > plain[s].greatest_ns for s in range(3))


def test_offsets_count_on_segments_without_forwarded_messages():
    messages = [frame(f"m{k}", 0x10 + k, 10, 0, offset_ns=k * MS) for k in range(4)]
    topology = tree((0,), [(500_000, 0)] * 2)
    ways = [routed(topology, message, 0) for message in messages]
    network = RoutedNetwork(topology, ways)
    plain, kept = arrivals(network), arrivals(network, offsets=True)
    bounds = response_bounds(messages, bitrate=500_000, offsets=True)
    assert [found[0].here for found in kept] == bounds
    assert kept[3][0].greatest_ns < plain[3][0].greatest_ns
    # the phase of a forwarded message is not that of its sender
    ways[0] = routed(topology, messages[0], 1)
    ways += [routed(topology, frame("n", 0x30, 10, 1), 1)]
    network = RoutedNetwork(topology, ways)
    plain, kept = (
        [found[1] for found in arrivals(network, offsets=offsets) if 1 in found]
        for offsets in (False, True)
    )
    assert plain == kept


def test_messages_of_one_node_with_one_identifier_share_their_times():
    network = RoutedNetwork.one_bus(
        [BusMessage(name, 5, 8, 10 * MS, "node") for name in "ab"], bitrate=500_000
    )
    simulated = simulate_network(network, duration_s=0.1)
    one, two = (times[0].here for times in simulated.arrivals)
    assert len(one) > 10 and one.tolist() == two.tolist()


def test_a_forwarded_frame_keeps_the_length_it_is_given():
    """Once only the first segment sent a frame with its most stuff bits."""
    topology = tree((0, 1), [(500_000, 0)] * 3)
    far = routed(topology, frame("far", 0x10, 10, 0, bits=135), 2)
    network = build_network(network_spec(RoutedNetwork(topology, [far]), nodes=listeners(topology)))
    advance(network, 100 * MS)
    entries, _, _ = drain(network, 0)
    assert set(entries["segment"]) == {0, 1, 2}
    assert set(entries["t_end"] - entries["t_start"]) == {270_000}


@st.composite
def networks(draw):
    """Return a tree of segments below full load, its messages with their ways, and a tick in ns.

    Either of the two nodes on each may have a queue. The first message carries samples to the
    segment of the last one's sender, the command.
    """
    count = draw(st.integers(1, 4))
    parents = [draw(st.integers(0, k)) for k in range(count - 1)]
    rates, latencies = [], []
    for _ in range(count):
        bitrate = draw(st.sampled_from((125_000, 300_000, 500_000, 1_000_000)))
        rates.append((bitrate, bitrate * draw(st.sampled_from((0, 1, 2, 5)))))
    for _ in parents:
        low = draw(st.integers(0, 3 * MS))
        latencies.append((low, low + draw(st.one_of(st.just(0), st.integers(0, 12 * MS)))))
    topology = tree(parents, rates, latencies)
    places = st.integers(0, count - 1)
    fifo = draw(st.sets(st.tuples(places, st.booleans())))
    messages = [
        draw(message_on(place, draw(places), fifo)) for place in range(draw(st.integers(3, 8)))
    ]
    targets = [draw(places) for _ in messages]
    targets[0] = int(messages[-1].sender[1])
    tick_ns = draw(st.sampled_from((5_000_000, 7_500_000, 10_000_000)))
    messages[-1] = replace(messages[-1], period_ns=float(tick_ns))
    ways = [routed(topology, m, t) for m, t in zip(messages, targets, strict=True)]
    most = 0.0
    for number, segment in enumerate(topology.segments):
        rates = {"bitrate": segment.bitrate, "data_bitrate": segment.data_bitrate}
        here = [way.message for way in ways if number in way.segments]
        most = max(most, worst_case_utilisation(here, **rates))
    scale = max(1.0, most / draw(st.floats(0.2, 0.8)))
    ways = [
        replace(way, message=replace(way.message, period_ns=way.message.period_ns * scale))
        for way in ways
    ]
    return topology, ways, round(ways[-1].message.period_ns)


@st.composite
def message_on(draw, place, segment, fifo):
    fd, extended = draw(st.booleans()), draw(st.booleans())
    flags = (EXTENDED if extended else 0) | (FD if fd else 0)
    flags |= BIT_RATE_SWITCH if fd and draw(st.booleans()) else 0
    # the lowest bits tell the messages apart, the highest decide
    base = draw(st.integers(0, 2**7 - 1)) << 4 | place
    ident = base << 18 | draw(st.integers(0, 2**18 - 1)) if extended else base
    period, second = draw(st.integers(2_000_000, 20_000_000)), draw(st.booleans())
    return BusMessage(
        f"m{place}",
        ident,
        draw(st.sampled_from(FD_LENGTHS)) if fd else draw(st.integers(0, 8)),
        period + draw(st.sampled_from((0, 0.25, 1 / 3))),
        f"n{segment}{'ab'[second]}",
        jitter_ns=draw(st.one_of(st.just(0), st.integers(0, period // 2))),
        offset_ns=draw(st.integers(0, period)),
        flags=flags,
        fifo=(segment, second) in fifo,
    )


@given(networks(), st.booleans(), st.integers(0, 100))
def test_no_arrival_and_no_age_is_above_its_bound(drawn, worst_case_lengths, seed):
    topology, ways, tick_ns = drawn
    network = RoutedNetwork(topology, ways)
    found = arrivals(network)
    simulated = simulate_network(
        network, duration_s=0.3, seed=seed, worst_case_lengths=worst_case_lengths
    )
    assert all(simulated.balanced)
    for bounds, seen in zip(found, simulated.arrivals, strict=True):
        for segment, bound in bounds.items():
            whole, here = seen[segment].end_to_end, seen[segment].here
            if bound.greatest_ns is not None and len(whole):
                assert whole.max() <= bound.greatest_ns
                assert here.max() <= bound.here.queued_ns
                assert here.min() >= bound.here.best_ns
                assert whole.min() > bound.least_ns
    ecu, actuator = ways[-1].home, ways[-1].segments[-1]
    path = found[0][ecu], found[-1][actuator]
    if None in (arrival.greatest_ns for arrival in path):
        return
    limits = total_delay(
        *map(path_of, path),
        sensor_period_s=ways[0].message.period_ns * 1e-9,
        tick_s=tick_ns * 1e-9,
    )
    ages = simulate_ages_of_network(
        network,
        ways[0].message.name,
        ways[-1].message.name,
        actuator_segment=actuator,
        duration_s=1.0,
        seed=seed,
        worst_case_lengths=worst_case_lengths,
        phases=2,
    )
    assert len(ages) > 0
    assert round(limits.age_min * 1e9) <= ages.min()
    assert ages.max() <= round(limits.age_max * 1e9)
