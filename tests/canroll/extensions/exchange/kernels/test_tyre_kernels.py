"""The tyres of files are the same in C, where their kernel is called without an address."""

from pathlib import Path

import numpy as np
import pytest

from canroll.extensions.exchange.kernels.kinds import FLOAT, ArrayKind
from canroll.plant_sim.bodies import tyre
from canroll.plant_sim.kernels.jit import njit, record_of
from canroll.vehicles.tyres import tir
from canroll.vehicles.tyres.magic_formula import MagicFormula

AXLE = np.dtype([("tyre_model", "f8"), ("tyre", "f8", (tyre.ROOM,))])
TYRES = Path(__file__).parents[4] / "vehicles" / "tyres"
_axle_of = record_of(AXLE)


@njit
def _forces(parameters, slips, hand):
    axle = _axle_of(parameters)
    ahead, aside, aligning = tyre.forces(axle, 3000.0, slips[0], slips[1], slips[2], 0.8, hand)
    slips[0], slips[1], slips[2] = ahead, aside, aligning


@pytest.mark.parametrize("name", ["passenger_52", "passenger_62"])
def test_a_tyre_of_a_file_is_the_same_in_c(compiled, name):
    vectors = [ArrayKind(np.dtype(np.float64), (size,)) for size in (AXLE.itemsize // 8, 3)]
    in_c = compiled(_forces, (*vectors, FLOAT))
    record = np.zeros(1, AXLE)
    tyre.fill(record[0], MagicFormula.of(tir.read(TYRES / f"{name}.tir")))
    parameters = record.view(np.float64)
    for slips in ([0.0, 0.0, 0.0], [0.02, -0.05, 0.03], [-1.0, 0.4, -0.1]):
        for hand in (1.0, -1.0):
            here, there = np.array(slips), np.array(slips)
            _forces(parameters, here, hand)
            in_c(parameters, there, hand)
            assert np.abs(here).max() > 1.0
            np.testing.assert_allclose(there, here, rtol=1e-12)
