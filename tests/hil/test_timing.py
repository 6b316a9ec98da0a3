"""Timing figures: quantiles, histograms, latency, losses, budgets."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canroll.errors import CanrollError
from canroll.hil import budget, session, timing
from canroll.hil.plant_record import PlantRecord
from canroll.hil.tick_trace import FRAMES, TICKS, TickTrace
from canroll.plant_sim.can_bus.kernel.layout import DELIVERED, log_dtype
from canroll.plant_sim.world.recording import COMMAND
from canroll.runs.experiment import plan

MS = 1_000_000


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=300))
def test_a_quantile_has_its_share_at_or_below_it(values):
    values = np.array(values)
    found = timing.quantiles(values)
    for name, share in timing.QUANTILES.items():
        value = round(found[name] * 1000)
        assert value in values
        assert np.mean(values <= value) >= share - 1e-12
        assert np.mean(values < value) < share or share == 0.0
    assert timing.quantiles(values[:0]) is None


@given(st.lists(st.integers(0, 10**8), min_size=1, max_size=300))
def test_a_histogram_holds_every_value_once(values):
    core = timing.histogram(np.array(values))
    assert sum(core["histogram"].values()) == core["count"] == len(values)
    bins = [int(name) for name in core["histogram"]]
    assert (min(bins), max(bins)) == (core["min"], core["max"])
    mean = sum(int(b) * n for b, n in core["histogram"].items()) / len(values)
    assert core["avg"] == pytest.approx(mean)


def test_the_file_is_what_jitterdebugger_writes():
    data = json.loads(json.dumps(timing.jitterdebugger({1: np.array([1500, 2500, 2600])})))
    assert data["version"] == 3
    assert set(data["sysinfo"]) == {
        "sysname",
        "nodename",
        "release",
        "version",
        "machine",
        "cpus_online",
    }
    core = {"histogram": {"1": 1, "2": 2}, "count": 3, "min": 1, "max": 2, "avg": 5 / 3}
    assert data["cpu"] == {"1": core}


def frames_log(rows):
    log = np.zeros(len(rows), log_dtype())
    for entry, (ident, sender, origin, received, payload) in zip(log, rows, strict=True):
        entry["ident"], entry["sender"] = ident, sender
        entry["t_origin"] = entry["t_queued"] = origin
        entry["t_received"] = received
        entry["payload"][:8] = list(payload)
        entry["outcome"] = DELIVERED
    return log


def tick_trace(calibration, ticks):
    """A trace of (start ns, frames); a frame is (ident, sent, payload)."""
    rows = np.zeros(len(ticks), TICKS)
    frames = []
    for number, (row, (start, of_tick)) in enumerate(zip(rows, ticks, strict=True), 1):
        row["number"], row["elapsed"], row["frames"] = number, 1, len(of_tick)
        row["start_ns"] = row["deadline_ns"] = start
        row["end_ns"] = start + MS
        frames += [(ident, sent, 8, 0, list(payload)) for ident, sent, payload in of_tick]
    return TickTrace(calibration, rows, np.array(frames, dtype=FRAMES), {})


def command(counter):
    return bytes([0, counter, 0, 0, 0, 0, 0, 0])


def test_latency_counts_from_the_sample_that_the_tick_had_read(calibration):
    """The second Imu frame reaches the bus while the tick computes: it is not the one used."""
    start = 5_000 * MS
    first, second = bytes([1] * 8), bytes([2] * 8)
    trace = tick_trace(
        calibration,
        [
            (start + 10 * MS, [(0xA0, 0, first), (0x80, 1, command(3))]),
            (start + 20 * MS, [(0xA0, 0, second)]),
            (start + 30 * MS, [(0x80, 1, command(4))]),
        ],
    )
    log = frames_log(
        [
            (0xA0, 1, 4 * MS, 5 * MS, first),
            (0xA0, 1, 10 * MS, 11 * MS, second),
            (0x80, 0, 12 * MS, 13 * MS, command(3)),
        ]
    )
    commands = np.array([(-1, 12 * MS, 13 * MS, 14 * MS, 3), (-1, 31 * MS, 32 * MS, 33 * MS, 4)],
                        dtype=COMMAND)  # fmt: skip
    ages = timing.latencies(trace, commands, log, start_ns=start, sensor_latency_ns=MS)
    assert ages.tolist() == [(14 - 3) * MS, (33 - 9) * MS]


def test_a_command_is_told_from_the_one_a_round_of_the_counter_before(calibration):
    """The plant's clock may be read just before the tick that sent the command started."""
    samples = [bytes([k] * 8) for k in range(1, 33)]
    ticks = [
        (k * 50 * MS, [(0xA0, 0, samples[k]), (0x80, 1, command(k % 15))]) for k in range(1, 31)
    ]
    log = frames_log(
        [(0xA0, 1, k * 50 * MS - 5 * MS, k * 50 * MS - 4 * MS, samples[k]) for k in range(1, 31)]
    )
    early = 1500 * MS - 20_000
    commands = np.array([(-1, early, early + MS, 1502 * MS, 0)], dtype=COMMAND)
    trace = tick_trace(calibration, ticks)
    ages = timing.latencies(trace, commands, log, start_ns=0, sensor_latency_ns=0)
    assert ages.tolist() == [7 * MS]


def test_a_plant_that_stood_still_makes_no_sample_younger_than_its_command(calibration):
    """It reads the clock, stands still for 300 ms, and only then reads what came meanwhile."""
    same = bytes([1] * 8)
    ticks = [(k * 50 * MS, [(0xA0, 0, same), (0x80, 1, command(k % 15))]) for k in range(1, 15)]
    # the vehicle drives straight: its samples have the same bytes before the standstill and after
    log = frames_log([(0xA0, 1, t * MS, (t + 1) * MS, same) for t in range(40, 700, 10)])
    commands = np.array([(-1, 100 * MS, 101 * MS, 102 * MS, 8)], dtype=COMMAND)
    trace = tick_trace(calibration, ticks)
    ages = timing.latencies(trace, commands, log, start_ns=0, sensor_latency_ns=0)
    assert ages.tolist() == [12 * MS]


def test_a_command_of_another_sender_has_no_latency(calibration):
    trace = tick_trace(calibration, [(10 * MS, [(0xA0, 0, bytes(8)), (0x80, 1, command(1))])])
    log = frames_log([(0xA0, 1, MS, 2 * MS, bytes(8))])
    commands = np.array([(-1, 12 * MS, 13 * MS, 14 * MS, 9)], dtype=COMMAND)
    assert not len(timing.latencies(trace, commands, log, start_ns=0, sensor_latency_ns=0))


@pytest.mark.parametrize(("received", "lost"), [(7, 0), (5, 2), (9, 0)])
def test_frames_that_never_arrive_are_counted(calibration, received, lost):
    ticks = tick_trace(calibration, [(10 * MS, []), (20 * MS, [])])
    ecu = TickTrace(calibration, ticks.ticks, ticks.frames, {"received": received})
    none = np.zeros(0)
    plant = PlantRecord({}, none, none, none, np.zeros((100, 2), np.int64),
                        {"start_ns": 0, "end_ns": 100 * MS, "sent": 7, "received": 0})  # fmt: skip
    assert session.frames_lost(plant, ecu) == lost


def test_a_budget_comes_from_its_table():
    assert budget.budget_of({}) == budget.Budget(None, None, None, None, 0)
    table = {"cycles": 9000, "tick_p99_us": 500.0, "latency_p99_us": 30_000, "misses": 2}
    assert budget.budget_of({"budget": table}) == budget.Budget(None, 9000, 500.0, 30_000, 2)
    for wrong in ({"tick_p99": 3}, {"misses": -1}, {"misses": "none"}, {"misses": True}):
        with pytest.raises(CanrollError, match=r"\[budget\]"):
            budget.budget_of({"budget": wrong})


def test_a_run_is_judged_only_on_two_cores():
    limits = budget.Budget(None, 500.0, 30_000, 0)
    ran = {
        "judged": True,
        "deadline_misses": 0,
        "tick_us": {"p99": 499.0},
        "latency_us": {"p99": 30_001.0},
    }
    verdicts = {v.name: v.ok for v in budget.judge_host(limits, ran)}
    assert verdicts == {"misses": True, "tick_p99_us": True, "latency_p99_us": False}
    assert not budget.judge_host(limits, ran | {"judged": False})
    unmeasured = budget.judge_host(limits, ran | {"latency_us": None})
    assert [v.ok for v in unmeasured] == [True, True, False]
    assert [v.ok for v in budget.judge_target(budget.Budget(20_000), 20_001)] == [False]
    assert budget.judge_target(budget.Budget(), 20_001) == []


def test_the_plant_is_told_all_that_makes_the_world(tmp_path):
    """What the settings say comes back out of the plant's own options."""
    from canroll.cli.main import parse
    from canroll.cli.plant import world_of
    from canroll.runs.experiment import build_world

    settings, _ = plan(
        "double_lane_change",
        law="lqr",
        actuator="bars",
        bus="gateway_20ms",
        seed=3,
        speed_kmh=70,
        faults=["Imu.RollRate=offset:0.1@0.05:0.2", "front_left=weak:0.5@0.1"],
        conditions={"noise": 2, "filtered": False, "supply": 10.5},
    )
    setup = session.Setup(
        bus_options=(), folder=tmp_path, cores=None, duration=None, announce=print
    )
    session.save_vehicle(settings, setup)
    arguments = session.plant_arguments(settings, setup, enabled=False)
    theirs = world_of(parse(arguments))
    ours = build_world(settings, enabled=False)
    for world in (ours, theirs):
        world.advance(300 * MS)
    assert ours.frames.tobytes() == theirs.frames.tobytes()
    assert all(np.array_equal(ours.signals[n], theirs.signals[n]) for n in ours.signals)
