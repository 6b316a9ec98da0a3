"""The moment before the split against the same loop in float64, over whole manoeuvres."""

import numpy as np
import pytest
import rig
from twin import Twin

from canroll.firmware.state import ACTIVE

TICK = 0.01
DELAYED = np.array([0.0, 2000.0, 0.0, 0.0, 0.0])


def twin_of(vehicle: rig.Vehicle, tick: float, law, steps: int) -> Twin:
    model = rig.observer_model(vehicle, tick)
    return Twin(
        model.phi,
        model.gamma,
        model.gamma_steering,
        model.output[:2],
        model.sequential,
        law,
        predict_steps=steps,
        actuator_rate=1 - np.exp(-tick / 0.015),
        moment_max=4000.0,
        slew_max=4000.0,
        bias_max=0.05,
    )


def roundabout(t: float) -> float:
    return 3.5 * (np.tanh(t - 2) + 1) / 2 - 5.0 * (np.tanh(t - 8) + 1) / 2


def worst_difference(bench: rig.Bench, twin: Twin, ay, seconds: float) -> tuple[float, float]:
    """Largest difference of the moments and the largest moment, N·m."""
    difference, peak, first = 0.0, 0.0, True
    for _ in range(round(seconds / bench.tick)):
        bench.step(ay)
        # an E2E receiver's first frame only tells the counter
        received = {} if first else bench.received
        first = False
        ecu = bench.ecu
        moment = twin.tick(received, authority=ecu.authority / 2**30, active=ecu.mode == ACTIVE)
        twin.sent(ecu.triggered > 0)
        difference = max(difference, abs(moment - ecu.moment / 2**14))
        peak = max(peak, abs(moment))
    assert bench.ecu.mode == ACTIVE
    assert bench.ecu.fault_latched == 0
    return difference, peak


@pytest.mark.parametrize("ay", [rig.lane_change, roundabout], ids=["lane_change", "roundabout"])
@pytest.mark.parametrize("steps", [0, 2, 10])
@pytest.mark.parametrize("vehicle", [rig.VAN, rig.SUV], ids=["van", "suv"])
def test_state_feedback_stays_within_one_newton_metre(vehicle, steps, ay):
    gain = rig.FEEDBACK + rig.FEEDFORWARD
    cal = rig.calibration(vehicle, predict_steps=steps)
    bench = rig.Bench(
        cal, vehicle, delay=steps, noise=(0.0017, 0.05), bias=(0.002, 0.05), seed=steps
    )
    twin = twin_of(vehicle, TICK, lambda ahead, rate, lateral: -gain @ ahead, steps)
    difference, peak = worst_difference(bench, twin, ay, 8.5)
    assert peak > 500.0
    assert difference < 0.1 if steps < 10 else difference < 1.0


@pytest.mark.parametrize("tick", [0.001, 0.005, 0.02])
def test_at_every_tick_the_loop_allows(tick):
    gain = rig.FEEDBACK + rig.FEEDFORWARD
    bench = rig.Bench(rig.calibration(tick=tick, predict_steps=2), delay=2, noise=(0.0017, 0.05))
    twin = twin_of(rig.VAN, tick, lambda ahead, rate, lateral: -gain @ ahead, 2)
    difference, peak = worst_difference(bench, twin, rig.lane_change, 3.0)
    assert peak > 500.0
    assert difference < 1.0


def test_an_event_trigger_changes_what_is_under_way_not_what_is_computed():
    gain = rig.FEEDBACK + rig.FEEDFORWARD
    cal = rig.calibration(
        predict_steps=3,
        event_trigger=1,
        trigger_epsilon_squared=round(0.1 * 2**20),
        trigger_floor=60 << 14,
    )
    bench = rig.Bench(cal, delay=3, noise=(0.0017, 0.05))
    twin = twin_of(rig.VAN, TICK, lambda ahead, rate, lateral: -gain @ ahead, 3)
    difference, _ = worst_difference(bench, twin, rig.lane_change, 10.0)
    assert bench.commands < 600
    assert difference < 1.0


def test_limits_hold_and_are_the_same():
    gain = 3 * (rig.FEEDBACK + rig.FEEDFORWARD)
    cal = rig.calibration(
        feedback=3 * rig.FEEDBACK,
        feedforward=3 * rig.FEEDFORWARD,
        moment_max=1500 << 14,
        slew_max=100 << 14,
    )
    bench = rig.Bench(cal)
    twin = twin_of(rig.VAN, TICK, lambda ahead, rate, lateral: -gain @ ahead, 0)
    twin.moment_max, twin.slew_max = 1500.0, 100.0
    difference, peak = worst_difference(bench, twin, rig.lane_change, 6.0)
    assert peak == 1500.0
    assert difference < 0.1
