"""The schedule over speed: its factors, what the ECU makes of them, and a speed that changes."""

from dataclasses import replace

import control
import numpy as np
import pytest

from canroll import vehicles
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.schedule import schedule
from canroll.firmware.state import RX_VEHICLE_MOTION, Ecu
from canroll.gain_gen.analysis.family import Condition, family
from canroll.gain_gen.analysis.speed_schedule import (
    GAIN_MARGIN_DB,
    PEAK_SENSITIVITY,
    checked_speed_rate,
    largest_factor,
    speeds_of,
    with_speed_rate,
)
from canroll.gain_gen.calibration.dequantise import dequantise
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.design import design
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.models.controller import SPEEDS, scaled_controller
from canroll.gain_gen.models.task import Check, Delay, Task

SLOW_BUS = Delay(0.118, 0.106, 0.130)


def task(vehicle="van_real", **options):
    return Task(vehicles.load(vehicle), SLOW_BUS, **options)


@pytest.mark.parametrize("gain", [0.5, 20.0])
def test_the_largest_factor_has_the_margins_of_python_control(gain):
    loop = control.ss(control.tf([gain], [1.0, 3.0, 3.0, 1.0]))
    frequencies = np.geomspace(1e-2, 1e2, 4000)
    response = np.squeeze(control.frequency_response(loop, frequencies).complex)
    factor = largest_factor(response)
    found, *_ = control.margin(factor * loop)
    sensitivity = 1.0 / np.abs(1.0 + factor * response).min()
    assert 20.0 * np.log10(found) > GAIN_MARGIN_DB - 0.05
    assert sensitivity < PEAK_SENSITIVITY + 0.01
    binds = sensitivity > PEAK_SENSITIVITY - 0.01 or 20.0 * np.log10(found) < GAIN_MARGIN_DB + 0.05
    assert binds == (factor < 10.0)


def test_the_schedule_takes_back_what_slow_speeds_cannot_have():
    answer = design("steering_lead", task(moment_share=1.1))
    factors = answer.controller.schedule
    assert factors[0] < 0.9
    assert factors[SPEEDS.index(20.0)] == factors[SPEEDS.index(25.0)] == 1.0
    assert answer.verified["schedule_gain_margin_db"].value > 8.0
    assert answer.verified["schedule_peak_sensitivity"].value < 1.7
    unscheduled = replace(answer.controller, schedule=(1.0,) * len(SPEEDS))
    gain_db, sensitivity = speeds_of(answer.task).worst(unscheduled)
    assert gain_db < 8.0
    assert sensitivity > 1.7


def test_the_ecu_interpolates_the_schedule_of_the_design():
    answer = design("steering_lead", task(moment_share=1.1))
    record, _ = calibrate(answer)
    assert dequantise(record).schedule == pytest.approx(answer.controller.schedule, abs=1e-8)
    ecu = Ecu()
    for speed in (5.0, 6.3, 9.99, 12.5, 22.0, 33.0, 60.0, 75.0):
        ecu.fresh[RX_VEHICLE_MOTION] = RX_SIGNALS[RX_VEHICLE_MOTION]
        ecu.speed = round(speed * 2**20)
        schedule(ecu, record)
        expected = answer.controller.factor_at(speed)
        assert ecu.gain_factor / 2**28 == pytest.approx(expected, abs=1e-5)


def test_a_speed_that_changes_as_certified_does_no_harm():
    """A linear car that brakes and speeds up again, its loop that of each tick's speed."""
    given = task()
    controller = design("steering_lead", given).controller
    rate = checked_speed_rate(given, controller)
    assert 9.81 < rate < 30.0
    speeds = np.arange(SPEEDS[0], 30.0, 0.25)
    cars = family(
        given.vehicle,
        given.delay,
        tick=given.tick,
        lag=given.lag,
        conditions=[Condition("empty", float(speed)) for speed in speeds],
    )
    loops = [member.loop(controller, cars.delays[-1]).closed for member in cars.members]
    rng = np.random.default_rng(0)
    x = rng.normal(size=len(loops[0]))
    speed, direction, sizes = 29.0, -1.0, []
    for _ in range(4000):
        if speed < 6.0 or speed > 29.0:
            direction = -np.sign(speed - 15.0)
        speed += direction * rate * given.tick
        x = loops[int(np.argmin(np.abs(speeds - speed)))] @ x
        sizes.append(np.linalg.norm(x))
    assert sizes[-1] < 1e-12 * max(sizes)


def test_the_rate_is_a_number_of_scheduled_designs_alone():
    scheduled = design("steering_lead", task())
    assert "checked_speed_rate" not in scheduled.margins
    shown = with_speed_rate(scheduled)
    expected = checked_speed_rate(scheduled.task, scheduled.controller)
    assert dict(shown.margins) == {**scheduled.margins, "checked_speed_rate": expected}
    refused = replace(scheduled, verified={"any": Check(1.0, 0.0, ok=False)})
    unscheduled = replace(scheduled, margins={"gain_db": 9.0})
    for answer in (refused, unscheduled):
        assert with_speed_rate(answer) is answer


def test_an_unstable_loop_is_certified_for_nothing():
    given = task()
    controller = scaled_controller(LAWS["steering_lead"](given).controller, 30.0)
    assert checked_speed_rate(given, controller) == 0.0
