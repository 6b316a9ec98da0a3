"""The ECU's loop: deadlines, skipped ticks, ends, and the last command."""

import numpy as np
import pytest
from e2e import p01

from canroll import dbc
from canroll.codegen.run.backends import PythonEcu
from canroll.errors import CanrollError
from canroll.firmware import calibration as fw
from canroll.hil import ecu_loop, tick_trace
from canroll.hil.process import Stop
from canroll.plant_sim.world import spool
from canroll.runs import virtual_time
from canroll.runs.experiment import build_world, plan

PERIOD = 10_000_000


class Loop:
    """An ECU that takes as long as it is told and counts what it is given."""

    class state:  # noqa: N801
        mode = 0

    def __init__(self, clock, took):
        self.clock, self.took, self.elapsed = clock, took, []

    def receive(self, ident, payload, length):
        pass

    def tick(self, elapsed):
        self.clock.now += self.took.get(len(self.elapsed), 300_000)
        self.elapsed.append(elapsed)
        return []


def run(clock, bus, calibration, *, took=None, ticks=20, **options):
    ecu = Loop(clock, took or {})
    recorder = tick_trace.TickRecorder(ticks=1000, frames=1000)
    options.setdefault("duration_ns", ticks * PERIOD + 1)
    outcome = ecu_loop.run(ecu, bus, recorder, calibration, stop=Stop(), **options)
    return ecu, recorder.ticks(), outcome


def test_lateness_never_adds_up(clock, list_bus, calibration):
    began = clock.now
    clock.late = {k: 500_000 * (k % 7) for k in range(1000)}
    ecu, ticks, outcome = run(clock, list_bus, calibration, ticks=200)
    assert outcome.misses == 0
    assert set(ecu.elapsed) == {1}
    expected = began + PERIOD * np.arange(1, len(ticks) + 1)
    assert np.array_equal(ticks["deadline_ns"], expected)
    late = ticks["start_ns"] - ticks["deadline_ns"]
    assert np.array_equal(late, [500_000 * (k % 7) for k in range(len(ticks))])


@pytest.mark.parametrize(
    ("took", "skipped"),
    [(9_900_000, 0), (10_000_000, 0), (10_000_001, 1), (29_999_999, 2), (30_000_001, 3)],
)
def test_a_tick_that_runs_over_skips_and_is_counted(clock, list_bus, calibration, took, skipped):
    began = clock.now
    ecu, ticks, outcome = run(clock, list_bus, calibration, took={4: took})
    assert ecu.elapsed[5] == 1 + skipped
    assert ecu.elapsed[6] == 1
    assert outcome.misses == skipped
    assert np.all((ticks["deadline_ns"] - began) % PERIOD == 0)
    assert np.array_equal(np.cumsum(ecu.elapsed), ticks["number"])
    assert np.array_equal(ticks["number"], (ticks["deadline_ns"] - began) // PERIOD)


def test_a_late_wake_up_skips_whole_periods_only(clock, list_bus, calibration):
    clock.late = {3: 9_000_000, 6: 25_000_000}
    ecu, ticks, outcome = run(clock, list_bus, calibration)
    assert ecu.elapsed[3] == 1
    assert ecu.elapsed[6] == 3
    assert outcome.misses == 2
    # the whole lateness shows, not what is left of it after skipping
    assert ticks["start_ns"][6] - ticks["deadline_ns"][6] == 25_000_000
    # nothing is caught up: tick starts stay at least a period's rest apart
    assert np.all(np.diff(ticks["number"]) >= 1)


def test_ends_when_the_vehicle_falls_silent(clock, list_bus, calibration):
    ecu = Loop(clock, {})
    original = ecu.tick

    def tick(elapsed):
        if len(ecu.elapsed) < 30:
            list_bus.waiting.append((0xA0, bytes(8)))
        return original(elapsed)

    ecu.tick = tick
    recorder = tick_trace.TickRecorder(ticks=1000, frames=1000)
    outcome = ecu_loop.run(
        ecu, list_bus, recorder, calibration, stop=Stop(), peer_timeout_ns=800_000_000
    )
    assert outcome.reason == ecu_loop.PEER_LOST
    assert 30 + 80 <= outcome.ticks <= 30 + 82


def test_never_heard_is_not_lost(clock, list_bus, calibration):
    _, _, outcome = run(clock, list_bus, calibration, ticks=300, peer_timeout_ns=500_000_000)
    assert outcome.reason == ecu_loop.DURATION


@pytest.mark.parametrize(
    ("actuator", "message"),
    [
        (fw.SUSPENSION, "SuspensionForceCommand"),
        (fw.BARS, "AntiRollBarCommand"),
        (fw.DAMPERS, "DamperCommand"),
        (fw.VALVES, "ValveCommand"),
    ],
)
def test_the_last_command_asks_for_nothing(calibration, actuator, message):
    import copy

    changed = copy.copy(calibration)
    changed.actuator = actuator
    ident, payload = ecu_loop.zero_command(changed, bytes([0, 14, 9, 9, 9, 9, 9, 9]))
    decoded = dbc.load().decode_message(ident, payload)
    described = dbc.load().get_message_by_name(message)
    assert ident == described.frame_id
    assert decoded.pop("Counter") == 0
    assert str(decoded.pop("Mode")) == "SAFE"
    decoded.pop("Checksum")
    assert set(decoded.values()) == {0}
    assert p01.e2e_p01_check(bytearray(payload), dbc.data_id(described))


def test_stops_on_request_with_the_zero_command_last(clock, list_bus, calibration):
    stop = Stop(requested=True)
    ecu = Loop(clock, {})
    recorder = tick_trace.TickRecorder(ticks=10, frames=10)
    outcome = ecu_loop.run(ecu, list_bus, recorder, calibration, stop=stop)
    assert outcome.reason == ecu_loop.STOPPED
    assert outcome.ticks == 1
    assert [ident for _, ident, _ in list_bus.out] == [0x80]


def test_the_trace_of_a_long_run_does_not_stay_in_memory(monkeypatch):
    """Ten blocks and a bit, with a tick of more frames than a block holds."""
    monkeypatch.setattr(spool, "IN_MEMORY", 0)
    recorder = tick_trace.TickRecorder(ticks=7, frames=20)
    reserved = len(recorder._ticks), len(recorder._frames)
    for number in range(75):
        for k in range(50 if number == 40 else 3):
            recorder.consumed(0x100 + k, bytes([number, k]))
        recorder.sent(0x80, bytes([number]))
        recorder.tick(number, 1, 10 * number, 10 * number + 1, 10 * number + 2)
    recorder.consumed(0x100, b"of no tick")
    ticks, frames = recorder.ticks(), recorder.frames()
    assert (len(recorder._ticks), len(recorder._frames)) == reserved
    assert ticks["number"].tolist() == list(range(75))
    assert ticks["frames"].sum() == len(frames)
    assert ticks["frames"][40] == 51
    assert frames["payload"][:, 0].tolist() == np.repeat(range(75), ticks["frames"]).tolist()
    assert ticks._spool.bytes_in_memory == 0


def test_a_trace_that_cannot_be_written_ends_and_the_loop_goes_on(monkeypatch):
    def no_space(*_):
        raise CanrollError("cannot record the run")

    recorder = tick_trace.TickRecorder(ticks=2, frames=5)
    recorder.tick(0, 1, 0, 0, 0)
    monkeypatch.setattr(spool.Rows, "append", no_space)
    for number in range(1, 20):
        recorder.sent(0x80, b"")
        recorder.tick(number, 1, 0, 0, 0)
    assert recorder.full


class WorldBus:
    """The world behind the link: it is advanced to the clock, and hears a run time later."""

    failed = sent = received = 0

    def __init__(self, world, clock):
        self.world, self.clock, self.origin = world, clock, clock.now
        world.advance(0)

    def receive(self):
        frames = self.world.advance(self.clock.now - self.origin)
        return [(int(f["ident"]), f["payload"][: f["length"]].tobytes()) for f in frames]

    def send(self, ident, payload):
        at = self.clock.now - self.origin + virtual_time.RUN_TIME_NS
        self.world.submit(at, ident, payload)

    def close(self):
        pass


@pytest.fixture(scope="module")
def against_world(make_clock):
    clock = make_clock()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ecu_loop, "time", clock)
        return drive_world(clock)


def drive_world(clock):
    settings, controller = plan("double_lane_change", law="lqr")
    world = build_world(settings, enabled=True)
    bus = WorldBus(world, clock)
    ecu = PythonEcu(controller.record)
    recorder = tick_trace.TickRecorder(ticks=1000, frames=10_000)
    seconds = 3.0
    ecu_loop.run(
        ecu, bus, recorder, controller.record, stop=Stop(), duration_ns=round(seconds * 1e9)
    )
    trace = tick_trace.TickTrace(controller.record, recorder.ticks(), recorder.frames(), {})
    return settings, controller, world, trace


def test_on_time_it_is_the_loop_of_virtual_time(against_world):
    """With no tick late, real time and virtual time put the same frames on the bus."""
    settings, controller, world, _ = against_world
    twin = build_world(settings, enabled=True)
    virtual_time.closed_loop(
        twin,
        PythonEcu(controller.record),
        tick_ns=PERIOD,
        duration_ns=world.now_ns,
    )
    until = world.now_ns - 1_000_000
    fields = ["t_queued", "t_received", "ident", "sender", "payload"]
    ours, theirs = (w.frames[w.frames["t_received"] < until] for w in (world, twin))
    assert len(ours) > 5000
    assert ours[fields].tobytes() == theirs[fields].tobytes()


@pytest.mark.parametrize("backend", ["python", "native"])
def test_the_trace_replays_byte_for_byte(against_world, tmp_path, backend):
    trace = against_world[-1]
    path = tmp_path / "ticks.npz"
    tick_trace.save(path, trace)
    read = tick_trace.load(path)
    again = tick_trace.replay(read, backend, start_ns=int(trace.ticks["deadline_ns"][0]))
    assert again.difference is None
    assert len(again.rows) == len(trace.ticks) == 300
    assert again.rows["t"][0] == 0.0
    assert np.max(np.abs(again.rows["moment"])) > 100.0


def test_a_changed_trace_is_told(against_world):
    trace = against_world[-1]
    imu = np.flatnonzero((trace.frames["ident"] == 0xA0) & (trace.frames["sent"] == 0))
    frames = np.array(trace.frames)
    frames["payload"][imu[150], 3] ^= 0x40
    changed = tick_trace.TickTrace(trace.calibration, trace.ticks, frames, {})
    assert tick_trace.replay(changed, "python").difference is not None
