"""Lock step: what the plant grants, the ECU runs, and nothing but that."""

import queue
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canroll import dbc
from canroll.codegen.run.backends import PythonEcu
from canroll.errors import CanrollError, VerdictError
from canroll.firmware.com.signals import TX_IDS
from canroll.firmware.plausibility import FAULT_OWN_IDENTIFIER_HEARD
from canroll.hil import ecu_loop, lockstep, plant_loop, tick_trace
from canroll.hil.bus_link import EXTENDED
from canroll.hil.lockstep import ACKNOWLEDGEMENT, END, GRANT, GrantChannel, GrantedEcu, Grants, Note
from canroll.hil.process import Stop
from canroll.runs import virtual_time
from canroll.runs.experiment import build_world, plan

PLANTS = {message.frame_id for message in dbc.load().messages}.difference(TX_IDS)
SECONDS = 1_500_000_000


class End:
    """One end of a bus between two threads; ``spoil`` may drop or add frames of this end."""

    failed = 0

    def __init__(self):
        self.waiting = queue.Queue()
        self.other = None
        self.sent = self.received = 0
        self.spoil = lambda frame: [frame]

    def next(self, timeout):
        try:
            return self.waiting.get(timeout=timeout) if timeout else self.waiting.get_nowait()
        except queue.Empty:
            return None

    def receive(self):
        frames = []
        while (frame := self.next(0.0)) is not None:
            frames.append(frame)
        return [frame for frame in frames if not frame[0] & EXTENDED]

    def send(self, ident, payload):
        self.sent += 1
        for frame in self.spoil((ident, bytes(payload))):
            self.other.waiting.put(frame)

    def close(self):
        pass


@pytest.fixture
def bus():
    plant, ecu = End(), End()
    plant.other, ecu.other = ecu, plant
    return plant, ecu


class Ecu(threading.Thread):
    """An ECU program in a thread."""

    def __init__(self, record, link, channel=None, timeout=20.0):
        super().__init__(daemon=True)
        self.record, self.link, self.stop = record, link, Stop()
        channel = channel or GrantChannel(link, sends=ACKNOWLEDGEMENT, hears=GRANT)
        self.grants = Grants(
            link,
            channel,
            idents=PLANTS,
            foreign=TX_IDS,
            tick_us=record.tick_us,
            stop=self.stop,
        )
        self.recorder = tick_trace.TickRecorder(ticks=1000, frames=10_000)
        self.outcome = self.error = None
        self.timeout = timeout

    def run(self):
        self.backend = PythonEcu(self.record)
        try:
            self.outcome = ecu_loop.run_granted(
                self.backend,
                self.link,
                self.grants,
                self.recorder,
                self.record,
                stop=self.stop,
                peer_timeout=self.timeout,
            )
        except CanrollError as error:
            self.error = error


@pytest.fixture(scope="module")
def planned():
    return plan("double_lane_change", law="lqr", actuator="suspension", seed=2, backend="python")


@pytest.fixture(scope="module")
def virtual(planned):
    settings, controller = planned
    world = build_world(settings, enabled=True)
    virtual_time.closed_loop(
        world, PythonEcu(controller.record), tick_ns=10_000_000, duration_ns=SECONDS
    )
    return world


def drive(planned, plant, channel=None, *, stop=None, timeout=20.0):
    """Drive the plant's side until it ends: its world and its outcome."""
    world = build_world(planned[0], enabled=True)
    channel = channel or GrantChannel(plant, sends=GRANT, hears=ACKNOWLEDGEMENT)
    stop = stop or Stop()
    ecu = GrantedEcu(plant, channel, idents=TX_IDS, stop=stop, peer_timeout=timeout)
    assert ecu.greet(20.0)
    return world, plant_loop.run_granting(world, ecu, stop=stop, duration_ns=SECONDS)


@given(st.integers(0, 255), st.integers(0, END), st.integers(0, 65535), st.integers(0, 1))
def test_a_note_reads_as_it_was_written(count, number, tick_us, joined):
    note = Note(count, number, tick_us, joined)
    assert len(note.payload()) == 8
    assert Note.of(note.payload()) == note


def test_the_same_bytes_as_in_virtual_time(bus, planned, virtual):
    plant, link = bus
    ecu = Ecu(planned[1].record, link)
    ecu.start()
    world, outcome = drive(planned, plant)
    ecu.join(20)
    assert outcome.reason == plant_loop.FINISHED
    assert world.frames.tobytes() == virtual.frames.tobytes()
    assert world.ages.tobytes() == virtual.ages.tobytes()
    for name, values in world.signals.items():
        assert values.tobytes() == virtual.signals[name].tobytes(), name
    # the plant has said that it ends, so the ECU did not wait
    assert (ecu.outcome.reason, ecu.outcome.ticks) == (ecu_loop.PLANT_ENDED, 150)
    assert outcome.not_valid == ecu.outcome.not_valid == ""
    trace = tick_trace.TickTrace(planned[1].record, ecu.recorder.ticks(), ecu.recorder.frames(), {})
    assert trace.ticks["number"].tolist() == list(range(1, 151))
    assert set(trace.ticks["elapsed"]) == {1}
    assert tick_trace.replay(trace, "python").difference is None


def test_answers_may_be_lost_and_grants_come_twice(bus, planned, virtual, monkeypatch):
    monkeypatch.setattr(lockstep, "RESEND", 0.02)
    monkeypatch.setattr(lockstep, "SLICE", 0.01)
    plant, link = bus
    count = iter(range(10**6))
    link.spoil = lambda frame: (
        [] if frame[0] == ACKNOWLEDGEMENT and next(count) % 20 == 7 else [frame]
    )
    plant.spoil = lambda frame: [frame, frame] if frame[0] == GRANT else [frame]
    ecu = Ecu(planned[1].record, link)
    ecu.start()
    world, _ = drive(planned, plant)
    assert world.frames.tobytes() == virtual.frames.tobytes()


@pytest.mark.parametrize("side", ["plant", "ecu"])
def test_a_lost_frame_ends_the_run(bus, planned, monkeypatch, side):
    monkeypatch.setattr(lockstep, "LOST", 0.2)
    plant, link = bus
    sender, ident = (plant, 0xA0) if side == "plant" else (link, 0x300)
    count = iter(range(10**6))
    sender.spoil = lambda frame: [] if frame[0] == ident and next(count) == 5 else [frame]
    ecu = Ecu(planned[1].record, link)
    ecu.start()
    if side == "plant":
        drive(planned, plant, timeout=1.0)
        ecu.join(20)
        assert isinstance(ecu.error, VerdictError)
        assert "1 of the" in str(ecu.error)
        assert "were lost" in str(ecu.error)
    else:
        with pytest.raises(VerdictError, match=r"of the ECU in tick .* were lost"):
            drive(planned, plant)
        ecu.stop.requested = True


def test_another_node_that_sends_our_frames_is_noticed(bus, planned):
    plant, link = bus
    count = iter(range(10**6))
    link.spoil = lambda frame: [frame, frame] if frame[0] == 0x300 and next(count) == 3 else [frame]
    ecu = Ecu(planned[1].record, link)
    ecu.start()
    with pytest.raises(VerdictError, match=r"instead of .*0x300, 0x300.*another node"):
        drive(planned, plant)
    ecu.stop.requested = True


def test_frames_of_others_do_not_count(bus, planned, virtual):
    plant, link = bus
    plant.spoil = lambda frame: [(0x123, b"x"), (EXTENDED | 0x123, b"y"), frame]
    link.spoil = lambda frame: [(0x7FF, b"z"), frame]
    ecu = Ecu(planned[1].record, link)
    ecu.start()
    world, _ = drive(planned, plant)
    assert world.frames.tobytes() == virtual.frames.tobytes()


def test_frames_of_the_ecus_own_identifiers_reach_it_and_do_not_count(bus, planned):
    plant, link = bus
    count = iter(range(10**6))

    def spoofed(frame):
        return [(TX_IDS[0], bytes(8)), frame] if next(count) == 500 else [frame]

    plant.spoil = spoofed
    ecu = Ecu(planned[1].record, link)
    ecu.start()
    drive(planned, plant)
    heard = [frame for frame in ecu.recorder.frames() if frame["ident"] == TX_IDS[0]]
    assert sum(frame["sent"] == 0 for frame in heard) == 1
    assert ecu.backend.state.fault_count[FAULT_OWN_IDENTIFIER_HEARD] == 1


def test_an_ecu_may_join_late_and_take_over(bus, planned, monkeypatch):
    """One that is gone without a word is replaced: time has stood still meanwhile."""
    monkeypatch.setattr(lockstep, "RESEND", 0.02)
    monkeypatch.setattr(lockstep, "SLICE", 0.01)
    plant, link = bus
    record = planned[1].record
    first = Ecu(record, link)
    gone = threading.Event()

    class Vanishing(PythonEcu):
        ticks = 0

        def tick(self, elapsed_ticks=1):
            self.ticks += 1
            if self.ticks == 40:
                gone.set()
                raise VerdictError("killed")
            return super().tick(elapsed_ticks)

    monkeypatch.setattr("tests.hil.test_lockstep.PythonEcu", Vanishing)
    second = Ecu(record, link)

    def take_over():
        gone.wait(20)
        monkeypatch.undo()
        second.start()

    threading.Thread(target=take_over, daemon=True).start()
    first.start()
    world, outcome = drive(planned, plant, timeout=None)
    second.stop.requested = True
    second.join(20)
    assert outcome.reason == plant_loop.FINISHED
    assert world.now_ns == SECONDS
    assert second.recorder.ticks()["number"][0] == 40
    assert second.outcome.ticks == 150 - 39
    assert outcome.not_valid == "the ECU was lost, another one joined at 0.40 s"
    assert second.outcome.not_valid == "joined in tick 40 of a run"


def test_a_plant_that_is_replaced_leaves_no_valid_run(bus, planned, monkeypatch):
    monkeypatch.setattr(lockstep, "SLICE", 0.01)
    plant, link = bus
    ecu = Ecu(planned[1].record, link)
    ecu.start()
    channel = GrantChannel(plant, sends=GRANT, hears=ACKNOWLEDGEMENT)
    killed = GrantedEcu(plant, channel, idents=TX_IDS, stop=Stop(), peer_timeout=20.0)
    assert killed.greet(20.0)
    for _ in range(7):
        killed.tick()
    _, outcome = drive(planned, plant)
    ecu.join(20)
    assert outcome.reason == plant_loop.FINISHED
    assert outcome.not_valid == "the ECU has run with another plant"
    assert ecu.outcome.not_valid == "the plant was lost after tick 7, another one joined"


def test_a_plant_that_says_nothing_is_lost(bus, planned, monkeypatch):
    monkeypatch.setattr(lockstep, "SLICE", 0.01)
    plant, link = bus
    ecu = Ecu(planned[1].record, link, timeout=0.2)
    ecu.start()
    channel = GrantChannel(plant, sends=GRANT, hears=ACKNOWLEDGEMENT)
    killed = GrantedEcu(plant, channel, idents=TX_IDS, stop=Stop(), peer_timeout=20.0)
    assert killed.greet(20.0)
    killed.tick()
    ecu.join(20)
    assert ecu.outcome.reason == ecu_loop.PEER_LOST
    assert ecu.outcome.not_valid == "the plant was lost after tick 1"


def test_an_ecu_that_ends_ends_the_run_after_its_last_command(bus, planned):
    plant, link = bus
    ecu = Ecu(planned[1].record, link)
    original = ecu.grants.done

    def done(sent):
        original(sent)
        ecu.stop.requested = ecu.grants._number == 100

    ecu.grants.done = done
    ecu.start()
    world, outcome = drive(planned, plant)
    ecu.join(20)
    assert (outcome.reason, outcome.not_valid) == (plant_loop.PEER_LOST, "the ECU ended at 1.01 s")
    assert ecu.outcome.reason == ecu_loop.STOPPED
    commands = world.frames[world.frames["ident"] == 0x80]
    last = dbc.load().decode_message(0x80, commands["payload"][-1][:8].tobytes())
    assert str(last["Mode"]) == "SAFE"
    assert all(value == 0 for name, value in last.items() if name.startswith("Force"))
    assert world.commands["t_applied"][-1] > commands["t_queued"][-1]


def test_an_ecu_that_says_nothing_is_lost(bus, planned, monkeypatch):
    monkeypatch.setattr(lockstep, "SLICE", 0.01)
    plant, link = bus
    ecu = GrantedEcu(
        plant,
        GrantChannel(plant, sends=GRANT, hears=ACKNOWLEDGEMENT),
        idents=TX_IDS,
        stop=Stop(),
        peer_timeout=0.05,
    )
    assert not ecu.greet(0.05)
    link.send(ACKNOWLEDGEMENT, Note(0, 0, 10_000).payload())
    assert ecu.greet(5.0)
    world = build_world(planned[0], enabled=True)
    outcome = plant_loop.run_granting(world, ecu, stop=Stop(), duration_ns=SECONDS)
    assert (outcome.reason, outcome.not_valid) == (
        plant_loop.PEER_LOST,
        "the ECU was lost at 0.01 s",
    )
    assert world.now_ns == 10_000_000


def test_an_ecu_with_another_tick_cannot_take_over(bus, planned):
    plant, link = bus
    channel = GrantChannel(plant, sends=GRANT, hears=ACKNOWLEDGEMENT)
    ecu = GrantedEcu(plant, channel, idents=TX_IDS, stop=Stop(), peer_timeout=5.0)
    link.send(ACKNOWLEDGEMENT, Note(0, 0, 10_000).payload())
    assert ecu.greet(5.0)
    link.send(ACKNOWLEDGEMENT, Note(0, 1, 5_000).payload())
    with pytest.raises(VerdictError, match="the ECU's tick changed to 5 ms, it was 10 ms"):
        ecu.tick()
