"""Delivery monitor: delivered moments against their commands."""

import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import plausibility as sv
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.monitors.delivery import note_command, watch_delivery
from canroll.firmware.state import DEGRADED, RX_ACTUATOR_STATE, SAFE, Ecu

HALF_TRACK = 0.87
WINDOW, SAMPLES = 8, 4


def watched(actuator: int = fw.BARS) -> fw.Calibration:
    """A calibration with the monitor on: edges of 500 N·m and a quarter of the band."""
    cal = rig.calibration(actuator=actuator)
    cal.delivery_window, cal.delivery_samples = WINDOW, SAMPLES
    cal.delivery_min = 500 << fw.Q_MOMENT
    cal.delivery_share = 1 << fw.Q_SHARE - 2
    cal.track_front = cal.track_rear = round(2**28 * 2 * HALF_TRACK)
    return cal


def following(cal: fw.Calibration) -> Ecu:
    """An ECU whose actuators follow its commands."""
    ecu = rig.started(cal)
    ecu.enabled = ecu.command_held = ecu.commands_sent = 1
    ecu.fresh[RX_ACTUATOR_STATE] = RX_SIGNALS[RX_ACTUATOR_STATE]
    ecu.valid[RX_ACTUATOR_STATE] = 255
    return ecu


def sample(ecu: Ecu, cal: fw.Calibration, command: float, front: float, rear: float) -> None:
    """Command a moment (N·m) at each axle, and receive what the axles deliver."""
    force = round(command / (2.0 * HALF_TRACK) * 2**fw.Q_MOMENT)
    ecu.force = [force, -force, force, -force]
    ecu.bar = [round(command * 2**fw.Q_MOMENT)] * 2
    note_command(ecu, cal)
    ecu.delivered = [round(front * 2**fw.Q_MOMENT), round(rear * 2**fw.Q_MOMENT)]
    watch_delivery(ecu, cal)


def held(ecu: Ecu, cal: fw.Calibration, command: float, front: float, *, samples: int) -> None:
    """Hold a command; the rear axle does as it says."""
    for _ in range(samples):
        sample(ecu, cal, command, front, command)


def test_what_is_delivered_before_the_first_command_is_of_before_a_restart():
    cal = watched()
    ecu = following(cal)
    ecu.commands_sent = 0
    held(ecu, cal, 0.0, -2000.0, samples=2 * WINDOW + SAMPLES)
    ecu.commands_sent = 1
    held(ecu, cal, -1900.0, -1900.0, samples=WINDOW)
    assert rig.accused_axles(ecu) == [0, 0]
    held(ecu, cal, 0.0, -2000.0, samples=2 * WINDOW + SAMPLES)
    assert rig.accused_axles(ecu) == [1, 0]


@pytest.mark.parametrize("actuator", [fw.SUSPENSION, fw.BARS])
@pytest.mark.parametrize(
    ("delivered", "fault"), [(-1000.0, 1), (0.0, 1), (2000.0, 1), (1000.0, 0), (400.0, 0)]
)
def test_a_moment_outside_the_band_of_its_commands_is_a_fault(actuator, delivered, fault):
    cal = watched(actuator)
    ecu = following(cal)
    held(ecu, cal, 1000.0, delivered, samples=2 * WINDOW + SAMPLES)
    assert rig.accused_axles(ecu) == [fault, 0]


def test_it_takes_so_many_samples_in_a_row():
    cal = watched()
    ecu = following(cal)
    held(ecu, cal, 0.0, 2000.0, samples=SAMPLES - 1)
    held(ecu, cal, 0.0, 0.0, samples=1)
    held(ecu, cal, 0.0, 2000.0, samples=SAMPLES - 1)
    assert rig.accused_axles(ecu) == [0, 0]
    held(ecu, cal, 0.0, 2000.0, samples=1)
    assert rig.accused_axles(ecu) == [1, 0]


@pytest.mark.parametrize("start", range(WINDOW))
def test_a_command_may_take_a_window_to_be_delivered(start):
    cal = watched()
    ecu = following(cal)
    held(ecu, cal, 0.0, 0.0, samples=start)
    held(ecu, cal, 3000.0, 0.0, samples=WINDOW)
    held(ecu, cal, 3000.0, 3000.0, samples=2 * WINDOW)
    held(ecu, cal, -3000.0, 3000.0, samples=WINDOW)
    assert rig.accused_axles(ecu) == [0, 0]
    held(ecu, cal, -3000.0, 3000.0, samples=WINDOW + SAMPLES)
    assert rig.accused_axles(ecu) == [1, 0]


@pytest.mark.parametrize(
    "state",
    [
        {"enabled": 0},
        {"command_held": 0},
        {"status": [sv.STUCK, 0, 0, 0]},
        {"status": [0, sv.FLOATING, 0, 0]},
        {"fresh": [0] * 5},
        {"valid": [0] * 5},
    ],
)
def test_what_follows_no_command_or_is_not_known_is_not_judged(state):
    cal = watched()
    ecu = following(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    held(ecu, cal, 3000.0, -3000.0, samples=3 * WINDOW)
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize("state", [{"enabled": 0}, {"command_held": 0}, {"status": [3] * 4}])
def test_actuators_that_follow_again_start_from_zero(state):
    cal = watched()
    ecu = following(cal)
    for name, value in state.items():
        setattr(ecu, name, value)
    held(ecu, cal, 3000.0, 0.0, samples=3 * WINDOW)
    ecu.enabled = ecu.command_held = ecu.commands_sent = 1
    ecu.status = [0] * 4
    held(ecu, cal, 3000.0, 0.0, samples=WINDOW)
    assert rig.accused_axles(ecu) == [0, 0]


def test_a_limited_actuator_may_fall_short_but_not_push_the_other_way():
    cal = watched()
    ecu = following(cal)
    ecu.status = [sv.LIMITED] * 4
    held(ecu, cal, 3000.0, 0.0, samples=3 * WINDOW)
    assert rig.accused_axles(ecu) == [0, 0]
    held(ecu, cal, 3000.0, -3000.0, samples=SAMPLES)
    assert rig.accused_axles(ecu) == [1, 0]


def test_without_a_width_of_its_edges_the_band_is_not_watched():
    cal = watched()
    cal.delivery_min = 0
    ecu = following(cal)
    held(ecu, cal, 0.0, 8000.0, samples=3 * WINDOW)
    assert rig.accused_axles(ecu) == [0, 0]


@pytest.mark.parametrize(
    ("actuator", "contradicted", "mode"),
    [
        (fw.BARS, [1, 0], DEGRADED),
        (fw.BARS, [0, 1], DEGRADED),
        (fw.BARS, [1, 1], SAFE),
        (fw.SUSPENSION, [0, 1], SAFE),
    ],
)
def test_an_axle_that_contradicts_its_commands_has_failed_for_good(actuator, contradicted, mode):
    cal = watched(actuator)
    bench = rig.Bench(cal).active()
    bench.ecu.contradicted = 8 * contradicted[0] + 16 * contradicted[1]
    for _ in range(2 * cal.recovery_ticks):
        bench.step()
        assert bench.ecu.mode == mode
    assert bench.ecu.fault_active >> sv.FAULT_ACTUATOR_CONTRADICTED & 1 == 1
    assert bench.ecu.failed == [contradicted[0]] * 2 + [contradicted[1]] * 2
