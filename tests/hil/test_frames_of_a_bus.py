"""The loop on a bus's own frames as two programs: in lock step, and in real time over python-can.

One bus has CAN FD frames, one identifiers of 29 bits, one authenticated frames.
"""

import threading
from pathlib import Path

import can
import cantools
import pytest

from canroll.codegen.run.backends import open_backend
from canroll.errors import CanrollError
from canroll.hil import ecu_loop, plant_loop, tick_trace
from canroll.hil.bus_link import EXTENDED, CanLink
from canroll.hil.lockstep import ACKNOWLEDGEMENT, GRANT, GrantChannel, GrantedEcu, Grants
from canroll.hil.process import Stop
from canroll.runs import virtual_time
from canroll.runs.experiment import build_world, plan

pytestmark = pytest.mark.slow

SECONDS = 600_000_000
OWN = Path(__file__).parents[2] / "examples" / "own_bus"
FD = {"bus": "fd_2m"}
WIDE = {"dbc": str(OWN / "own.dbc"), "map": str(OWN / "own.toml")}


SECURED = {"bus": "secured_fd"}


@pytest.fixture(scope="module", params=[FD, WIDE, SECURED], ids=["fd", "wide", "secured"])
def planned(request):
    named = {"law": "lqr", "actuator": "suspension", "plant": "roll1", "backend": "python"}
    return plan("double_lane_change", seed=2, **request.param, **named)


@pytest.fixture
def database(planned):
    return cantools.database.load_file(planned[0].profile.dbc)


def speed_frame(planned):
    """Identifier (bit 30: of 29 bits) and length of the frame with the speed, and its signal."""
    box = planned[0].firmware.bus.received[1]
    name = next(s.name for s in box.signals if s.place.text == "speed")
    return box.ident, box.sent_length, name


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
        self.recorder = tick_trace.TickRecorder(ticks=1000, frames=10_000, room=self.firmware.room)
        self.outcome = None

    def trace(self):
        """What was recorded."""
        recorder = self.recorder
        about = {"lasting": [0, []]} if self.firmware.bus.secured else {}
        return tick_trace.TickTrace(self.record, recorder.ticks(), recorder.frames(), about)


class GrantedThread(Ecu):
    def run(self):
        channel = GrantChannel(self.link, sends=ACKNOWLEDGEMENT, hears=GRANT)
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


def test_lock_step_gives_the_frames_of_virtual_time(planned, links, database):
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
    channel = GrantChannel(plant, sends=GRANT, hears=ACKNOWLEDGEMENT)
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
    ident, length, name = speed_frame(planned)
    consumed = trace.frames[(trace.frames["sent"] == 0) & (trace.frames["ident"] == ident)]
    assert len(consumed) > 25
    for frame in consumed:
        assert frame["length"] == length
        data = frame["payload"].tobytes()[:length]
        assert 70 < database.decode_message(ident & ~EXTENDED, data)[name] < 90


def test_real_time_over_the_virtual_interface(planned, links, database):
    """No figure depends on the clock: both sides hear each other, in frames of their bus."""
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
        described = database.get_message_by_frame_id(message.arbitration_id)
        assert message.is_extended_id == described.is_extended_frame
        assert message.is_fd == message.bitrate_switch == described.is_fd
        described.decode(message.data)
        key = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
        seen.setdefault(key, []).append(len(message.data))
    listener.shutdown()
    ident, length, _ = speed_frame(planned)
    assert set(seen[ident]) == {length}
    sent = {box.ident for box in settings.firmware.bus.frames if "_bar" not in box.slot}
    assert len(seen.keys() & sent) > 4
    assert len(world.commands) > 0
    assert tick_trace.replay(ecu.trace(), "python", firmware=settings.firmware).difference is None


def test_a_frame_with_the_identifier_of_a_grant_is_refused(links):
    with pytest.raises(CanrollError, match="0x1CA00000 of a frame: use --pace realtime"):
        GrantChannel(links[0], sends=GRANT, hears=ACKNOWLEDGEMENT, idents=[0x80, GRANT])
