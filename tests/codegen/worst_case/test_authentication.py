"""Bounds of a tick with authenticated frames: its parts, and no flood of forged frames beats it."""

from functools import cache

import numpy as np
import pytest

from canroll.codegen.run import cortex, ecu_traffic, qemu, unicorn
from canroll.codegen.run.backends import open_backend
from canroll.codegen.run.bus_firmware import of_bus
from canroll.codegen.run.native import compiler
from canroll.codegen.run.specialised import specialised
from canroll.codegen.worst_case import firmware_bound as worst
from canroll.codegen.worst_case.cycles import Timing
from canroll.dbc import SECURED_MAP, SECURED_PATH
from canroll.dbc.keys import DEVELOPMENT_KEY
from tools import recorded_traffic
from tools.recorded_traffic import Case

pytestmark = pytest.mark.slow

FIRMWARE = of_bus(SECURED_PATH, SECURED_MAP)
FULL = 64
"""Frames that the bus carries in a tick."""
needs_gcc = pytest.mark.skipif(not cortex.has_gcc_and_qemu(), reason="needs gcc and QEMU for Arm")


@pytest.fixture(scope="module")
def recording():
    return recorded_traffic.record(Case("double_lane_change", "lqr", bus="secured_fd"), 2.0)


@pytest.fixture(scope="module")
def bound_of(recording):
    """Return the bound of a tick that receives so many frames."""

    @cache
    def bound(cpu, firmware=FIRMWARE, received=FULL):
        return worst.firmware_bound(recording.calibration, Timing(cpu), firmware, received=received)

    return bound


def test_a_tick_is_its_loop_and_what_authentication_does_as_often_as_stated(bound_of, cpu):
    none, full = bound_of(cpu, received=0), bound_of(cpu)
    its = full.authentication
    assert (its.received, its.sent) == (FULL, 3)
    assert its.cycles == its.elapse.cycles + FULL * its.verify.cycles + 3 * its.protect.cycles
    assert full.tick.cycles - none.tick.cycles == FULL * its.verify.cycles
    assert full.tick.cycles == sum(full.tick.shares.values())
    assert full.tick.stack == max(none.tick.stack, its.verify.stack, its.protect.stack)
    assert full.receive.cycles == none.receive.cycles


def close_to_the_bound(recording, bound, cpu, firmware=FIRMWARE):
    calibration = recording.calibration
    seen = worst.observe(
        calibration, recording.traffic, Timing(cpu), 600, firmware=firmware, received=FULL
    )
    assert seen.late > 20
    assert 0.9 * bound.tick.cycles < seen.cycles <= bound.tick.cycles
    assert 0.9 * bound.tick.stack < seen.stack <= bound.tick.stack
    return bound.tick.cycles - bound.authentication.cycles


def test_a_flood_comes_close_to_the_bound_and_stays_below(recording, bound_of, cpu):
    close_to_the_bound(recording, bound_of(cpu), cpu)


@needs_gcc
@pytest.mark.long
def test_a_specialised_loop_is_bounded_with_its_authentication(recording, bound_of):
    special, cpu = specialised(FIRMWARE, recording.calibration), "cortex-m4"
    loop = close_to_the_bound(recording, bound_of(cpu, special), cpu, special)
    general = bound_of(cpu)
    assert loop < 0.7 * (general.tick.cycles - general.authentication.cycles)


def test_each_part_of_a_replayed_tick_is_within_its_bound(recording, bound_of, cpu):
    """Without a flood the frames are those of the vehicle, most of which are taken."""
    calibration, traffic = recording.calibration, recording.traffic
    bound = bound_of(cpu)
    costs = worst.cycle_costs(cortex.gcc_image(cpu, FIRMWARE.files), Timing(cpu))
    ran = qemu.replay(calibration, traffic, cpu, firmware=FIRMWARE, costs=costs)
    received = np.bincount(traffic.frames["tick"], minlength=traffic.ticks)
    sent = np.bincount(ran.frames["tick"], minlength=traffic.ticks)
    its = bound.authentication
    loop = bound.tick.cycles - its.cycles
    most = loop + its.elapse.cycles + received * its.verify.cycles + sent * its.protect.cycles
    assert sent.max() <= its.sent
    assert (ran.cycles <= most).all()
    assert ran.stack <= bound.tick.stack


@needs_gcc
def test_a_plain_bus_has_no_authentication_to_bound():
    bound = worst.firmware_bound(ecu_traffic.random_calibration(3), Timing("cortex-m4"))
    assert bound.authentication is None


@pytest.mark.skipif(not cortex.has_pip_tools(), reason="needs canroll[target]")
def test_both_emulators_run_the_same_authenticated_session(recording, cpu):
    calibration, frames = recording.calibration, recording.traffic.frames
    traffic = ecu_traffic.EcuTraffic(frames[frames["tick"] < 60], recording.traffic.elapsed[:60])
    here = unicorn.replay_secured(calibration, traffic, cpu, FIRMWARE, key=DEVELOPMENT_KEY)
    ran = qemu.replay(calibration, traffic, cpu, firmware=FIRMWARE, key=DEVELOPMENT_KEY)
    assert ran.states.tobytes() == here.states.tobytes()
    assert ran.frames.tobytes() == here.frames.tobytes()
    assert (ran.authentication > 0).all()
    assert (ran.instructions > ran.authentication).all()
    wrong = qemu.replay(calibration, traffic, cpu, firmware=FIRMWARE, key=bytes(16))
    assert wrong.states.tobytes() != here.states.tobytes()


@pytest.mark.skipif(compiler() is None, reason="needs cc")
def test_a_flood_fills_every_tick_with_frames_that_are_refused(recording):
    plain = recording.traffic
    frames = len(FIRMWARE.bus.received)
    full = ecu_traffic.flooded(plain, FULL, frames)
    assert (np.bincount(full.frames["tick"], minlength=plain.ticks) == FULL).all()
    again = ecu_traffic.flooded(full, FULL, frames)
    assert again.frames.tobytes() == full.frames.tobytes()
    counts = []
    for traffic in (plain, full):
        ecu = open_backend("native", recording.calibration, FIRMWARE)
        at = 0
        for t in range(traffic.ticks):
            while at < len(traffic.frames) and traffic.frames["tick"][at] == t:
                event = traffic.frames[at]
                ident = FIRMWARE.bus.received[event["message"]].ident
                ecu.receive(ident, event["payload"].tobytes(), int(event["length"]))
                at += 1
            ecu.tick()
        counts.append((ecu.accepted, ecu.refused))
    added = len(full.frames) - len(plain.frames)
    assert counts[1] == (counts[0][0], counts[0][1] + added)
    silent = ecu_traffic.EcuTraffic(plain.frames[:0], plain.elapsed)
    assert ecu_traffic.flooded(silent, FULL, frames) is silent
