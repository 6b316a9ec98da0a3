"""A bus log as bus profile: the bounds of a design, the load of a run."""

from dataclasses import replace

import can
import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus import (
    DELIVERED,
    NODES,
    advance,
    build_network,
    drain,
    load_profile,
    make_network,
    recorded_traffic,
)
from canroll.plant_sim.can_bus.bounds.analysis import response_bounds
from canroll.plant_sim.can_bus.bounds.delay_bounds import delay_bounds
from canroll.plant_sim.can_bus.network.own_frames import DEFAULT_COMMAND, own_messages
from canroll.plant_sim.can_bus.network.profiles import profile_spec
from canroll.plant_sim.can_bus.simulation.response_times import traffic_spec
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from tests.support.background import background_of

MS = 1_000_000


def recording(path, messages, *, seconds=5, channels=(0,)):
    network = build_network(traffic_spec(messages, bitrate=250_000, seed=3))
    frames, cursor = [], 0
    for now in range(100, seconds * 1000 + 1, 100):
        advance(network, now * MS)
        entries, cursor, _ = drain(network, cursor)
        frames += [
            can.Message(
                timestamp=1.7e9 + e["t_received"] * 1e-9,
                arbitration_id=int(e["ident"]),
                is_extended_id=False,
                data=bytes(e["payload"][: e["length"]]),
                channel=channels[k % len(channels)],
            )
            for k, e in enumerate(entries)
        ]
    with can.Logger(str(path)) as logger:
        for frame in frames:
            logger(frame)
    return f"{path}@250000"


def others(count=12):
    """Messages of odd identifiers, jittery, with periods that no loop is a multiple of."""
    rows = [(0x11 + 0x10 * k, (7, 13, 31)[k % 3]) for k in range(count)]
    return [
        BusMessage(f"m{i}", i, 8, p * MS * 1.01, f"n{i % 3}", jitter_ns=(i % 4) * 300_000)
        for i, p in rows
    ]


def test_a_run_on_a_recorded_bus_carries_its_frames_from_a_phase_of_the_seed(tmp_path):
    profile = load_profile(recording(tmp_path / "bus.blf", others()))

    def frames(seed):
        network = make_network(profile, seed=seed)
        player = recorded_traffic(network, profile, command=DEFAULT_COMMAND, seed=seed)
        found, cursor = [], 0
        for now in range(200, 14_001, 200):
            player.feed(now * MS)
            advance(network, now * MS)
            entries, cursor, missed = drain(network, cursor)
            assert missed == 0
            found.append(entries[entries["outcome"] == DELIVERED])
        return np.concatenate(found)

    one = frames(1)
    assert one.tobytes() == frames(1).tobytes()
    other = frames(2)
    assert other[0]["t_queued"] != one[0]["t_queued"] or other[0]["ident"] != one[0]["ident"]
    # nearly three times the five seconds recorded, at the recorded rate, each within its bound
    bounds = response_bounds(
        background_of(profile, 0), bitrate=profile.bitrate, data_bitrate=profile.data_bitrate
    )
    for seen in (one, other):
        for bound in bounds:
            own = seen[seen["ident"] == bound.message.ident]
            assert len(own) == pytest.approx(14e9 / bound.message.period_ns, rel=0.02)
            assert (own["t_end"] - own["t_queued"]).max() <= bound.queued_ns
            # the seam of the loop brings no frame that the arrival curve does not admit
            times = np.sort(own["t_queued"])
            for apart in (1, 2, 5, 40):
                least = apart * bound.message.period_ns - bound.message.jitter_ns
                assert (times[apart:] - times[:-apart]).min() >= least - 2


def test_a_design_takes_the_delay_of_the_recorded_bus(tmp_path):
    quiet = delay_bounds(load_profile(recording(tmp_path / "quiet.blf", others(6))))
    busy = delay_bounds(load_profile(recording(tmp_path / "busy.blf", others(20))))
    assert quiet.age_max < busy.age_max
    assert busy.age_min == pytest.approx(quiet.age_min)


def test_own_messages_in_the_log_are_not_sent_twice(tmp_path):
    sent = [*others(6), *own_messages()]
    profile = load_profile(recording(tmp_path / "ours.blf", sent))
    assert {m.ident for m in background_of(profile, 0)} == {m.ident for m in others(6)}
    spec = profile_spec(profile)
    assert spec.sources == ()
    assert [node.name for node in spec.nodes][: len(NODES)] == list(NODES)


def on_events(name, ident, seed=1):
    """Leave half of the frames of one identifier out of a log, at random."""
    path = name.partition("@")[0]
    random = np.random.default_rng(seed)
    with can.LogReader(path) as log:
        frames = list(log)
    with can.Logger(path) as logger:
        for frame in frames:
            if frame.arbitration_id != ident or random.random() < 0.5:
                logger(frame)
    return name


def test_own_messages_on_events_are_not_sent_twice(tmp_path):
    command = next(m for m in own_messages() if m.name == DEFAULT_COMMAND)
    path = recording(tmp_path / "ours.blf", [*others(6), *own_messages()])
    profile = load_profile(on_events(path, command.ident))
    found = next(m for m in profile.bus.messages if m.message.ident == command.ident)
    assert found.assumed
    assert {m.ident for m in background_of(profile, 0)} == {m.ident for m in others(6)}


def test_own_commands_by_heartbeat_alone_are_not_sent_twice(tmp_path):
    """A car that drives straight is sent a command every fifth tick."""
    ours = [
        replace(m, period_ns=5 * m.period_ns) if m.name == DEFAULT_COMMAND else m
        for m in own_messages()
    ]
    profile = load_profile(recording(tmp_path / "ours.blf", [*others(6), *ours]))
    assert {m.ident for m in background_of(profile, 0)} == {m.ident for m in others(6)}


def test_an_identifier_on_events_that_is_alone_in_the_log_is_of_others(tmp_path):
    command = next(m for m in own_messages() if m.name == DEFAULT_COMMAND)
    path = recording(tmp_path / "taken.blf", [*others(6), command])
    with pytest.raises(CanrollError, match=f"identifier 0x{command.ident:X} is on that bus"):
        background_of(load_profile(on_events(path, command.ident)), 0)


def test_an_identifier_that_others_use_is_refused(tmp_path):
    path = recording(tmp_path / "taken.blf", [*others(8), BusMessage("x", 0xA0, 8, 20.0 * MS, "x")])
    with pytest.raises(
        CanrollError, match=r"identifier 0xA0 is on that bus already \(8 bytes ever"
    ):
        delay_bounds(load_profile(path))


@pytest.mark.slow
def test_one_of_several_channels_is_named_behind_the_file(tmp_path):
    path = recording(tmp_path / "two.asc", others(16), channels=(0, 0, 0, 1), seconds=10)
    with pytest.raises(CanrollError, match=r"choose a channel of it: .*two\.asc#0"):
        load_profile(path)
    assert load_profile(f"{path}#0").bus.channel == "0"
    with pytest.raises(CanrollError, match=r"unknown channel of .*two\.asc '5'"):
        load_profile(f"{path}#5")


def test_a_log_that_is_not_there_is_one_line():
    with pytest.raises(CanrollError, match=r"nowhere\.blf: no such file"):
        load_profile("nowhere.blf")
