"""The sedan's file is what was published, and its driver clears the cones."""

from math import pi

import numpy as np
import pytest

from canroll import vehicles
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness
from canroll.vehicles.unladen import unladen

SEDAN = vehicles.load("sedan_320i")


def test_parameters_are_the_published_ones():
    published = pytest.importorskip(
        "vehiclemodels.parameters_vehicle2", reason="needs commonroad-vehicle-models"
    ).parameters_vehicle2()
    p, tyre = published, published.tire
    plant, geometry, suspension = SEDAN.plant, SEDAN.geometry, SEDAN.suspension
    springs = [
        p.K_sf * p.T_f**2 / 2 - p.K_tsf,
        p.K_sr * p.T_r**2 / 2 - p.K_tsr,
    ]
    dampers = [p.K_sdf * p.T_f**2 / 2, p.K_sdr * p.T_r**2 / 2]
    axles = p.m * 9.81 * np.array([geometry.cg_to_rear_axle, geometry.cg_to_front_axle])
    axles /= geometry.wheelbase
    equal = {
        SEDAN.total_mass: p.m,
        plant.sprung_mass: p.m_s,
        plant.cg_height_above_roll_axis: p.h_s,
        plant.inertia_about_cg: p.I_Phi_s,
        SEDAN.mass.yaw_inertia: p.I_z,
        SEDAN.mass.pitch_inertia: p.I_y_s,
        geometry.wheelbase: p.a + p.b,
        geometry.cg_to_front_axle - SEDAN.sprung_cg_offset: p.a,
        suspension_roll_stiffness(SEDAN): sum(springs),
        suspension.roll_stiffness_front_share: springs[0] / sum(springs),
        plant.roll_damping: sum(dampers),
        suspension.roll_damping_front_share: dampers[0] / sum(dampers),
        SEDAN.tyre.cornering_stiffness_front: -tyre.p_ky1 * axles[0],
        SEDAN.tyre.cornering_stiffness_rear: -tyre.p_ky1 * axles[1],
        SEDAN.tyre.longitudinal_stiffness: tyre.p_kx1 * p.m * 9.81 / 4,
        SEDAN.tyre.vertical_stiffness: p.K_zt,
    }
    assert list(equal) == pytest.approx(list(equal.values()), rel=2e-3)
    # the published height of the whole car's CG has the wheels at 0.28 m, not at their radius
    assert SEDAN.cg_height == pytest.approx(p.h_cg, rel=0.02)


def test_it_is_another_class_of_vehicle():
    van = vehicles.load("van_real")
    assert SEDAN.total_mass < 0.45 * van.total_mass
    assert SEDAN.static_stability_factor > van.static_stability_factor + 0.1
    assert 2 * pi * 1.2 < SEDAN.plant.natural_frequency < 2 * pi * 1.4
    assert unladen(SEDAN).total_mass == pytest.approx(SEDAN.total_mass - 75.0)
