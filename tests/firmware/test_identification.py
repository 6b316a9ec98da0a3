"""Identified roll stiffness and damping against the plant's, the adapted model against expm."""

import math
from dataclasses import replace

import numpy as np
import pytest
import rig
from scipy.linalg import expm

from canroll.firmware.identification import adapt_model
from canroll.firmware.state import ACTIVE

RATIO = 2.0**-28


def changed(vehicle: rig.Vehicle, stiffness: float, damping: float) -> rig.Vehicle:
    """The same vehicle with other effective roll stiffness (K − m g h) and damping."""
    extra = vehicle.stiffness * (stiffness - 1)
    return replace(
        vehicle,
        roll_stiffness=vehicle.roll_stiffness + extra,
        damping=vehicle.damping * damping,
    )


def identified(bench: rig.Bench, seconds: float, ay) -> np.ndarray:
    bench.run(seconds, ay)
    assert bench.ecu.mode == ACTIVE
    return np.array(bench.ecu.theta) * RATIO


FIFTHS = [(1.2, 0.8), (0.8, 1.2), (1.2, 1.2), (0.8, 0.8), (1.0, 1.0)]


@pytest.mark.parametrize(
    ("vehicle", "ratios"), [*((rig.VAN, r) for r in FIFTHS), *((rig.SUV, r) for r in FIFTHS[:2])]
)
def test_changes_of_a_fifth_are_found_in_three_lane_changes(vehicle, ratios):
    plant = changed(vehicle, *ratios)
    # the stiff car rolls little: it needs a finer gate and harder manoeuvres, and learns less
    van = vehicle is rig.VAN
    gate = round((0.045 if van else 0.02) * 2**27)
    bench = rig.Bench(rig.calibration(vehicle, identification=1, rls_gate=gate), plant).run(6.0)
    found = identified(bench, 18.0, lambda t: rig.lane_change(t, 4.0 if van else 6.0))
    np.testing.assert_allclose(found, ratios, rtol=0.01 if van else 0.02)


@pytest.mark.parametrize("ratios", [(1.2, 0.8), (0.8, 1.2)])
def test_noise_and_a_late_actuator_cost_little(ratios):
    plant = changed(rig.VAN, *ratios)
    cal = rig.calibration(identification=1, predict_steps=2)
    bench = rig.Bench(cal, plant, delay=2, noise=(0.0017, 0.05), bias=(0.003, 0.0), seed=1)
    found = identified(bench, 18.0, rig.lane_change)
    np.testing.assert_allclose(found, ratios, rtol=0.05)


def test_nothing_is_learnt_on_a_straight_road():
    noise, bias = (0.0017, 0.05), (0.004, 0.1)
    bench = rig.Bench(rig.calibration(identification=1), noise=noise, bias=bias, seed=2)
    found = identified(bench, 60.0, lambda t: 0.0)
    np.testing.assert_allclose(found, 1.0, atol=0.01)


def test_what_was_learnt_stays_on_a_straight_road():
    plant = changed(rig.VAN, 1.2, 0.8)
    noise = (0.0017, 0.03)
    bench = rig.Bench(rig.calibration(identification=1), plant, noise=noise, seed=4)
    learnt = identified(bench, 18.0, rig.lane_change)
    later = identified(bench, 30.0, lambda t: 0.0)
    np.testing.assert_allclose(later, learnt, atol=0.005)


@pytest.mark.parametrize("tick", [0.001, 0.005, 0.01])
@pytest.mark.parametrize("vehicle", [rig.VAN, rig.SUV], ids=["van", "suv"])
@pytest.mark.parametrize("ratios", [(1.0, 1.0), (1.6, 0.4), (0.5, 2.0), (1.2, 0.8)])
def test_the_adapted_model_is_the_exponential(vehicle, ratios, tick):
    cal = rig.calibration(vehicle, tick=tick, identification=1)
    ecu = rig.started(cal)
    ecu.theta = [round(ratio / RATIO) for ratio in ratios]
    adapt_model(ecu, cal)
    plant = changed(vehicle, *ratios)
    block = np.zeros((4, 4))
    block[:2, :2] = plant.a()
    block[1, 2:] = plant.moment_per_acceleration / plant.inertia, 1 / plant.inertia
    block *= tick
    series = sum(np.linalg.matrix_power(block, k) / math.factorial(k) for k in range(4))[:2]
    scale = np.array(rig.taylor_units(plant, tick))
    factors = np.array([30, 27, 24, 14])
    stored = 2.0 ** (factors - rig.STATE_Q[:2, None] - np.array(cal.phi_shift[:2])[:, None])
    ours = np.array(ecu.model) * stored
    # one unit of the stored coefficient, and the rounding of Q28 ratios and Q30 products
    assert np.all(np.abs(ours - series) < stored + 2e-8 * scale)
    # the first term left out is of second order at least, over 24
    first_omitted = (block[1, 1] ** 2 + abs(block[1, 0])) / 20
    assert np.max(np.abs(series - expm(block)[:2]) / scale) < first_omitted


def test_identification_improves_the_estimate_of_a_changed_vehicle():
    plant = changed(rig.VAN, 1.2, 0.8)
    error = {}
    for identification in (0, 1):
        bench = rig.Bench(rig.calibration(identification=identification), plant)
        bench.run(18.0, rig.lane_change)
        errors = []
        for _ in range(300):
            truth = bench.x[0]
            bench.step(rig.lane_change(bench.t))
            errors.append(bench.ecu.x[0] * 2.0**-30 - truth)
        error[identification] = np.sqrt(np.mean(np.square(errors)))
    assert error[1] < 0.8 * error[0]
