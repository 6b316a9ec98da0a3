"""Contact patches that move sideways with roll: what changes, and what must not."""

from dataclasses import replace

import numpy as np
import pytest

import vehicles
from plant_sim import bodies
from plant_sim.bodies import ports
from plant_sim.driving import maneuvers
from plant_sim.world.linearise import find_trim
from plant_sim.world.open_loop import run_passive
from vehicles.model import Kinematics

VAN = vehicles.load("van_real")
NONLINEAR = bodies.body("nonlinear")


def scrubbing(vehicle, share=1.0):
    return replace(vehicle, kinematics=Kinematics(share))


def lane_change(vehicle):
    return run_passive(vehicle, NONLINEAR, maneuvers.build("double_lane_change", vehicle))[0]


def test_roll_centres_on_the_road_move_no_contact_patch():
    flat = replace(
        VAN,
        geometry=replace(VAN.geometry, roll_centre_height_front=0.0, roll_centre_height_rear=0.0),
    )
    assert lane_change(scrubbing(flat)).tobytes() == lane_change(flat).tobytes()


def test_steady_curve_is_the_same():
    """Nothing rolls there, and the sprung forces balance about the roll axis under their CG."""
    without, with_scrub = (
        find_trim(vehicle, NONLINEAR, speed=80 / 3.6, lateral_acceleration=4.0)
        for vehicle in (VAN, scrubbing(VAN))
    )
    assert with_scrub.inputs[ports.STEER] == pytest.approx(without.inputs[ports.STEER], rel=1e-3)
    assert with_scrub.outputs[ports.ROLL] == pytest.approx(without.outputs[ports.ROLL], rel=3e-3)


def test_half_the_share_is_half_the_effect_of_a_small_roll():
    roll = [
        np.degrees(lane_change(vehicle)[1000:4000, ports.ROLL])
        for vehicle in (VAN, scrubbing(VAN, 0.5), scrubbing(VAN))
    ]
    half, whole = (np.abs(found - roll[0]).max() for found in roll[1:])
    assert 0.02 < whole < 0.3
    assert half == pytest.approx(0.5 * whole, rel=0.1)
