"""From logs of simulated buses, whose truth is known, to periods, jitter and bounds."""

from itertools import pairwise

import can
import numpy as np
import pytest

from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.can_bus import DELIVERED, Node, advance, build_network, drain, enqueue
from canroll.plant_sim.can_bus.bounds.analysis import response_bounds
from canroll.plant_sim.can_bus.kernel.network import add_node
from canroll.plant_sim.can_bus.simulation.response_times import traffic_spec
from canroll.plant_sim.can_bus.traffic.arrivals import find_arrivals
from canroll.plant_sim.can_bus.traffic.inference import infer_buses
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD

MS = 1_000_000
SECONDS = 8
EVENTS = 0x7A
SUFFIXES = (".asc", ".blf", ".log", ".pcap", ".pcapng")


def infer_bus(path, **options):
    (bus,) = infer_buses(path, **options)
    return bus


def frame_of(entry, channel=0, shift_s=0.0):
    flags = int(entry["flags"])
    return can.Message(
        timestamp=1.7e9 + shift_s + int(entry["t_received"]) * 1e-9,
        arbitration_id=int(entry["ident"]),
        is_extended_id=bool(flags & EXTENDED),
        is_fd=bool(flags & FD),
        bitrate_switch=bool(flags & BIT_RATE_SWITCH),
        data=bytes(entry["payload"][: entry["length"]]),
        channel=channel,
    )


def write(path, entries, **options):
    with can.Logger(str(path)) as logger:
        for entry in entries:
            logger(frame_of(entry, **options))
    return path


def record(messages, *, bitrate, data_bitrate=0, seed=0, events=(), seconds=SECONDS):
    """Return what a bus delivers; ``events``: (ns, identifier) of further frames of 8 bytes."""
    spec = traffic_spec(messages, bitrate=bitrate, data_bitrate=data_bitrate, seed=seed)
    network = build_network(spec)
    node = add_node(network, Node("events", policy="priority", capacity=4096))
    payload = np.arange(8, dtype=np.uint8)
    cursor, found, waiting = 0, [], sorted(events)
    for now in range(100 * MS, seconds * 1000 * MS + 1, 100 * MS):
        while waiting and waiting[0][0] <= now:
            t_ns, ident = waiting.pop(0)
            enqueue(network, node, t_ns, ident, 8, payload)
        advance(network, now)
        entries, cursor, missed = drain(network, cursor)
        assert missed == 0
        found.append(entries[entries["outcome"] == DELIVERED])
    return np.concatenate(found)


def poisson(rng, *, mean_ms, least_ms, seconds=SECONDS):
    """Instants at random, never closer than ``least_ms``."""
    count = int(seconds * 1000 / mean_ms)
    steps = least_ms + rng.exponential(mean_ms - least_ms, count)
    return np.round(np.cumsum(steps) * MS).astype(int)


def a_bus(seed):
    """A random set with its bit rates: classic and FD, 11 and 29 bits, jitter, joint offsets."""
    rng = np.random.default_rng(seed)
    bitrate = int(rng.choice([125_000, 250_000, 500_000]))
    fd = seed % 4 == 3
    flags = int(FD | BIT_RATE_SWITCH) if fd else 0
    scale = 500_000 // bitrate
    joint = seed % 3 == 0
    messages = []
    for ident in rng.choice(np.arange(0x80, 0x7F0), int(rng.integers(8, 26)), replace=False):
        period = int(rng.choice([10, 20, 50, 100])) * MS * scale
        wide = seed % 5 == 4 and ident % 2
        messages.append(
            BusMessage(
                f"m{ident}",
                int(ident) << 18 if wide else int(ident),
                int(rng.choice([0, 2, 4, 8, *([16, 32] if fd else [])])),
                period * (1.0 + float(rng.uniform(-1e-4, 1e-4))),
                f"node{ident % 4}",
                jitter_ns=int(rng.choice([0.0, 0.01, 0.1, 0.2]) * period),
                offset_ns=0 if joint else int(rng.integers(period)),
                flags=flags | (EXTENDED if wide else 0),
            )
        )
    return rng, bitrate, 2_000_000 if fd else 0, messages


@pytest.mark.parametrize("seed", range(20))
def test_a_log_gives_back_its_bus_and_bounds_every_response(tmp_path, seed):
    rng, bitrate, data_bitrate, messages = a_bus(seed)
    events = [(t, EVENTS) for t in poisson(rng, mean_ms=60, least_ms=4)] if seed % 2 else []
    entries = record(messages, bitrate=bitrate, data_bitrate=data_bitrate, seed=seed, events=events)
    rates = {"bitrate": bitrate, "data_bitrate": data_bitrate}
    bus = infer_bus(write(tmp_path / f"bus{SUFFIXES[seed % 5]}", entries), **rates)
    found = {(m.message.ident, m.message.flags & EXTENDED): m for m in bus.messages}
    bounds = {
        b.message.name: b for b in response_bounds([m.message for m in bus.messages], **rates)
    }
    for truth in messages:
        known = found.pop((truth.ident, truth.flags & EXTENDED))
        assert not known.assumed
        assert known.message.period_ns == pytest.approx(truth.period_ns, rel=0.01)
        assert known.message.length == truth.length
        assert known.message.flags == truth.flags
        own = entries[(entries["ident"] == truth.ident) & (entries["flags"] == truth.flags)]
        bound = bounds[known.message.name]
        since = own["t_queued"] - truth.offset_ns
        nominal = truth.offset_ns + np.floor((since + 1) / truth.period_ns) * truth.period_ns
        assert (own["t_end"] - own["t_queued"]).max() <= bound.queued_ns
        assert (own["t_end"] - nominal).max() <= bound.bound_ns
        assert known.seen_ns <= bound.bound_ns
        assert known.message.jitter_ns >= 0.9 * truth.jitter_ns
    if events:
        key = EVENTS, 0
        own = entries[entries["ident"] == EVENTS]
        assert found.pop(key).assumed
        assert (own["t_end"] - own["t_queued"]).max() <= bounds["Recorded07A"].queued_ns
    assert found == {}


def test_the_curve_of_events_admits_all_of_them_and_few_more(tmp_path):
    """Each window of the log holds at most as many frames as the curve says."""
    times = [k * 200 * MS + burst * 3 * MS for k in range(30) for burst in range(4)]
    entries = record([], bitrate=500_000, events=[(t + 1, EVENTS) for t in times])
    path = write(tmp_path / "events.log", entries)
    (found,) = infer_bus(path, bitrate=500_000).messages
    curve = found.message
    assert found.assumed
    assert curve.distance_ns == pytest.approx(3 * MS, rel=0.01)
    for window in (1 * MS, 3.5 * MS, 7 * MS, 10 * MS, 150 * MS, 250 * MS):
        seen = max(sum(t <= other < t + window for other in times) for t in times)
        most = min(
            -(-(window + curve.jitter_ns) // curve.period_ns),
            -(-window // max(curve.distance_ns, 1)),
        )
        assert seen <= most <= 2 * seen + 1


def test_missing_frames_change_neither_period_nor_jitter(tmp_path):
    message = BusMessage("a", 0x100, 8, 10.0 * MS, "a", jitter_ns=MS, offset_ns=3 * MS)
    entries = record([message], bitrate=500_000)
    kept = np.delete(entries, [50, 51, 400])
    (found,) = infer_bus(write(tmp_path / "lost.blf", kept), bitrate=500_000).messages
    assert not found.assumed
    assert found.message.period_ns == pytest.approx(10 * MS, rel=1e-4)
    assert found.message.jitter_ns <= 1.1 * MS


def test_what_a_set_clock_moved_is_neither_missing_nor_a_change_of_period(tmp_path):
    """A quarter of the frames is one second late: they are cut out, as never recorded."""
    message = BusMessage("a", 0x100, 8, 10.0 * MS, "a", jitter_ns=MS, offset_ns=3 * MS)
    entries = record([message], bitrate=500_000, seconds=4)
    entries["t_received"][100:200] += 1000 * MS
    bus = infer_bus(write(tmp_path / "set.blf", entries), bitrate=500_000)
    assert any("the times step forward by 1.01" in remark for remark in bus.recording.remarks)
    (found,) = bus.messages
    assert not found.assumed
    assert found.frames == len(entries) - 100
    assert found.message.period_ns == pytest.approx(10 * MS, rel=1e-4)
    assert found.message.jitter_ns <= 1.1 * MS


@pytest.mark.parametrize("phase", [3, 5, 8])
def test_a_node_that_starts_again_has_its_jump_of_phase_as_jitter(tmp_path, phase):
    first = BusMessage("a", 0x100, 8, 10.0 * MS, "a", offset_ns=0)
    entries = record([first], bitrate=500_000, seconds=2)
    again = entries.copy()
    again["t_received"] += (1_990 + phase) * MS
    path = write(tmp_path / "again.blf", np.concatenate([entries, again]))
    (found,) = infer_bus(path, bitrate=500_000).messages
    assert found.message.period_ns == pytest.approx(10 * MS, rel=0.01)
    # two frames come nearer to each other than the period by that much
    assert 0.9 * (10 - phase) * MS <= found.message.jitter_ns <= 10 * MS


def test_error_frames_are_counted_and_what_they_disturb_was_queued_before(tmp_path):
    message = BusMessage("a", 0x100, 8, 10.0 * MS, "a")
    entries = record([message], bitrate=500_000, seconds=2)
    path = tmp_path / "errors.asc"
    with can.Logger(str(path)) as logger:
        for place, entry in enumerate(entries):
            frame = frame_of(entry)
            if place % 4 == 1:
                broken = can.Message(timestamp=frame.timestamp - 0.0003, is_error_frame=True)
                broken.channel = 0
                logger(broken)
            logger(frame)
    bus = infer_bus(path, bitrate=500_000)
    assert bus.recording.errors == len(entries) // 4
    assert bus.messages[0].message.jitter_ns >= 300_000


def test_every_channel_is_a_bus(tmp_path):
    _, bitrate, _, messages = a_bus(1)
    entries = record(messages, bitrate=bitrate, seconds=3)
    other = record([BusMessage("b", 0x55, 8, 20.0 * MS, "b")], bitrate=bitrate, seconds=3)
    path = tmp_path / "two.asc"
    frames = [frame_of(e) for e in entries] + [frame_of(e, channel=1) for e in other]
    with can.Logger(str(path)) as logger:
        for frame in sorted(frames, key=lambda f: f.timestamp):
            logger(frame)
    one, two = infer_buses(path, bitrate=bitrate)
    assert len(one.messages) == len(messages)
    assert [m.message.ident for m in two.messages] == [0x55]
    assert infer_bus(path, channel=two.channel, bitrate=bitrate).messages == two.messages
    with pytest.raises(UnknownNameError, match="channel of"):
        infer_buses(path, channel="7", bitrate=bitrate)


def test_the_messages_come_in_the_order_of_arbitration(tmp_path):
    _, bitrate, _, messages = a_bus(4)
    entries = record(messages, bitrate=bitrate, seconds=3)
    bus = infer_bus(write(tmp_path / "order.blf", entries), bitrate=bitrate)
    keys = [m.message.arbitration_key for m in bus.messages]
    assert all(one < next_one for one, next_one in pairwise(keys))


def test_a_log_without_a_stated_rate_asks_for_it_in_its_name(tmp_path):
    classic = record([BusMessage("a", 0x55, 8, 20.0 * MS, "a")], bitrate=500_000, seconds=1)
    path = write(tmp_path / "classic.log", classic)
    with pytest.raises(CanrollError, match=r"classic\.log: channel can0: .* as @500000$"):
        infer_buses(path)
    fast = BusMessage("b", 0x55, 24, 20.0 * MS, "b", flags=int(FD | BIT_RATE_SWITCH))
    entries = record([fast], bitrate=500_000, data_bitrate=2_000_000, seconds=1)
    path = write(tmp_path / "fd.log", entries)
    with pytest.raises(CanrollError, match=r"as @500000/2000000$"):
        infer_buses(path, bitrate=500_000)


def test_frames_sooner_than_the_stated_rate_allows_are_counted(tmp_path):
    messages = [BusMessage(f"m{k}", 0x50 + k, 8, 10.0 * MS, "a") for k in range(8)]
    path = write(tmp_path / "bus.blf", record(messages, bitrate=500_000, seconds=2))
    assert infer_bus(path, bitrate=500_000).too_close == 0.0
    assert infer_bus(path, bitrate=250_000).too_close > 0.8


@pytest.mark.parametrize("seed", range(12))
def test_a_curve_admits_any_choice_of_instants_within_their_intervals(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 120))
    steps = rng.choice([1, 2, 3, 50], count) if seed % 3 else rng.exponential(1.0, count)
    latest = np.sort(np.cumsum(steps * 10 * MS) + rng.uniform(0, 8 * MS, count)).astype(np.int64)
    earliest = latest - rng.integers(0, 4 * MS, count)
    found = find_arrivals(earliest, latest, duration_ns=int(latest[-1]))
    apart = np.arange(count)[None, :] - np.arange(count)[:, None]
    nearest = (earliest[None, :] - latest[:, None])[apart > 0]
    least = apart[apart > 0] * found.period - found.jitter
    assert (nearest >= least - 1).all()
    assert ((latest - earliest).max() > 0) == (found.jitter > 0)
    assert (found.releases <= earliest + 1e-3).all()
    assert (np.diff(found.releases) >= found.period - 1e-3).all()
