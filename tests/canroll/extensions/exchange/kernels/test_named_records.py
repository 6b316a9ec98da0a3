"""A kernel that reads its parameters by name, and chooses by them, is the same in C."""

import ctypes

import numpy as np
import pytest

from canroll.extensions.exchange.kernels.kinds import FLOAT, ArrayKind
from canroll.plant_sim.bodies import tyre
from canroll.plant_sim.kernels.jit import inlined, njit, record_of

AXLE = np.dtype([("spring", "f8"), ("tyre_model", "f8"), ("tyre", "f8", (tyre.ROOM,))])
CAR = np.dtype([("mass", "f8"), ("load", "f8", (2,)), ("axle", AXLE, (2,))])
_car_of = record_of(CAR)


@inlined
def _soft(axle, load, slip_ratio, slip_angle, camber, friction, hand):  # noqa: PLR0917
    return (
        axle.tyre[0] * slip_ratio,
        axle.tyre[1] * slip_angle * friction,
        0.1 * camber * load * hand,
    )


_forces = tyre.chosen((tyre.similarity, _soft))


@njit
def _summed(parameters, slip):
    car = _car_of(parameters)
    total = car.mass
    for k in range(2):
        axle = car.axle[k]
        ahead, aside, aligning = _forces(axle, car.load[k], slip, 0.1, 0.2, 0.8, -1.0)
        total += axle.spring * (ahead + 2.0 * aside + 4.0 * aligning)
    return total


def test_each_axle_has_the_tyre_of_its_number(compiled):
    vector = ArrayKind(np.dtype(np.float64), (CAR.itemsize // 8,))
    in_c = compiled(_summed, (vector, FLOAT), ctypes.c_double)
    record = np.zeros(1, CAR)
    car = record[0]
    car["mass"], car["load"] = 10.0, (3000.0, 4000.0)
    car["axle"]["spring"], car["axle"]["tyre_model"] = (2.0, 3.0), (0, 1)
    car["axle"]["tyre"][0, :8] = [1 / 3500.0, 9e4, 8e4, 0.9, 0.1, 0.1, 1.3, -0.2]
    car["axle"]["tyre"][1, :2] = 7.0, 5.0
    parameters = record.view(np.float64)
    for slip in (0.0, 0.01, 0.3):
        found = _summed(parameters, slip)
        soft = 7.0 * slip + 2.0 * 5.0 * 0.1 * 0.8 + 4.0 * -0.1 * 0.2 * 4000.0
        ahead, aside, _ = tyre._forces_of(car["axle"][0], 3000.0, slip, 0.1, 0.2, 0.8, -1.0)
        assert found == pytest.approx(10.0 + 2.0 * (ahead + 2.0 * aside) + 3.0 * soft, rel=1e-12)
        assert in_c(parameters, slip) == found
