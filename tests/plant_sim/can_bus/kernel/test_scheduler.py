"""Arbitration, queues, gateways and the account of every frame."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.buses.topology import TimeSpread
from canroll.plant_sim.can_bus import (
    DELIVERED,
    SUPERSEDED,
    BusFault,
    Gateway,
    NetworkSpec,
    Node,
    Segment,
    Source,
    account,
    advance,
    build_network,
    drain,
    enqueue,
    load,
)
from canroll.plant_sim.can_bus.kernel.scheduler import next_event_ns
from canroll.plant_sim.can_bus.wire.frame import (
    BIT_RATE_SWITCH,
    EXTENDED,
    FD,
    arbitration_key,
    frame_bits,
)

BIT = 2000
PAYLOAD = np.arange(8, dtype=np.uint8)


def bus(*, nodes=3, policy="priority", segments=1, **options):
    spec = NetworkSpec(
        segments=(Segment(500_000, 2_000_000),) * segments,
        nodes=tuple(Node(f"n{i}", i % segments, policy) for i in range(nodes)),
        **options,
    )
    return build_network(spec)


def entries(network):
    return drain(network, 0)[0]


def test_times_of_a_single_frame():
    network = bus()
    enqueue(network, 0, 5000, 0x123, 8, PAYLOAD)
    advance(network, 1_000_000)
    (entry,) = entries(network)
    bits = frame_bits(0x123, 0, 8, PAYLOAD)[0]
    assert entry["t_queued"] == entry["t_start"] == entry["t_origin"] == 5000
    assert entry["t_received"] == 5000 + (bits - 4) * BIT
    assert entry["t_end"] == 5000 + bits * BIT
    assert (entry["ident"], entry["sender"], entry["attempts"]) == (0x123, 0, 1)
    assert list(entry["payload"][:8]) == list(range(8))
    assert load(network, 0) == pytest.approx(bits * BIT / 1_000_000)


def test_a_delivery_appears_only_when_it_is_received():
    network = bus()
    enqueue(network, 0, 0, 0x123, 8, PAYLOAD)
    received = (frame_bits(0x123, 0, 8, PAYLOAD)[0] - 4) * BIT
    advance(network, received - 1)
    assert len(entries(network)) == 0
    advance(network, received)
    assert len(entries(network)) == 1


def test_a_frame_queued_at_the_start_of_another_takes_part():
    network = bus()
    enqueue(network, 0, 100, 0x200, 0, PAYLOAD)
    enqueue(network, 1, 100, 0x100, 0, PAYLOAD)
    advance(network, 10_000_000)
    assert list(entries(network)["ident"]) == [0x100, 0x200]


def test_fd_frames_take_the_time_of_both_phases():
    network = bus()
    payload = np.arange(64, dtype=np.uint8)
    flags = FD | BIT_RATE_SWITCH
    enqueue(network, 0, 0, 0x55, 64, payload, flags)
    advance(network, 10_000_000)
    (entry,) = entries(network)
    nominal, data = frame_bits(0x55, flags, 64, payload)
    assert entry["t_end"] == nominal * 2000 + data * 500
    assert bytes(entry["payload"]) == payload.tobytes()


def test_fifo_queues_block_urgent_frames_behind_others():
    for policy, order in (("fifo", [0x100, 0x300, 0x080]), ("priority", [0x100, 0x080, 0x300])):
        network = bus(policy=policy)
        enqueue(network, 1, 0, 0x100, 8, PAYLOAD)
        enqueue(network, 0, 10, 0x300, 8, PAYLOAD)
        enqueue(network, 0, 20, 0x080, 8, PAYLOAD)
        advance(network, 10_000_000)
        assert list(entries(network)["ident"]) == order


def test_a_newer_frame_replaces_a_waiting_one_but_not_one_on_the_wire():
    network = bus(policy="replace")
    enqueue(network, 1, 0, 0x050, 8, PAYLOAD)
    for t, value in ((10, 1), (20, 2), (600_000, 3)):
        enqueue(network, 0, t, 0x100, 1, np.array([value], np.uint8))
    advance(network, 10_000_000)
    log = entries(network)
    mine = log[log["ident"] == 0x100]
    assert [(int(e["outcome"]), int(e["payload"][0])) for e in mine] == [
        (SUPERSEDED, 1),
        (DELIVERED, 2),
        (DELIVERED, 3),
    ]
    assert account(network, 0).balanced


def test_full_queues_lose_the_newest_frame_and_say_so():
    spec = NetworkSpec((Segment(500_000),), (Node("a", policy="fifo", capacity=2), Node("b")))
    network = build_network(spec)
    for i in range(5):
        enqueue(network, 0, 0, 0x100 + i, 8, PAYLOAD)
    advance(network, 10_000_000)
    result = account(network, 0)
    assert (result.offered, result.outcomes["delivered"]) == (5, 2)
    assert result.outcomes["lost: queue full"] == 3
    assert result.balanced


def test_frames_cannot_be_queued_in_the_past():
    network = bus()
    advance(network, 1000)
    with pytest.raises(ValueError, match="before"):
        enqueue(network, 0, 999, 0x1, 0, PAYLOAD)


@pytest.mark.parametrize(("length", "room"), [(9, 8), (65, 70), (-1, 8)])
def test_frames_longer_than_their_payload_are_refused(length, room):
    with pytest.raises(ValueError, match="bytes"):
        enqueue(bus(), 0, 0, 0x1, length, np.zeros(room, np.uint8))


def test_sources_keep_period_offset_jitter_and_drift():
    drifting = NetworkSpec(
        (Segment(500_000),),
        (Node("a", drift_ppm=100.0), Node("b")),
        sources=(
            Source("a", 0x10, 2, 1_000_000, offset_ns=70),
            Source("b", 0x20, 2, 1_000_000, jitter_ns=300_000, until_ns=500_000_000),
        ),
    )
    network = build_network(drifting)
    advance(network, 1_000_000_000)
    log = entries(network)
    first = log[log["ident"] == 0x10]["t_queued"]
    assert list(first[:3]) == [70, 1_000_170, 2_000_270]
    late = log[log["ident"] == 0x20]["t_queued"] % 1_000_000
    assert len(late) == 500
    assert late.max() <= 300_000
    assert late.max() > 250_000
    assert late.min() < 50_000


@pytest.mark.parametrize(("low", "high"), [(5, 5), (5, 10)])
def test_gateways_delay_within_their_spread_and_keep_order(low, high):
    ms = 1_000_000
    network = bus(
        nodes=4,
        segments=2,
        sources=(Source("n0", 0x100, 8, 1 * ms), Source("n0", 0x101, 8, 50 * ms)),
        gateways=(Gateway("n2", "n3", TimeSpread(low * ms, high * ms), ((0x100, 0),)),),
    )
    advance(network, 2_000 * ms)
    log = entries(network)
    there = log[(log["segment"] == 1) & (log["outcome"] == DELIVERED)]
    assert set(there["ident"]) == {0x100}
    here = log[(log["segment"] == 0) & (log["ident"] == 0x100)]
    latency = there["t_queued"] - here["t_received"][: len(there)]
    assert latency.min() >= low * ms
    assert latency.max() <= high * ms
    if low < high:
        assert latency.std() > 0.1 * ms
    assert (np.diff(there["t_origin"]) > 0).all()
    assert list(there["t_origin"]) == list(here["t_queued"][: len(there)])
    assert account(network, 0).balanced
    assert account(network, 1).balanced


def test_a_partition_at_the_gateway_loses_exactly_the_frames_of_its_time():
    ms = 1_000_000
    network = bus(
        nodes=4,
        segments=2,
        sources=(Source("n0", 0x100, 8, 10 * ms),),
        gateways=(Gateway("n2", "n3", TimeSpread(1 * ms, 1 * ms)),),
        faults=(BusFault("gateway_down", 0, 100 * ms, 200 * ms),),
    )
    advance(network, 1_000 * ms)
    result = account(network, 1)
    assert result.outcomes["lost: partition"] == 10
    assert result.balanced


def test_lost_and_delayed_nodes():
    ms = 1_000_000
    network = bus(
        sources=(Source("n0", 0x100, 8, 10 * ms), Source("n1", 0x200, 8, 10 * ms)),
        faults=(
            BusFault("node_down", "n0", 200 * ms, 300 * ms),
            BusFault("node_delay", "n1", 500 * ms, 600 * ms, value=7 * ms),
        ),
    )
    advance(network, 1_005 * ms)
    log = entries(network)
    assert account(network, 0).outcomes["lost: node down"] == 10
    late = log[(log["ident"] == 0x200)]
    delay = late["t_queued"] - late["t_origin"]
    assert sorted(set(delay)) == [0, 7 * ms]
    assert (delay > 0).sum() == 10
    assert (np.diff(late["t_received"]) > 0).all()
    assert account(network, 0).balanced


def test_a_babbling_idiot_starves_everybody_below_it():
    ms = 1_000_000
    network = bus(
        policy="replace",
        sources=(
            Source("n0", 0x100, 8, 10 * ms),
            Source("n1", 0x000, 8, 0.05 * ms, offset_ns=300 * ms, until_ns=500 * ms),
        ),
    )
    advance(network, 1_000 * ms)
    log = entries(network)
    mine = log[log["ident"] == 0x100]
    inside = (mine["t_received"] > 301 * ms) & (mine["t_received"] < 500 * ms)
    assert not (mine[inside]["outcome"] == DELIVERED).any()
    assert (mine[mine["t_received"] > 520 * ms]["outcome"] == DELIVERED).all()
    assert account(network, 0).balanced


def test_overload_frames_hold_the_bus_fifteen_bits():
    network = bus(faults=(BusFault("overload", 0, count=1),))
    enqueue(network, 0, 0, 0x100, 0, PAYLOAD)
    enqueue(network, 1, 0, 0x200, 0, PAYLOAD)
    advance(network, 10_000_000)
    first, second = entries(network)
    bits = frame_bits(0x100, 0, 0, PAYLOAD)[0]
    assert second["t_start"] == (bits + 15) * BIT
    assert second["t_end"] - second["t_start"] == frame_bits(0x200, 0, 0, PAYLOAD)[0] * BIT
    assert first["t_received"] == (bits - 4) * BIT


@st.composite
def offered(draw):
    frames = draw(
        st.lists(
            st.tuples(
                st.integers(0, 3),
                st.integers(0, 3_000_000),
                st.integers(0, 0x7FF),
                st.integers(0, 8),
            ),
            min_size=1,
            max_size=60,
        )
    )
    return sorted(frames, key=lambda f: f[1])


@given(
    frames=offered(),
    policy=st.sampled_from(["priority", "fifo", "replace"]),
    rate=st.sampled_from([0.0, 1e-3, 5e-3]),
    seed=st.integers(0, 100),
)
def test_nothing_overlaps_and_everything_is_accounted_for(frames, policy, rate, seed):
    spec = NetworkSpec(
        (Segment(500_000, bit_error_rate=rate),),
        tuple(Node(f"n{i}", policy=policy, capacity=8) for i in range(4)),
        seed=seed,
    )
    network = build_network(spec)
    for node, t, ident, length in frames:
        # identifiers of different nodes differ, as on a sound bus
        enqueue(network, node, t, ident & ~3 | node, length, PAYLOAD)
    # in pieces: how often a bus is advanced changes nothing
    for until in range(0, 40_000_000, 777_777):
        advance(network, until)
    log = entries(network)
    sent = log[log["t_start"] >= 0]
    order = np.argsort(sent["t_start"], kind="stable")
    assert (sent["t_start"][order][1:] >= sent["t_end"][order][:-1]).all()
    assert (sent["t_start"] >= sent["t_queued"]).all()
    assert (np.diff(log["t_received"]) >= 0).all()
    result = account(network, 0)
    assert result.balanced
    assert result.offered == len(frames)
    again = build_network(spec)
    for node, t, ident, length in frames:
        enqueue(again, node, t, ident & ~3 | node, length, PAYLOAD)
    advance(again, 40_000_000)
    whole = entries(again)
    assert (whole[: len(log)] == log).all()


@settings(max_examples=40, deadline=None)
@given(frames=offered())
def test_every_winner_is_the_most_urgent_of_all_that_waited(frames):
    network = bus(nodes=4)
    for node, t, ident, length in frames:
        enqueue(network, node, t, ident & ~3 | node, length, PAYLOAD)
    advance(network, 60_000_000)
    log = entries(network)
    assert len(log) == len(frames)
    for entry in log:
        waiting = log[(log["t_queued"] <= entry["t_start"]) & (log["t_start"] > entry["t_start"])]
        own = arbitration_key(int(entry["ident"]), 0)
        assert all(arbitration_key(int(i), 0) >= own for i in waiting["ident"])


def test_propagation_delays_the_reception_but_not_the_bus():
    times = []
    for delay in (0, 150):
        spec = NetworkSpec((Segment(500_000, propagation_ns=delay),), (Node("a"), Node("b")))
        network = build_network(spec)
        enqueue(network, 0, 0, 0x123, 8, PAYLOAD)
        advance(network, 1_000_000)
        times.append(entries(network)[0])
    assert times[1]["t_received"] == times[0]["t_received"] + 150
    assert times[1]["t_end"] == times[0]["t_end"]


@pytest.mark.parametrize("bitrate", [83_333, 95_238, 615_384])
def test_bit_times_that_are_no_whole_nanoseconds_are_rounded_once_a_frame(bitrate):
    network = build_network(NetworkSpec((Segment(bitrate),), (Node("a"), Node("b"))))
    enqueue(network, 0, 0, 0x123, 8, PAYLOAD)
    advance(network, 100_000_000)
    bits = frame_bits(0x123, 0, 8, PAYLOAD)[0]
    (entry,) = entries(network)
    assert entry["t_end"] == round(bits * 1e9 / bitrate)
    assert entry["t_received"] == round((bits - 4) * 1e9 / bitrate)


def test_more_identifiers_than_there_is_room_for_are_refused_not_confused():
    network = bus()
    count = 0
    with pytest.raises(ValueError, match="different messages"):
        for ident in range(1 << 14):
            enqueue(network, 0, int(network.clock[0]), ident, 0, PAYLOAD, EXTENDED)
            count += 1
            if count % 200 == 0:
                advance(network, int(network.clock[0]) + 10**9)
    advance(network, int(network.clock[0]) + 10**9)
    result = account(network, 0)
    assert result.outcomes["delivered"] == count == 8192
    assert result.balanced


def test_next_event():
    network = bus()
    assert next_event_ns(network) == 2**62
    enqueue(network, 0, 4000, 0x1, 0, PAYLOAD)
    assert next_event_ns(network) == 4000


def test_impossible_networks_are_refused():
    with pytest.raises(UnknownNameError, match="did you mean 'priority'"):
        build_network(NetworkSpec((Segment(1),), (Node("a", policy="priorty"),)))
    with pytest.raises(UnknownNameError, match="bus node 'x'"):
        build_network(NetworkSpec((Segment(1),), (Node("a"),), (Source("x", 1, 1, 1.0),)))
    for segment, source, word in (
        (Segment(0), Source("a", 1, 1, 1.0), "bit rate"),
        (Segment(1, bit_error_rate=1.0), Source("a", 1, 1, 1.0), "bit error rate"),
        (Segment(1), Source("a", 0x800, 1, 1.0), "11 bits"),
        (Segment(1), Source("a", 1, 9, 1.0), "payload length"),
        (Segment(1), Source("a", 1, 1, 0.0), "period"),
    ):
        with pytest.raises(CanrollError, match=word):
            build_network(NetworkSpec((segment,), (Node("a"),), (source,)))
    with pytest.raises(CanrollError, match="holds at most 8 segments, got 9"):
        build_network(NetworkSpec((Segment(1),) * 9, ()))


def test_a_full_store_refuses_and_counts():
    network = bus()
    accepted = sum(enqueue(network, 0, 10**9 + i, 0x100, 0, PAYLOAD) for i in range(5000))
    assert accepted == 4096
    advance(network, 2)
    assert account(network, 0).outcomes["lost: queue full"] == 5000 - 4096


def test_measured_latencies_are_drawn_as_they_were_measured():
    ms = 1_000_000
    samples = (3 * ms, 3 * ms, 3 * ms, 7 * ms)
    network = bus(
        nodes=4,
        segments=2,
        sources=(Source("n0", 0x100, 8, 20 * ms),),
        gateways=(Gateway("n2", "n3", TimeSpread.of_samples(samples)),),
    )
    advance(network, 20_000 * ms)
    log = entries(network)
    here, there = (log[log["segment"] == s] for s in (0, 1))
    latency = there["t_queued"] - here["t_received"][: len(there)]
    values, counts = np.unique(latency, return_counts=True)
    assert list(values) == [3 * ms, 7 * ms]
    assert counts[0] / len(latency) == pytest.approx(0.75, abs=0.05)


def test_a_nodes_jitter_delays_its_frames_and_keeps_their_order():
    ms = 1_000_000
    late = TimeSpread.of_samples((0, 1 * ms, 30 * ms))
    spec = NetworkSpec(
        segments=(Segment(500_000),),
        nodes=(Node("a", policy="priority", jitter=late), Node("b", policy="priority")),
        sources=(Source("a", 0x100, 8, 10 * ms), Source("b", 0x200, 8, 10 * ms)),
        seed=5,
    )
    network = build_network(spec)
    payload = np.arange(8, dtype=np.uint8)
    for k in range(100):
        enqueue(network, 0, 5 * ms + 10 * k * ms, 0x110, 8, payload)
    advance(network, 2_000 * ms)
    log = entries(network)
    for ident in (0x100, 0x110):
        found = log[log["ident"] == ident]
        waited = found["t_queued"] - found["t_origin"]
        assert waited.max() == 30 * ms and waited.min() == 0
        assert (np.diff(found["t_origin"]) > 0).all()
        assert len(np.unique(waited)) > 3  # behind an older one of the node
    other = log[log["ident"] == 0x200]
    assert (other["t_queued"] == other["t_origin"]).all()
    assert account(network, 0).balanced


def test_there_is_room_for_so_many_measured_times():
    late = TimeSpread.of_samples(tuple(range(1, 10_000)))
    nodes = tuple(Node(name, jitter=late) for name in "ab")
    with pytest.raises(CanrollError, match="at most 16384 measured times"):
        build_network(NetworkSpec(segments=(Segment(500_000),), nodes=nodes))


def test_a_delay_fault_comes_on_top_of_a_nodes_jitter():
    ms = 1_000_000
    spec = NetworkSpec(
        segments=(Segment(500_000),),
        nodes=(Node("a", jitter=TimeSpread(1 * ms, 1 * ms)), Node("b")),
        sources=(Source("a", 0x100, 8, 10 * ms),),
        faults=(BusFault("node_delay", "a", 100 * ms, 200 * ms, value=2 * ms),),
    )
    network = build_network(spec)
    advance(network, 300 * ms)
    log = entries(network)
    waited = log["t_queued"] - log["t_origin"]
    inside = (log["t_origin"] >= 100 * ms) & (log["t_origin"] < 200 * ms)
    assert set(waited[inside]) == {3 * ms} and set(waited[~inside]) == {1 * ms}
