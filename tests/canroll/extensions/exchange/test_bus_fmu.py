"""The bus's FMU delivers the frames of the bus simulation, in the same nanoseconds."""

import struct
from dataclasses import replace

import can
import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from support.fmus import EXTENDED, importer, transmit

from canroll.extensions.exchange import bus_fmu
from canroll.plant_sim import can_bus
from canroll.plant_sim.can_bus import BusFault, NetworkSpec, Node, Segment
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, FD, FD_LENGTHS
from canroll.plant_sim.can_bus.wire.frame import EXTENDED as EXTENDED_FLAG

pytestmark = pytest.mark.slow

frames_of = importer().frames_of
CONFIRM, BUS_ERROR = 0x20, 0x31
NODES = ("A", "B", "C", "D")


def spec(**changes):
    nodes = tuple(Node(name, policy="fifo" if name == "D" else "priority") for name in NODES)
    plain = NetworkSpec(segments=(Segment(500_000, 2_000_000),), nodes=nodes, seed=3)
    return replace(plain, log_capacity=1 << 15, **changes)


def traffic(count, seed, *, mean_ns=230_000):
    """Instant, node, identifier, data and flags of random frames of all kinds."""
    rng = np.random.default_rng(seed)
    t = 0
    for _ in range(count):
        t += int(rng.exponential(mean_ns)) if rng.random() < 0.9 else 0
        node = int(rng.integers(len(NODES)))
        flags = int(rng.choice([0, EXTENDED_FLAG, FD, FD | BIT_RATE_SWITCH]))
        low = int(rng.integers(1 << 29 if flags & EXTENDED_FLAG else 1 << 11))
        # no two nodes send the same identifier, which would be a collision
        ident = low & ~3 | node
        length = int(rng.choice(FD_LENGTHS)) if flags & FD else int(rng.integers(9))
        yield t, node, ident, rng.bytes(length), flags


def messages(count, seed, kinds=40, **options):
    """The same with few identifiers, as a network has room for only so many."""
    known = list(traffic(kinds, seed + 1))
    rng = np.random.default_rng(seed + 2)
    for t, _, _, _, _ in traffic(count, seed, **options):
        _, node, ident, data, flags = known[int(rng.integers(kinds))]
        yield t, node, ident, rng.bytes(len(data)), flags


def operation(ident, data, flags):
    ident |= EXTENDED if flags & EXTENDED_FLAG else 0
    return transmit(ident, data, fd=bool(flags & FD), switched=bool(flags & BIT_RATE_SWITCH))


def simulated(network, frames):
    """Receptions by node: instant, sender's identifier, data."""
    found = {k: [] for k in range(len(NODES))}
    errors, cursor = [], 0
    for number, (t, node, ident, data, flags) in enumerate(frames):
        payload = np.frombuffer(data, np.uint8)
        can_bus.enqueue(network, node, t, ident, len(data), payload, flags)
        if number % 200 == 199:
            can_bus.advance(network, t - 1)
            cursor = drained(network, cursor, found, errors)
    can_bus.advance(network, frames[-1][0] + 10**9)
    drained(network, cursor, found, errors)
    return found, errors


def drained(network, cursor, found, errors):
    entries, cursor, missed = can_bus.drain(network, cursor)
    assert missed == 0
    for entry in entries:
        ident = int(entry["ident"]) | (EXTENDED if entry["flags"] & EXTENDED_FLAG else 0)
        if entry["outcome"] == can_bus.ERROR:
            errors.append((int(entry["t_received"]), ident & (EXTENDED - 1)))
        for node, its in found.items():
            if node != entry["sender"] and can_bus.took(entry["outcome"], entry["missed"], node):
                data = entry["payload"][: entry["length"]].tobytes()
                its.append((int(entry["t_received"]), ident, data))
    return cursor


def exchanged(path, frames, parameters=None):
    """The same of the FMU, stepped from event to event."""
    fmu = importer().Fmu(path, parameters)
    found = {k: [] for k in range(len(NODES))}
    errors, at = [], 0
    end = frames[-1][0] + 10**9
    while True:
        tick = fmu.next_tick("A")
        now = min([end, *([frames[at][0]] if at < len(frames) else []), *([tick] if tick else [])])
        fmu.advance(now)
        if now == end:
            break
        for port, sent in fmu.read(NODES if now == tick else ()).items():
            for ident, data in frames_of(sent):
                found[NODES.index(port)].append((now, ident, data))
            errors += [(now, ident) for ident in errors_in(sent) if port == "A"]
        given = {}
        while at < len(frames) and frames[at][0] == now:
            _, node, ident, data, flags = frames[at]
            given[NODES[node]] = given.get(NODES[node], b"") + operation(ident, data, flags)
            at += 1
        fmu.give(given)
    return found, errors, fmu


def errors_in(operations):
    while operations:
        code, size = struct.unpack_from("<II", operations)
        if code == BUS_ERROR:
            yield struct.unpack_from("<I", operations, 8)[0]
        operations = operations[size:]


def written(tmp_path, network):
    path = tmp_path / "bus.fmu"
    bus_fmu.write(path, network, {name: k for k, name in enumerate(NODES)}, title="bus of a test")
    return path


def same(tmp_path, frames, its, parameters=None):
    path = written(tmp_path, can_bus.build_network(its))
    reference, errors = simulated(can_bus.build_network(its), frames)
    found, seen, fmu = exchanged(path, frames, parameters)
    assert found == reference
    return reference, errors, seen, fmu


def test_frames_of_all_kinds(tmp_path):
    reference, _, _, _ = same(tmp_path, list(messages(1500, 1)), spec())
    assert sum(map(len, reference.values())) == 3 * 1500


@pytest.mark.long
def test_a_hundred_thousand_frames(tmp_path):
    reference, _, _, _ = same(tmp_path, list(messages(100_000, 4, mean_ns=400_000)), spec())
    assert sum(map(len, reference.values())) == 3 * 100_000


def test_disturbed_frames_are_sent_again(tmp_path):
    its = spec()
    its = replace(its, segments=(replace(its.segments[0], bit_error_rate=1e-3),))
    reference, errors, seen, _ = same(tmp_path, list(messages(600, 2)), its)
    assert len(errors) > 30
    assert seen == errors
    assert sum(map(len, reference.values())) == 3 * 600


def test_a_node_goes_bus_off_and_comes_back(tmp_path):
    faults = (BusFault("disturb", target="B", from_ns=5_000_000, until_ns=60_000_000),)
    frames = list(messages(800, 7))
    reference, errors, seen, fmu = same(tmp_path, frames, spec(faults=faults))
    assert seen == errors
    assert sum(map(len, reference.values())) < 3 * 800
    assert fmu.get("B.state") == [0]
    totals = fmu.get("segment[1].totals")
    assert totals[can_bus.OUTCOMES.index("lost: bus-off")] > 0


def test_the_standard_is_met_and_fmpy_simulates_it(tmp_path):
    network = can_bus.make_network(can_bus.load_profile("gateway_20ms"), seed=2)
    path = tmp_path / "bus.fmu"
    ports = {name: k for k, name in enumerate(can_bus.NODES)}
    bus_fmu.write(path, network, ports, title="bus of a test")
    assert validate_fmu(str(path)) == []
    result = fmpy.simulate_fmu(str(path), stop_time=0.5, step_size=0.01)
    can_bus.advance(network, 500_000_000)
    assert result["logged"][-1] == can_bus.logged(network) > 300


def test_instants_are_those_of_simbus(tmp_path):
    network = can_bus.build_network(
        NetworkSpec(
            segments=(Segment(500_000),), nodes=tuple(Node(n, policy="fifo") for n in NODES)
        )
    )
    path = written(tmp_path, network)
    given = [(0x123, b"\x00" * 8), (0x7FF, b"\xff\x00\x55"), (0x0, b"")]
    options = {"interface": "simbus", "channel": "fmu", "virtual_time": True, "bitrate": 500_000}
    with can.Bus(**options) as one, can.Bus(**options) as other, can.Bus(**options) as third:
        for ident, data in given:
            one.send(can.Message(arbitration_id=ident, data=data, is_extended_id=False))
            other.send(
                can.Message(arbitration_id=ident + 1 & 0x7FF, data=data, is_extended_id=False)
            )
        received = [third.recv(1.0) for _ in range(6)]
    wanted = [(round(m.timestamp * 1e9), m.arbitration_id, bytes(m.data)) for m in received]
    frames = []
    for ident, data in given:
        frames += [(0, 0, ident, data, 0), (0, 1, ident + 1 & 0x7FF, data, 0)]
    found, _, _ = exchanged(path, frames)
    assert found[2] == wanted


def test_the_bit_rate_is_a_parameter(tmp_path):
    path = written(tmp_path, can_bus.build_network(spec()))
    frames = [(0, 0, 0x10, bytes(8), 0)]
    slow, _, _ = exchanged(path, frames, {"bitrate": 125_000})
    fast, _, _ = exchanged(path, frames)
    assert slow[1][0][0] == 4 * fast[1][0][0]
    with pytest.raises(FMICallException):
        exchanged(path, frames, {"bitrate": 2_000_000})


def test_senders_are_told_of_success(tmp_path):
    path = written(tmp_path, can_bus.build_network(spec()))
    fmu = importer().Fmu(path)
    fmu.read([])
    fmu.give({"A": transmit(0x10, bytes(8))})
    fmu.advance(fmu.next_tick("A"))
    sent = fmu.read(NODES)["A"]
    assert struct.unpack("<III", sent) == (CONFIRM, 12, 0x10)


@pytest.mark.parametrize(
    "operation",
    [
        struct.pack("<IIBI", 0x40, 13, 1, 250_000),
        struct.pack("<IIBB", 0x40, 10, 4, 2),
        transmit(0x10, bytes(9)),
    ],
)
def test_what_the_bus_cannot_do_is_refused(tmp_path, operation):
    fmu = importer().Fmu(written(tmp_path, can_bus.build_network(spec())))
    fmu.read([])
    with pytest.raises(FMICallException):
        fmu.give({"A": operation})
    # still in event mode
    fmu.give({"A": struct.pack("<IIBI", 0x40, 13, 1, 500_000)})
