"""The plant's loop: plant time is the wall clock's, whatever the loop does."""

import numpy as np
import pytest

from canroll.hil import plant_loop
from canroll.hil.process import Stop
from canroll.runs.experiment import build_world, plan

MS = 1_000_000


@pytest.fixture
def world():
    settings, _ = plan("double_lane_change", law="lqr")
    return build_world(settings, enabled=True)


def test_in_step_with_the_clock_even_when_late(world, list_bus, clock):
    clock.late = {k: (k % 5) * 300_000 for k in range(5000)} | {200: 40 * MS}
    began = clock.now
    outcome = plant_loop.run(world, list_bus, stop=Stop(), duration_ns=500 * MS, step_ns=MS)
    assert outcome.reason == plant_loop.FINISHED
    assert outcome.start_ns == began
    assert world.now_ns == 500 * MS
    assert len(world.signals["time"]) == 500
    sent = [(t - began, ident, payload) for t, ident, payload in list_bus.out]
    imu = [t for t, ident, _ in sent if ident == 0xA0]
    assert len(imu) == 50
    log = world.frames[(world.frames["ident"] == 0xA0)]
    received = log["t_received"][: len(imu)]
    # never before the modelled bus has delivered it, and at the next turn of the loop
    assert np.all(np.array(imu) >= received)
    behind = np.array(imu) - received
    # the 40 ms that the loop slept in hold up four frames, and none after them
    assert np.sum(behind > 3 * MS) == 4
    assert np.max(behind) <= 42 * MS


def test_what_the_ecu_sends_reaches_the_modelled_bus(world, list_bus, clock):
    list_bus.waiting = [(0x123, bytes(8)), (0x300, bytes(range(8)))]
    plant_loop.run(world, list_bus, stop=Stop(), duration_ns=20 * MS)
    ours = world.frames[world.frames["ident"] == 0x300]
    assert len(ours) == 1
    assert bytes(ours["payload"][0][:8]) == bytes(range(8))
    assert 0x123 not in world.frames["ident"]


@pytest.mark.parametrize("frames", [[(0x300, bytes(64))], [(0x300, bytes(8))] * 2000])
def test_what_no_ecu_would_send_does_not_end_the_plant(world, list_bus, clock, frames):
    longer = sum(len(payload) > 8 for _, payload in frames)
    beyond = max(0, len(frames) - world.room)
    list_bus.waiting = frames
    outcome = plant_loop.run(world, list_bus, stop=Stop(), duration_ns=20 * MS)
    assert outcome.reason == plant_loop.FINISHED
    assert outcome.refused == longer + beyond > 0


@pytest.mark.parametrize("bus", ["500k", "secured_fd"])
def test_hostile_frames_make_no_nonsense(list_bus, clock, bus):
    """Every length and 300 commands in a millisecond: the vehicle's motion stays its own."""
    settings, _ = plan("double_lane_change", law="lqr", bus=bus)
    alone, attacked = (build_world(settings, enabled=True) for _ in range(2))
    plant_loop.run(alone, list_bus, stop=Stop(), duration_ns=200 * MS, firmware=settings.firmware)
    idents = [ident for ident, length in settings.firmware.sent if length]
    lengths = [(ident, b"\xff" * n) for ident in idents for n in (*range(17), 20, 48, 64)]
    list_bus.waiting = [*lengths, *[(idents[0], b"\xff" * 8)] * 300]
    outcome = plant_loop.run(
        attacked, list_bus, stop=Stop(), duration_ns=200 * MS, firmware=settings.firmware
    )
    assert outcome.reason == plant_loop.FINISHED
    assert outcome.refused > 0
    assert len(attacked.commands) == 0
    for name, values in attacked.signals.items():
        assert values.tobytes() == alone.signals[name].tobytes(), name


def test_a_silent_ecu_ends_the_run(world, list_bus, clock):
    list_bus.waiting = [(0x300, bytes(8))]
    outcome = plant_loop.run(
        world, list_bus, stop=Stop(), duration_ns=3000 * MS, peer_timeout_ns=800 * MS
    )
    assert outcome.reason == plant_loop.PEER_LOST
    assert 800 * MS < world.now_ns < 810 * MS


def test_runs_on_beyond_the_manoeuvre(world, list_bus, clock):
    longer = world.duration_ns + 500 * MS
    plant_loop.run(world, list_bus, stop=Stop(), duration_ns=longer, step_ns=5 * MS)
    assert world.now_ns == longer
    assert np.all(np.isfinite(world.signals["roll"]))


def test_waits_for_the_ecu(list_bus, clock):
    assert not plant_loop.wait_for_ecu(list_bus, stop=Stop(), timeout=1.0)
    list_bus.waiting = [(0xA0, bytes(8))]
    assert not plant_loop.wait_for_ecu(list_bus, stop=Stop(), timeout=1.0)
    list_bus.waiting = [(0x300, bytes(8))]
    assert plant_loop.wait_for_ecu(list_bus, stop=Stop(), timeout=1.0)
