"""What balances may have left over, as shares: the largest over the box.

The slow one of the body: springs that bear what acts show K, moments M are reported, m h a_y = L is
measured. Of a car with μ times the nominal mass and height, κ times the stiffness and moments of m
times the reported ones κ K = μ L + m M. A law's moments oppose the lateral force and are no larger.

One axle's tyres less the other's: springs, dampers and tyres are other than designed for, but bear
only what acts: lateral forces at the roll centres and the actuators' moments. So what that balance
has left over is a share of these, the largest over corners and frequencies of steering. Brisker
steering or a slower car leaves over more, and moves the suspensions apart by more: what is allowed
for a bump holds that.
"""

from collections.abc import Iterator
from itertools import product
from math import pi

import numpy as np
from numpy.typing import NDArray

from canroll.gain_gen.monitors.linear_car import Car, Pair, axle_forces, sprung_masses
from canroll.gain_gen.monitors.uncertainty import Factors, Uncertainty, vertices
from canroll.vehicles import GRAVITY
from canroll.vehicles.axles import axles

Corner = tuple[float, float, float]
FREQUENCIES = (0.0, 0.35, 0.7)
"""Of steering, Hz: up to that of the sine with dwell (FMVSS 126)."""
SPEED = 20.0
"""At which the lateral acceleration of a frequency makes a yaw acceleration, m/s."""


def corners(box: Uncertainty) -> Iterator[Corner]:
    """Yield μ, κ and m at the corners of the box."""
    for factors in vertices(box, ("mass", "height", "stiffness")):
        for moment in (1.0 - box.moment, 1.0 + box.moment):
            yield factors.mass * factors.height, factors.stiffness, moment


def of_moments(box: Uncertainty) -> tuple[float, float, float]:
    """Return the shares where it judges the moments by the lateral force.

    K − L − M = (μ/κ − 1) L + (m/κ − 1) M: of L where that is to the side of L and where it is to
    the other, and of M.
    """
    own = max(mu / kappa for mu, kappa, _ in corners(box)) - 1.0
    other = 1.0 - min(mu / kappa for mu, kappa, _ in corners(box))
    # with M = −L, the largest there is
    besides = max(
        max((mu - moment) / kappa - own, (moment - mu) / kappa - other)
        for mu, kappa, moment in corners(box)
    )
    return own, other, max(0.0, besides)


def of_lateral(box: Uncertainty) -> tuple[float, float, float]:
    """Return the shares where it judges the lateral acceleration by what the body shows.

    S = K − M shows L: S − L = (1 − κ/μ) S + (m − κ)/μ M: of S where that is to the side of S and
    where it is to the other, and of M.
    """
    ends = [
        (1.0 - kappa / mu, (m - kappa) / mu, (mu + kappa - m) / kappa)
        for mu, kappa, m in corners(box)
    ]
    own, other = max(a for a, _, _ in ends), -min(a for a, _, _ in ends)
    # with M = −L, the largest there is, and S by it
    besides = max(max((a - own) * s - b, (-a - other) * s + b) for a, b, s in ends)
    return own, other, max(0.0, besides)


def of_axles(car: Car, box: Uncertainty) -> Pair:
    """Return what may be left over per measured lateral acceleration (kg·m) and per axle's moment.

    That of the rear axle counts as on the front's tyres.
    """
    by_lateral = by_moment = 0.0
    reported = np.array([1.0, -car.scale[1]])
    names = ("mass", "height", "stiffness", "damping", "tyre")
    heights = -box.roll_centre, box.roll_centre
    moved = product(heights, heights)
    for factors, centres, frequency in product(vertices(box, names), moved, FREQUENCIES):
        left, measured = response(car, factors, centres, 2j * pi * frequency)
        by_lateral = max(by_lateral, float(abs(left[0] / measured)))
        for true in (1.0 - box.moment, 1.0 + box.moment):
            share = np.abs((true * left[1:] - reported) / reported)
            by_moment = max(by_moment, float(share.max()))
    return by_lateral, by_moment


def response(
    car: Car, f: Factors, centres: Pair, s: complex
) -> tuple[NDArray[np.complex128], complex]:
    """Return what acts on a car, as the balance of the nominal one sees it, and the unit's a_y.

    The first are moments on the front axle's tyres at the complex frequency ``s``, less reported
    moments: per lateral acceleration of the roll axis, true front and rear moment. The second is
    per lateral acceleration. ``centres`` are moved up by so much, m.
    """
    vehicle, roll = car.vehicle, car.vehicle.design
    springs, dampers = car.stiffness * np.array(car.shares), np.array(car.dampers)
    borne = f.stiffness * springs + f.damping * dampers * s
    inertia = f.mass * f.height**2 * (roll.roll_inertia - roll.inertia_about_cg)
    inertia += f.inertia * roll.inertia_about_cg
    arm, lever = f.mass * f.height * roll.roll_arm, f.height * roll.cg_height_above_roll_axis
    both = axles(vehicle)
    heights = np.array([axle.roll_centre for axle in both]) + centres
    at_centres = f.mass * np.array(sprung_masses(vehicle)) * heights
    on_road = at_centres + vehicle.tyre.radius * np.array([axle.unsprung for axle in both])
    by_yaw = f.mass * vehicle.mass.yaw_inertia / vehicle.geometry.wheelbase * s / SPEED
    # body, front and rear tilt; by lateral acceleration, front and rear moment
    tilted = f.tyre * np.array(car.tyres) + borne - GRAVITY * on_road
    matrix = np.diag(np.array([0.0, *tilted], complex))
    matrix[0] = [inertia * s**2 + borne.sum() - arm * GRAVITY, *-borne]
    matrix[1:, 0] = lever * at_centres * s**2 - borne
    acting = np.zeros((3, 3), complex)
    acting[0] = [arm, 1.0, 1.0]
    acting[1:] = np.column_stack([on_road + by_yaw * heights * [1.0, -1.0], -np.eye(2)])
    tilt = np.linalg.solve(matrix, acting)
    strokes = tilt[0] - tilt[1:]
    measured = (GRAVITY - (lever + vehicle.sensors.imu_position[2]) * s**2) * tilt[0]
    measured[0] += 1.0
    lateral, yaw = axle_forces(vehicle, car.scale)
    scale = np.array([1.0, -car.scale[1]])
    left = (scale * (springs + dampers * s + np.array(car.tyres))) @ strokes + lateral * measured
    left[0] += yaw * s / SPEED
    return left, complex(measured[0])
