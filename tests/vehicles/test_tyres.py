"""Tyre models: what designs have in closed form is what the plant's kernel does."""

from dataclasses import replace

import numpy as np
import pytest

from canroll import vehicles
from canroll.plant_sim.bodies.tyre import KERNELS
from canroll.vehicles.axles import TYRES, axles
from canroll.vehicles.tyres import TyreModel

TYRE = axles(vehicles.load("van_real"))[0].tyre
LOADS = [0.3 * TYRE.static_load, TYRE.static_load, 1.6 * TYRE.static_load, 6.0 * TYRE.static_load]


def test_every_model_has_a_kernel():
    assert len(KERNELS) == len(TYRES)


@pytest.mark.parametrize("load", LOADS)
def test_closed_forms_are_those_of_the_kernel(load):
    assert TYRE.linear(load) == pytest.approx(TyreModel.linear(TYRE, load), rel=1e-6)
    assert TYRE.grip(load, 0.7) == pytest.approx(TyreModel.grip(TYRE, load, 0.7), rel=1e-6)
    for slip in (0.0, 0.02, 0.1, -0.1):
        found = TYRE.lateral(load, slip, 0.7)
        assert found == pytest.approx(TyreModel.lateral(TYRE, load, slip, 0.7), rel=1e-5, abs=1e-6)


def test_both_tyres_of_an_axle_have_its_cornering_stiffness():
    van = vehicles.load("van_real")
    stiffnesses = van.tyre.cornering_stiffness_front, van.tyre.cornering_stiffness_rear
    assert tuple(axle.cornering for axle in axles(van)) == stiffnesses


def test_forces_are_linear_when_small_and_round_when_large():
    load = TYRE.static_load
    small = TYRE.forces(load, 1e-5, 2e-5)
    assert small == pytest.approx((1e-5 * TYRE.longitudinal, 2e-5 * TYRE.cornering, 0.0), rel=1e-3)
    ahead, aside, aligning = TYRE.forces(load, 0.3, 0.4)
    assert np.hypot(ahead, aside) <= TYRE.friction * load and aligning == 0.0
    assert aside / ahead == pytest.approx(0.4 * TYRE.cornering / (0.3 * TYRE.longitudinal))
    peak = max(TYRE.forces(load, slip, 0.0)[0] for slip in np.linspace(0, 1, 2000))
    assert peak == pytest.approx(TYRE.friction * load, rel=1e-5)


@pytest.mark.parametrize("case", [(0.0, 0.1, 0.1, 0.0, 1.0), (4000.0, 0.1, 0.1, 0.0, 0.0)])
def test_no_load_or_no_friction_is_no_force(case):
    assert TYRE.forces(*case) == (0.0, 0.0, 0.0)


def test_a_tyre_that_load_does_not_wear_out_is_not_load_sensitive():
    assert TYRE.load_sensitive
    assert not replace(TYRE, friction_load_slope=0.0, cornering_load_slope=0.0).load_sensitive
