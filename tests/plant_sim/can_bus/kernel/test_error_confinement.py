"""Error frames, counters, error-passive, bus-off and recovery; colliding and lonely nodes."""

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.buses.topology import TimeSpread
from canroll.plant_sim.can_bus import (
    DELIVERED,
    ERROR,
    REFUSED,
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
    took,
)
from canroll.plant_sim.can_bus.kernel.layout import BUS_OFF, ERROR_ACTIVE, ERROR_PASSIVE
from canroll.plant_sim.can_bus.wire.bits import wire_bits
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, REMOTE, frame_bits

BIT = 2000
MS = 1_000_000
PAYLOAD = np.arange(8, dtype=np.uint8)


def bus(*, nodes=3, faults=(), sources=(), rate=0.0, seed=0, policy="priority", **options):
    return build_network(
        NetworkSpec(
            (Segment(500_000, bit_error_rate=rate),),
            tuple(Node(f"n{i}", policy=policy, **options) for i in range(nodes)),
            sources=sources,
            faults=faults,
            seed=seed,
        )
    )


def entries(network):
    return drain(network, 0)[0]


def arbitration(bits, extended):
    """Places of the bits that arbitrate, behind SOF up to RTR, and which of them are stuffed."""
    left, run, place, stuffed = 32 if extended else 12, 1, 1, {}
    while left:
        stuffed[place] = run == 5
        run = run + 1 if bits[place] == bits[place - 1] else 1
        left -= not stuffed[place]
        place += 1
    return stuffed


def watched(bits, position, stuffed):
    """A sender and a receiver that watch the bus bit by bit, with bit ``position`` inverted.

    They know the rules of ISO 11898-1 alone: who sends another bit than is on the bus has a bit
    error, but for a recessive bit of the arbitration, which is lost; six equal bits are a stuff
    error; who has an error sends six dominant bits. Returns the bits until the last flag has
    ended, the transmit errors of the sender, and the receive errors of both.
    """
    wire, sends, flags = [], True, {}
    transmit, receive = 0, {"sender": 0, "receiver": 0}
    while not flags or max(flags.values()) + 6 > len(wire):
        place = len(wire)
        level = 0 if any(begun <= place < begun + 6 for begun in flags.values()) else 1
        driven = bits[place] if sends and "sender" not in flags else 1
        level = min(level, driven)
        level = 1 - level if place == position else level
        wire.append(level)
        six = len(wire) >= 6 and len(set(wire[-6:])) == 1
        for node in receive.keys() - flags.keys():
            transmits = node == "sender" and sends
            recessive = transmits and level < driven
            if recessive and not stuffed.get(place, True):
                sends = False
            elif transmits and level != driven:
                flags[node] = place + 1
                # a recessive stuff bit before RTR seen dominant leaves the counter (exception 2)
                transmit += 0 if recessive and place in stuffed else 8
            elif six:
                flags[node] = place + 1
                receive[node] += 1
    return len(wire), transmit, receive["sender"], receive["receiver"]


@pytest.mark.parametrize(
    ("ident", "flags"),
    [
        (0x2AA, 0),
        (0x555, 0),
        (0x00F, 0),
        (0x7F0, REMOTE),
        (0x0AAAAAAA, EXTENDED),
        (0x1F07C1F0, EXTENDED),
        (0x00000000, EXTENDED),
    ],
)
def test_an_error_is_counted_and_as_long_as_those_who_watch_the_bus_make_it(ident, flags):
    """Every bit before the CRC delimiter, one at a time; the nodes are error-active."""
    out = np.zeros(800, np.uint8)
    count, _, _ = wire_bits(ident, flags, 8, PAYLOAD, out)
    bits = [int(b) for b in out[:count]]
    stuffed = arbitration(bits, flags & EXTENDED)
    for position in range(1, count - 10):
        network = bus(faults=(BusFault("disturb", "n0", value=position, count=1),))
        enqueue(network, 0, 0, ident, 8, PAYLOAD, flags)
        advance(network, 10 * MS)
        broken, good = entries(network)
        length, transmit, sender, receiver = watched(bits, position, stuffed)
        assert broken["outcome"] == ERROR
        assert broken["t_end"] == (length + 8 + 3) * BIT
        assert (good["outcome"], good["attempts"]) == (DELIVERED, 2)
        assert good["t_start"] == broken["t_end"]
        # the repetition counts one down for its sender and its receivers
        assert list(network.nodes["transmit_errors"]) == [max(transmit - 1, 0), 0, 0]
        assert list(network.nodes["receive_errors"]) == [sender, receiver - 1, receiver - 1]


@pytest.mark.parametrize(("position", "waits"), [(1, 0), (2, 8)])
def test_a_passive_node_that_lost_arbitration_was_no_transmitter_and_need_not_wait(position, waits):
    network = bus(faults=(BusFault("disturb", "n0", value=position, count=1),))
    network.nodes["transmit_errors"][0], network.nodes["state"][0] = 140, ERROR_PASSIVE
    network.segments["disturbed"][0] = 1
    enqueue(network, 0, 0, 0x555, 8, PAYLOAD)
    advance(network, 10 * MS)
    broken, good = entries(network)
    assert good["t_start"] == broken["t_end"] + waits * BIT


def test_counters_rise_by_eight_and_one_and_fall_by_one():
    network = bus(faults=(BusFault("disturb", "n0", count=3),))
    enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
    advance(network, 10 * MS)
    assert list(network.nodes["transmit_errors"]) == [23, 0, 0]
    assert list(network.nodes["receive_errors"]) == [0, 2, 2]
    for i in range(30):
        enqueue(network, 0, (10 + i) * MS, 0x100, 8, PAYLOAD)
    advance(network, 50 * MS)
    assert list(network.nodes["transmit_errors"]) == [0, 0, 0]
    assert list(network.nodes["receive_errors"]) == [0, 0, 0]


def test_an_error_passive_node_waits_eight_bits_behind_its_own_frames():
    network = bus(faults=(BusFault("disturb", "n0", count=16),))
    enqueue(network, 0, 0, 0x100, 0, PAYLOAD)
    enqueue(network, 0, 0, 0x101, 0, PAYLOAD)
    advance(network, 100 * MS)
    assert network.nodes["state"][0] == ERROR_ACTIVE
    log = entries(network)
    destroyed = log[log["outcome"] == ERROR]
    assert len(destroyed) == 16
    # the sixteenth error makes the node passive: eight more bits before the next attempt
    good = log[log["outcome"] == DELIVERED]
    assert good["t_start"][0] == destroyed["t_end"][-1] + 8 * BIT


def test_another_node_may_use_the_time_a_passive_node_waits():
    network = bus(faults=(BusFault("disturb", "n0", count=16),))
    enqueue(network, 0, 0, 0x100, 0, PAYLOAD)
    enqueue(network, 1, 10, 0x700, 0, PAYLOAD)
    advance(network, 100 * MS)
    log = entries(network)
    good = log[log["outcome"] == DELIVERED]
    assert list(good["ident"]) == [0x700, 0x100]


def test_bus_off_after_thirty_two_errors_then_recovery():
    network = bus(
        sources=(Source("n0", 0x100, 8, 10 * MS), Source("n1", 0x200, 8, 1 * MS)),
        faults=(BusFault("disturb", "n0", 100 * MS, count=32),),
    )
    advance(network, 100 * MS)
    assert network.nodes["state"][0] == ERROR_ACTIVE
    advance(network, 102 * MS)
    assert network.nodes["state"][0] == ERROR_PASSIVE
    while network.nodes["state"][0] != BUS_OFF:
        advance(network, int(network.clock[0]) + 10_000)
    off = int(network.clock[0])
    while network.nodes["state"][0] == BUS_OFF:
        advance(network, int(network.clock[0]) + 10_000)
    back = int(network.clock[0])
    # 128 sequences of 11 recessive bits take 2.8 ms of an idle bus, longer of a busy one
    assert 128 * 11 * BIT <= back - off <= 128 * 11 * BIT * 2
    advance(network, 1_000 * MS)
    log = entries(network)
    lost = account(network, 0)
    assert lost.outcomes["lost: bus-off"] >= 1
    assert lost.balanced
    assert network.nodes["bus_offs"][0] == 1
    mine = log[(log["ident"] == 0x100) & (log["outcome"] == DELIVERED)]
    assert (mine["t_received"] > back).sum() >= 85


def test_a_node_that_does_not_recover_stays_off():
    network = bus(
        sources=(Source("n0", 0x100, 8, 10 * MS), Source("n1", 0x200, 8, 1 * MS)),
        faults=(BusFault("disturb", "n0", count=32),),
        recovers=False,
    )
    advance(network, 1_000 * MS)
    assert network.nodes["state"][0] == BUS_OFF
    result = account(network, 0)
    assert result.outcomes["lost: bus-off"] == 101
    assert result.balanced


def test_recovery_on_an_idle_bus_takes_128_times_11_bits():
    network = bus(faults=(BusFault("disturb", "n0", count=32),))
    enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
    advance(network, 20 * MS)
    end = int(entries(network)["t_end"].max())
    network = bus(faults=(BusFault("disturb", "n0", count=32),))
    enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
    advance(network, end + 128 * 11 * BIT - 1)
    assert network.nodes["state"][0] == BUS_OFF
    advance(network, end + 128 * 11 * BIT)
    assert network.nodes["state"][0] == ERROR_ACTIVE


def test_single_shot_loses_instead_of_repeating():
    network = bus(faults=(BusFault("disturb", "n0", count=1),), single_shot=True)
    enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
    advance(network, 10 * MS)
    assert account(network, 0).outcomes["lost: single shot"] == 1
    assert account(network, 0).balanced


def test_a_stale_frame_is_not_repeated_where_a_newer_one_waits():
    network = bus(faults=(BusFault("disturb", "n0", value=60, count=1),), policy="replace")
    enqueue(network, 0, 0, 0x100, 1, np.array([1], np.uint8))
    enqueue(network, 0, 50_000, 0x100, 1, np.array([2], np.uint8))
    advance(network, 10 * MS)
    log = entries(network)
    assert list(log[log["outcome"] == DELIVERED]["payload"][:, 0]) == [2]
    assert account(network, 0).outcomes["superseded"] == 1
    assert account(network, 0).balanced


def test_a_lonely_node_becomes_passive_but_never_bus_off():
    network = bus(nodes=1)
    enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
    advance(network, 1_000 * MS)
    assert network.nodes["state"][0] == ERROR_PASSIVE
    assert network.nodes["transmit_errors"][0] == 128
    result = account(network, 0)
    assert result.waiting == 1
    assert result.balanced


def test_a_masquerading_node_with_other_data_drives_both_off_the_bus():
    network = bus(
        nodes=4,
        sources=(
            Source("n0", 0x100, 8, 10 * MS, payload=bytes(8)),
            Source("n1", 0x100, 8, 10 * MS, payload=bytes([255] * 8)),
            Source("n2", 0x300, 8, 10 * MS),
        ),
        recovers=False,
    )
    advance(network, 500 * MS)
    assert list(network.nodes["state"][:2]) == [BUS_OFF, BUS_OFF]
    assert network.nodes["state"][3] != BUS_OFF
    log = entries(network)
    assert not (log[log["ident"] == 0x100]["outcome"] == DELIVERED).any()
    assert account(network, 0).balanced


def test_identical_frames_of_two_nodes_do_not_disturb_each_other():
    network = bus()
    for node in (0, 1):
        enqueue(network, node, 0, 0x100, 8, PAYLOAD)
    advance(network, 10 * MS)
    log = entries(network)
    assert list(log["outcome"]) == [DELIVERED, DELIVERED]
    assert len(set(log["t_received"])) == 1


def test_random_errors_have_the_rate_they_are_given():
    rate = 1e-4
    network = bus(sources=(Source("n0", 0x100, 8, 0.5 * MS),), rate=rate, seed=3)
    destroyed = attempts = 0
    cursor = 0
    expected = 0.0
    for now in range(1, 21):
        advance(network, now * 250 * MS)
        log, cursor, missed = drain(network, cursor)
        assert missed == 0
        attempts += len(log)
        destroyed += int((log["outcome"] == ERROR).sum())
        for entry in log:
            bits = frame_bits(0x100, 0, 8, entry["payload"])[0] - 3
            expected += 1.0 - (1.0 - rate) ** (bits - 1)
    assert attempts > 10_000
    assert abs(destroyed - expected) < 4.0 * np.sqrt(expected)
    assert account(network, 0).balanced


def refusing(*faults, count=1, receiver="n1", **options):
    """A sender n0 and two receivers, the first of which refuses what ``count`` attempts bring."""
    refusal = BusFault("refuse", receiver, ident=0x100, count=count)
    return bus(faults=(refusal, *faults), **options)


def taken(network, node):
    return [int(e["ident"]) for e in entries(network) if took(e["outcome"], e["missed"], node)]


def test_a_frame_that_one_receiver_refuses_reaches_the_others_twice():
    """Inconsistent duplicate: the last but one bit of EOF, disturbed for one receiver alone."""
    network = refusing()
    enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
    advance(network, 10 * MS)
    first, second = entries(network)
    assert (first["outcome"], second["outcome"]) == (REFUSED, DELIVERED)
    assert (taken(network, 1), taken(network, 2)) == ([0x100], [0x100, 0x100])
    bits = frame_bits(0x100, 0, 8, PAYLOAD)[0]
    assert first["t_received"] == (bits - 4) * BIT
    # in place of the last EOF bit the flag; the others' is one bit later, then delimiter and space
    assert first["t_end"] == first["t_received"] + (7 + 8 + 3) * BIT
    assert second["t_start"] == first["t_end"]
    assert list(network.nodes["transmit_errors"]) == [8 - 1, 0, 0]
    # a dominant bit behind its own flag counts 8 for the receiver; the others saw an overload
    assert list(network.nodes["receive_errors"]) == [0, 1 + 8 - 1, 0]
    assert account(network, 0).balanced


def test_it_is_lost_to_one_receiver_where_the_sender_fails_before_it_sends_again():
    """Inconsistent omission, by a sender that fails or that sends only once."""
    for network in (
        refusing(BusFault("node_down", "n0", from_ns=200_000)),
        refusing(single_shot=True),
    ):
        enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
        advance(network, 10 * MS)
        assert (taken(network, 1), taken(network, 2)) == ([], [0x100])
        assert account(network, 0).balanced
        assert account(network, 0).outcomes["delivered"] == 0


def test_an_error_passive_receiver_misses_a_frame_unnoticed():
    """Its error flag is recessive: nobody sends again."""
    network = refusing()
    network.nodes["receive_errors"][:] = 5, 130, 5
    network.nodes["transmit_errors"][0] = 5
    network.nodes["state"][1], network.segments["disturbed"][0] = ERROR_PASSIVE, 1
    enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
    advance(network, 10 * MS)
    (entry,) = entries(network)
    assert (entry["outcome"], entry["attempts"]) == (DELIVERED, 1)
    assert (taken(network, 1), taken(network, 2)) == ([], [0x100])
    assert list(network.nodes["receive_errors"]) == [5, 131, 4]
    assert network.nodes["transmit_errors"][0] == 4


def test_refusals_are_for_receivers_that_are_there_and_as_often_as_asked():
    network = refusing(BusFault("node_down", "n1", until_ns=1 * MS), count=2)
    for place, ident in enumerate((0x100, 0x101, 0x100, 0x100)):
        enqueue(network, 0, place * MS, ident, 8, PAYLOAD)
    advance(network, 10 * MS)
    refused = [int(e["t_queued"]) // MS for e in entries(network) if e["outcome"] == REFUSED]
    assert refused == [2, 2]
    with pytest.raises(CanrollError, match="'refuse' needs a target node"):
        refusing(receiver=None)


def test_a_gateway_forwards_what_it_has_taken_and_not_what_it_refused():
    def forwarded(receiver):
        network = build_network(
            NetworkSpec(
                (Segment(500_000), Segment(500_000)),
                (Node("a"), Node("b"), Node("g"), Node("h", 1), Node("z", 1)),
                gateways=(Gateway("g", "h", TimeSpread(1 * MS, 1 * MS)),),
                faults=(BusFault("refuse", receiver, count=1),),
            )
        )
        enqueue(network, 0, 0, 0x100, 8, PAYLOAD)
        advance(network, 10 * MS)
        found = entries(network)
        return int(((found["segment"] == 1) & (found["outcome"] == DELIVERED)).sum())

    assert (forwarded("g"), forwarded("b")) == (1, 2)
