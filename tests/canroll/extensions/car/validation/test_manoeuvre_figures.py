"""Figures of step, sweep and sine with dwell against signals whose figures are known."""

import numpy as np
import pytest

from canroll import vehicles
from canroll.extensions.car.identification.pieces import EVERYTHING
from canroll.extensions.car.validation import sine_sweep, sine_with_dwell, step_steer
from canroll.extensions.car.validation.measurement import NONE
from canroll.extensions.car.validation.replayed import replayed
from canroll.extensions.car.validation.tolerances import TOLERANCES
from tests.support.measured_drives import driven, dwell, log_of, step, sweep, time_of

GAIN, LAG = 0.25, 0.2


def lagged(values, lag=LAG, gain=GAIN):
    """A first-order lag, exact for a signal that is linear between its samples."""
    decay = np.exp(-0.01 / lag)
    result = np.zeros(len(values))
    for k in range(1, len(values)):
        slope = (values[k] - values[k - 1]) / 0.01
        base = values[k - 1] - slope * lag
        result[k] = values[k] - slope * lag + (result[k - 1] - base) * decay
    return gain * result


def figures(judge, columns):
    car = vehicles.load("van_real")
    drive = replayed(log_of(columns), car, EVERYTHING, "body", NONE)
    return {one.label: one for one in judge(drive, TOLERANCES).criteria}


def test_step_of_a_first_order_lag():
    """Gain k; 90 % after ln(10) lags, from half of a ramp of 1.2 rad at 60 rad/s."""
    steering = step(1.2, rate=60.0)
    columns = driven(vehicles.load("van_real"), steering, 22.0)
    shown = figures(step_steer.judge, {**columns, "yaw_rate": lagged(steering, gain=GAIN)})
    assert shown["yaw rate, gain"].measured == pytest.approx(GAIN, rel=1e-3)
    assert shown["yaw rate, response time"].measured == pytest.approx(LAG * np.log(10), abs=0.01)
    assert shown["yaw rate, overshoot"].measured == pytest.approx(0.0, abs=0.005)
    assert "yaw rate, peak response time" not in shown


def test_step_of_a_damped_second_order():
    """Overshoot exp(−π ζ/√(1 − ζ²)) at π/(ω √(1 − ζ²)), from the middle of the step."""
    frequency, damping = 8.0, 0.4
    steering = step(1.2, rate=60.0)
    columns = driven(vehicles.load("van_real"), steering, 22.0)
    free = frequency * np.sqrt(1 - damping**2)
    after = np.maximum(time_of(6.0) - 2.01, 0.0)
    swing = np.cos(free * after) + damping / np.sqrt(1 - damping**2) * np.sin(free * after)
    yaw_rate = 1.2 * GAIN * (1.0 - np.exp(-damping * frequency * after) * swing)
    shown = figures(step_steer.judge, {**columns, "yaw_rate": yaw_rate})
    over = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert shown["yaw rate, overshoot"].measured == pytest.approx(over, rel=0.02)
    assert shown["yaw rate, peak response time"].measured == pytest.approx(np.pi / free, abs=0.02)


def test_sweep_of_a_first_order_lag():
    """Gain k/√(1 + (2π f T)²), phase −atan(2π f T)."""
    steering = sweep(0.5, seconds=60.0)
    columns = driven(vehicles.load("van_real"), steering, 22.0)
    shown = figures(sine_sweep.judge, {**columns, "yaw_rate": lagged(steering)})
    for frequency in (0.5, 1.0, 1.5, 2.0):
        angle = 2 * np.pi * frequency * LAG
        gain = shown[f"yaw rate at {frequency:g} Hz, gain"].measured
        phase = shown[f"yaw rate at {frequency:g} Hz, phase"].measured
        assert gain == pytest.approx(GAIN / np.hypot(1.0, angle), rel=0.02)
        assert phase == pytest.approx(-np.degrees(np.arctan(angle)), abs=1.5)


def test_sine_with_dwell_of_a_car_that_follows_its_steering():
    """Peaks where the steering has them, nothing left after it, the displacement of a sine."""
    steering = dwell(1.5)
    columns = driven(vehicles.load("van_real"), steering, 22.0)
    columns["yaw_rate"], columns["lateral_acceleration"] = 0.2 * steering, 4.0 * steering
    shown = figures(sine_with_dwell.judge, columns)
    assert shown["yaw rate, first peak"].measured == pytest.approx(np.degrees(0.3), rel=5e-3)
    assert shown["yaw rate, second peak"].measured == pytest.approx(-np.degrees(0.3), rel=2e-2)
    # the begin is where the wheel passes 5°
    late = np.arcsin(np.radians(5.0) / 1.5) / (2 * np.pi * 0.7)
    peak = shown["yaw rate, first peak at"].measured
    assert peak == pytest.approx(0.25 / 0.7 - late, abs=0.02)
    for delay in ("1", "1.75"):
        assert shown[f"yaw rate left after {delay} s"].measured == pytest.approx(0.0, abs=1e-3)
    time = np.linspace(0.0, 1.07, 100001)
    lateral = 6.0 * np.sin(2 * np.pi * 0.7 * (time + late))
    velocity = np.cumsum(lateral) * time[1]
    moved = float(np.sum(velocity) * time[1])
    assert shown["lateral displacement"].measured == pytest.approx(moved, rel=0.02)
