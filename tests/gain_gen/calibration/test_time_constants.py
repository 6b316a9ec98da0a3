"""Time constants are times: in s they are the same at every period of the loop and of a bus."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.firmware import calibration as fw
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.monitors.redundancy import watch_redundancy
from canroll.firmware.monitors.residual import DAMPER_STEPS, DAMPERS, MIRRORED, STEERED, mean_step
from canroll.firmware.monitors.samples import watch_samples
from canroll.firmware.observer import learn_offsets
from canroll.firmware.state import RX_IMU, RX_VEHICLE_MOTION, Ecu
from canroll.gain_gen.calibration.monitor_part import erratic_fields, monitor_fields
from canroll.gain_gen.calibration.record import fill
from canroll.gain_gen.calibration.response_part import response_fields
from canroll.gain_gen.calibration.vehicle_part import vehicle_fields
from canroll.gain_gen.models.task import Delay, Task
from canroll.gain_gen.monitors.uncertainty import DEFAULT
from canroll.vehicles import load

TICKS = (0.002, 0.005, 0.01, 0.02)
USUAL = (0.01, 0.02)
PERIODS = [(tick, *USUAL) for tick in TICKS] + [(0.01, 0.02, 0.05), (0.005, 0.005, 0.01)]
"""Of the loop, the inertial unit and the motion, s; a slower loop takes each newest sample."""
BIG = 1 << 26


def task_at(tick: float, imu: float = USUAL[0], motion: float = USUAL[1]) -> Task:
    """A van with forces at the corners."""
    usual = Task(load("van_real"), Delay.constant(0.02), tick=tick, actuator="suspension")
    return replace(usual, periods=(imu, motion, *usual.periods[2:]))


def moving(cal: fw.Calibration) -> Ecu:
    """The ECU, which observes, of a car that drives straight ahead and sends all."""
    cal.observer = fw.CONSTANT_GAIN
    ecu = Ecu()
    ecu.motion_lost = 0
    for message in (RX_IMU, RX_VEHICLE_MOTION):
        ecu.fresh[message] = ecu.valid[message] = RX_SIGNALS[message]
    ecu.speed, ecu.gain_factor = 30 << fw.Q_SPEED, 1 << 28
    return ecu


def time_constant(step, period: float) -> float:
    """How long what starts at one needs to reach 1/e, s, between the samples by its decay."""
    before = 1.0
    for count in range(1, 6000):
        after = step()
        if after <= np.exp(-1.0):
            return period * (count - np.log(np.exp(-1.0) / after) / np.log(before / after))
        before = after
    return np.inf


@pytest.mark.parametrize(("tick", "imu", "motion"), PERIODS)
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("motion_peak", 20.475),
        ("motion_now", 1.275),
        (STEERED, 0.0749),
        (MIRRORED, 0.1549),
    ],
)
def test_motion_fades_and_mirror_images_average_in_the_same_time(name, expected, tick, imu, motion):
    cal = fill(monitor_fields(task_at(tick, imu, motion), DEFAULT))
    ecu = moving(cal)
    # the unit has turned away from the steering, by too little to turn back
    ecu.unit_away, cal.mirror_min, ecu.lateral_acceleration = 1, 0, 1
    of = ecu.passed if isinstance(name, int) else vars(ecu)
    of[name] = BIG

    def step() -> float:
        watch_redundancy(ecu, cal)
        return of[name] / BIG

    assert time_constant(step, max(tick, imu)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("tick", "imu", "motion"), PERIODS)
@pytest.mark.parametrize(("k", "expected"), [(1, 0.0749), (4, 0.1498)], ids=["unit", "motion"])
def test_an_erratic_signal_fades_in_the_same_time(k, expected, tick, imu, motion):
    period = (imu, motion)[k > 2]
    cal = fill(erratic_fields(task_at(tick, imu, motion)))
    ecu = moving(cal)
    ecu.erratic_sum[k] = 1 << 18

    def step() -> float:
        watch_samples(ecu, cal, 1)
        return ecu.erratic_sum[k] / (1 << 18)

    assert time_constant(step, max(tick, period)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("tick", TICKS)
def test_the_mean_of_changes_forgets_in_the_same_time(tick):
    cal = fill(response_fields(task_at(tick), DEFAULT))
    ecu = Ecu()
    ecu.bound[DAMPERS] = BIG

    def step() -> float:
        return mean_step(ecu, cal, DAMPERS, DAMPER_STEPS, 0) / BIG

    assert time_constant(step, tick) == pytest.approx(10.24, rel=2e-3)


@pytest.mark.parametrize(("tick", "imu", "motion"), PERIODS)
def test_offsets_are_learnt_in_the_same_time(tick, imu, motion):
    cal = fill(vehicle_fields(task_at(tick, imu, motion), (1.0,) * fw.N_POINTS, DEFAULT))
    cal.offset_learning = 1
    ecu = moving(cal)
    offset = cal.offset_rate_max
    ecu.roll_rate = offset

    def step() -> float:
        learn_offsets(ecu, cal)
        return 1.0 - ecu.offset_rate / offset

    assert time_constant(step, max(tick, imu)) == pytest.approx(2.555, rel=2e-3)


def test_at_10_ms_the_weights_are_powers_of_two_and_seven_eighths():
    """So runs at this period are what they were with shifts, to the last bit."""
    fields = monitor_fields(task_at(0.01), DEFAULT) | erratic_fields(task_at(0.01))
    assert fields["redundancy_pass"] == [1 << 19, 1 << 23, 1 << 27, 1 << 26]
    assert fields["erratic_kept"] == [7 << 27] * 5
    assert response_fields(task_at(0.01), DEFAULT)["response_mean"] == 1 << 20
    learning = vehicle_fields(task_at(0.01), (1.0,) * fw.N_POINTS, DEFAULT)
    assert learning["offset_gain"] << 8 == 1 << learning["offset_shift"]
