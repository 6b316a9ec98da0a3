"""The loop on CAN FD frames as two programs: in lock step, and in real time over python-can."""

import threading

import can
import cantools
import pytest

import dbc
from codegen.run.backends import open_backend
from hil.realtime import ecu_loop, plant_loop, tick_trace
from hil.realtime.bus_link import CanLink
from hil.realtime.lockstep import ACKNOWLEDGEMENT, GRANT, GrantedEcu, Grants, InBand
from hil.realtime.process import Stop
from hil.runs import virtual_time
from hil.runs.experiment import build_world, plan

SECONDS = 600_000_000
DATABASE = cantools.database.load_file(dbc.FD_PATH)


@pytest.fixture(scope="module")
def planned():
    named = {"law": "lqr", "actuator": "suspension", "plant": "roll1", "backend": "python"}
    return plan("double_lane_change", seed=2, bus="fd_2m", **named)


@pytest.fixture
def links(planned, request):
    fd = planned[0].firmware.fd
    ends = [
        CanLink(can.Bus(request.node.name, interface="virtual", protocol="CAN_FD"), fd=fd)
        for _ in range(2)
    ]
    yield ends
    for end in ends:
        end.close()


class Ecu(threading.Thread):
    """An ECU program in a thread: in lock step with ``granted``, else in real time."""

    def __init__(self, planned, link):
        super().__init__(daemon=True)
        settings, controller = planned
        self.record, self.link, self.firmware = controller.record, link, settings.firmware
        self.stop = Stop()
        self.backend = open_backend("python", self.record, self.firmware)
        self.recorder = tick_trace.Recorder(ticks=1000, frames=10_000, room=self.firmware.room)
        self.outcome = None

    def trace(self):
        """What was recorded."""
        recorder = self.recorder
        return tick_trace.TickTrace(self.record, recorder.ticks(), recorder.frames(), {})


class GrantedThread(Ecu):
    def run(self):
        channel = InBand(self.link, sends=ACKNOWLEDGEMENT, hears=GRANT)
        grants = Grants(
            self.link,
            channel,
            idents=set(self.firmware.slots),
            tick_us=self.record.tick_us,
            stop=self.stop,
        )
        self.outcome = ecu_loop.run_granted(
            self.backend,
            self.link,
            grants,
            self.recorder,
            self.record,
            stop=self.stop,
            peer_timeout=20.0,
            firmware=self.firmware,
        )


class ClockedThread(Ecu):
    def run(self):
        self.outcome = ecu_loop.run(
            self.backend,
            self.link,
            self.recorder,
            self.record,
            stop=self.stop,
            firmware=self.firmware,
        )


def test_lock_step_gives_the_frames_of_virtual_time(planned, links):
    settings, controller = planned
    virtual = build_world(settings, enabled=True)
    virtual_time.closed_loop(
        virtual,
        open_backend("python", controller.record, settings.firmware),
        tick_ns=10_000_000,
        duration_ns=SECONDS,
    )
    plant, link = links
    ecu = GrantedThread(planned, link)
    ecu.start()
    stop, world = Stop(), build_world(settings, enabled=True)
    channel = InBand(plant, sends=GRANT, hears=ACKNOWLEDGEMENT)
    idents = plant_loop.sent_by(settings.firmware)
    granted = GrantedEcu(plant, channel, idents=idents, stop=stop, peer_timeout=20.0)
    assert granted.greet(20.0)
    outcome = plant_loop.run_granting(world, granted, stop=stop, duration_ns=SECONDS)
    ecu.join(20)
    assert outcome.reason == plant_loop.FINISHED
    assert world.frames.tobytes() == virtual.frames.tobytes()
    # the trace has whole frames: it replays, and cantools decodes what was consumed
    trace = ecu.trace()
    assert tick_trace.replay(trace, "python", firmware=settings.firmware).difference is None
    consumed = trace.frames[(trace.frames["sent"] == 0) & (trace.frames["ident"] == 0xA0)]
    assert len(consumed) > 50
    for frame in consumed:
        assert frame["length"] == 32
        signals = DATABASE.decode_message(0xA0, frame["payload"].tobytes())
        assert 70 < signals["VehicleSpeed"] < 90


def test_real_time_over_the_virtual_interface(planned, links):
    """No figure depends on the clock: both sides hear each other, and all frames are of CAN FD."""
    settings, _ = planned
    plant, link = links
    listener = can.Bus(plant.bus.channel_id, interface="virtual", protocol="CAN_FD")
    ecu = ClockedThread(planned, link)
    ecu.start()
    world = build_world(settings, enabled=True)
    outcome = plant_loop.run(
        world, plant, stop=Stop(), duration_ns=SECONDS, firmware=settings.firmware
    )
    ecu.stop.requested = True
    ecu.join(20)
    assert outcome.reason == plant_loop.FINISHED
    seen = {}
    while (message := listener.recv(0.0)) is not None:
        assert message.is_fd and message.bitrate_switch
        DATABASE.decode_message(message.arbitration_id, message.data)
        seen.setdefault(message.arbitration_id, []).append(len(message.data))
    listener.shutdown()
    assert set(seen[0xA0]) == {32}
    assert {0x80, 0xA0, 0xD0, 0x300, 0x301} <= seen.keys()
    assert len(world.commands) > 0
    assert tick_trace.replay(ecu.trace(), "python", firmware=settings.firmware).difference is None
