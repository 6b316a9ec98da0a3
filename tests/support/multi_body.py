"""The CommonRoad multi-body car (PyPI ``commonroad-vehicle-models``) driven by a steering table.

Sprung body and two axles as rigid bodies, 29 states, derived independently from the DOT's vehicle
dynamics. Its axes are those of SAE, z down: its motion to the right is ours to the left. Its
heights are those on unloaded tyres, ours on loaded ones.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import atan, atan2, cos, sin
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from vehiclemodels import vehicle_dynamics_mb as published
from vehiclemodels.init_mb import init_mb

from canroll.typing import Vector
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.model import Tyre
from canroll.vehicles.roll_stiffness import axle_roll_shares, suspension_roll_stiffness

STEP = 1e-3
"""Time step (s) of tables and of the classical Runge-Kutta step."""

STIFF_JOINT = (1e7, 1e5)
"""Stiffness (N/m) and damping (N·s/m) of the lateral joints where our plant has none."""

SLOWEST = 10.0
"""Speed (m/s) down to which the spin of light wheels is integrated with a margin of five."""

_STATES = 29
_YAW_RATE, _ROLL, _VX, _VY = 5, 6, 3, 10
_HEAVE, _PITCH = 11, 8
_AXLES = (
    SimpleNamespace(roll=13, roll_rate=14, side=15, height=16),
    SimpleNamespace(roll=18, roll_rate=19, side=20, height=21),
)
_UNUSED = (
    *("r_bx1", "r_bx2", "r_ex1", "r_hx1", "r_by1", "r_by2", "r_by3", "r_ey1", "r_hy1", "r_vy1"),
    *("r_vy3", "r_vy4", "r_vy5", "r_vy6", "p_dx3", "p_hx1", "p_vx1", "p_dy3", "p_hy1", "p_hy3"),
    *("p_vy1", "p_vy3"),
)


class Motion(NamedTuple):
    """Motion of either car, a row per step: the project's axes, SI units."""

    yaw_rate: Vector
    roll: Vector
    lateral_acceleration: Vector
    loads: Vector
    """Of the wheels front left, front right, rear left, rear right, (n, 4)."""
    speed: Vector
    sideslip: Vector
    roll_rate: Vector
    body_acceleration: Vector
    """Lateral, of the sprung body's CG; ``lateral_acceleration`` is that of the whole car's."""


def light_wheel(tyre: Tyre, step: float) -> float:
    """Return the spin inertia (kg·m²) of a wheel as light as a Runge-Kutta step (s) allows.

    Its spin follows the car with the time constant I v / (C R²), here half a step.
    """
    return 0.5 * step * tyre.longitudinal_stiffness * tyre.radius**2 / SLOWEST


def parameters(vehicle: Vehicle) -> SimpleNamespace:
    """Return the multi-body car's parameters equal to those of ``vehicle``, joints stiff.

    Features it lacks must be neutral in the vehicle: one cornering stiffness per load for both
    axles, grip independent of load, linear dampers, unsprung masses that leave the CG of the body
    below that of the car. Its wheels are no gyroscopes; both cars have light ones.
    """
    geometry, mass, suspension = vehicle.geometry, vehicle.mass, vehicle.suspension
    tyre, plant = vehicle.tyre, vehicle.plant
    tracks = geometry.half_track_front, geometry.half_track_rear
    springs = suspension.spring_rate_front, suspension.spring_rate_rear
    unsprung = mass.unsprung_front, mass.unsprung_rear
    stiffness = suspension_roll_stiffness(vehicle)
    bars = [
        share * stiffness - 2 * spring * track**2
        for share, spring, track in zip(axle_roll_shares(vehicle), springs, tracks, strict=True)
    ]
    front = suspension.roll_damping_front_share
    dampers = [
        share * plant.roll_damping / (2 * track**2)
        for share, track in zip((front, 1 - front), tracks, strict=True)
    ]
    weight = vehicle.total_mass * GRAVITY
    stands_lower = weight / (4 * tyre.vertical_stiffness)
    tire = dict.fromkeys(_UNUSED, 0.0) | {
        "p_cx1": tyre.shape,
        "p_dx1": tyre.friction,
        "p_ex1": tyre.curvature,
        "p_kx1": 4 * tyre.longitudinal_stiffness / weight,
        "p_cy1": tyre.shape,
        "p_dy1": tyre.friction,
        "p_ey1": tyre.curvature,
        "p_ky1": -tyre.cornering_stiffness_front / (weight * geometry.static_front_share),
        "r_cx1": 1.0,
        "r_cy1": 1.0,
    }
    return SimpleNamespace(
        m=vehicle.total_mass,
        m_s=plant.sprung_mass,
        m_uf=unsprung[0],
        m_ur=unsprung[1],
        a=geometry.cg_to_front_axle,
        b=geometry.cg_to_rear_axle,
        I_Phi_s=plant.inertia_about_cg,
        I_y_s=mass.pitch_inertia,
        I_z=mass.yaw_inertia,
        I_xz_s=0.0,
        I_uf=unsprung[0] * tracks[0] ** 2,
        I_ur=unsprung[1] * tracks[1] ** 2,
        I_y_w=light_wheel(tyre, STEP),
        K_sf=springs[0],
        K_sr=springs[1],
        K_sdf=dampers[0],
        K_sdr=dampers[1],
        K_tsf=-bars[0],
        K_tsr=-bars[1],
        K_ras=STIFF_JOINT[0],
        K_rad=STIFF_JOINT[1],
        K_zt=tyre.vertical_stiffness,
        K_lt=0.0,
        T_f=2 * tracks[0],
        T_r=2 * tracks[1],
        R_w=tyre.radius + stands_lower,
        h_s=vehicle.sprung_cg_height + stands_lower,
        h_raf=geometry.roll_centre_height_front + stands_lower,
        h_rar=geometry.roll_centre_height_rear + stands_lower,
        D_f=0.0,
        D_r=0.0,
        E_f=0.0,
        E_r=0.0,
        T_sb=0.6,
        T_se=0.0,
        tire=SimpleNamespace(**tire),
        steering=SimpleNamespace(min=-2.0, max=2.0, v_min=-1e3, v_max=1e3),
        longitudinal=SimpleNamespace(v_min=-10.0, v_max=100.0, v_switch=8.0, a_max=11.5),
    )


def standing(p: Any, speed: float) -> Vector:
    """Return the state of straight running at ``speed`` (m/s) with springs and tyres at rest."""
    state = np.array(init_mb([0, 0, 0, speed, 0, 0, 0], p), dtype=float)
    front, rear = (state[axle.height] for axle in _AXLES)
    state[_PITCH] = (rear - front) / (p.a + p.b)
    state[_HEAVE] = front + p.a * state[_PITCH]
    return state


class _AtContactPatch:
    """The published tyre with the slip angle of its wheel at the road.

    The published car takes it from the velocity of the sprung body's CG with the roll rate of the
    axle. Wheels are called in the order left, right, front before rear.
    """

    def __init__(self, p: Any) -> None:
        self.p = p
        self.state: list[float] = []
        self.wheel = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(_PUBLISHED_TYRE, name)

    def formula_lateral(self, _published: float, camber: float, load: float, tire: Any) -> Any:
        axle, (side, track) = _AXLES[self.wheel // 2], self._place()
        x = self.state
        aside = x[axle.side] - x[axle.roll_rate] * (self.p.R_w - x[axle.height])
        slip = atan(aside / (x[_VX] + side * 0.5 * track * x[_YAW_RATE]))
        if self.wheel < 2:
            slip -= x[2]
        self.wheel = (self.wheel + 1) % 4
        return _PUBLISHED_TYRE.formula_lateral(slip, camber, load, tire)

    def _place(self) -> tuple[float, float]:
        side = 1.0 if self.wheel % 2 == 0 else -1.0
        return side, self.p.T_f if self.wheel < 2 else self.p.T_r


_PUBLISHED_TYRE = published.tireModel


@contextmanager
def _rates(p: Any, *, as_published: bool) -> Iterator[Callable[[Vector, float], Vector]]:
    """Return the rates of the state at a steering angle (rad), as published or completed.

    That is the slip at the road, and in the yaw equation the axles' sideways motion relative to the
    body: the published one has the whole car's inertia, as if axles did not move.
    """
    tyre = _AtContactPatch(p)
    moments = p.m_uf * p.a, -p.m_ur * p.b
    rigid = p.I_z - p.m_uf * p.a**2 - p.m_ur * p.b**2

    def rates(state: Vector, steer: float) -> Vector:
        x = state.tolist()
        x[2] = steer
        tyre.state = x
        rate = np.array(published.vehicle_dynamics_mb(x, [0.0, 0.0], p))
        if not as_published:
            apart = sum(
                moment * (rate[axle.side] - rate[_VY])
                for moment, axle in zip(moments, _AXLES, strict=True)
            )
            rate[_YAW_RATE] = (p.I_z * rate[_YAW_RATE] - apart) / rigid
        return rate

    try:
        if not as_published:
            published.tireModel = tyre
        yield rates
    finally:
        published.tireModel = _PUBLISHED_TYRE


def simulate(
    p: Any,
    speed: float,
    steer: Vector,
    moments: NDArray[np.float64] | None = None,
    *,
    as_published: bool = False,
) -> Motion:
    """Drive the multi-body car from ``speed`` (m/s), coasting.

    Args:
        p: its parameters, from :func:`parameters` or the package.
        speed: in m/s.
        steer: road-wheel angle (rad), one value per millisecond.
        moments: anti-roll moment of front and rear axle (N·m), (n, 2), which lifts the left side of
            the body and loads the left wheels; none by default.
        as_published: the package's own slip angles and yaw equation; else slip at the contact
            patches, and axles that move sideways in the yaw equation too.
    """
    pushed = np.zeros((steer.size, _STATES))
    if moments is not None:
        pushed[:, _ROLL + 1] = -moments.sum(axis=1) / p.I_Phi_s
        pushed[:, _AXLES[0].roll_rate] = moments[:, 0] / p.I_uf
        pushed[:, _AXLES[1].roll_rate] = moments[:, 1] / p.I_ur
    state = standing(p, speed)
    yaw_rate, roll, lateral, speeds, sideslip, roll_rate, body = np.empty((7, steer.size))
    loads = np.empty((steer.size, 4))
    with _rates(p, as_published=as_published) as rates:
        for i, (angle, push) in enumerate(zip(steer, pushed, strict=True)):
            k1 = rates(state, angle) + push
            k2 = rates(state + 0.5 * STEP * k1, angle) + push
            k3 = rates(state + 0.5 * STEP * k2, angle) + push
            k4 = rates(state + STEP * k3, angle) + push
            state = state + STEP / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
            rate = rates(state, angle)
            yaw_rate[i], roll[i] = state[_YAW_RATE], -state[_ROLL]
            lateral[i] = state[_YAW_RATE] * state[_VX] + (
                p.m_s * rate[_VY] + p.m_uf * rate[_AXLES[0].side] + p.m_ur * rate[_AXLES[1].side]
            ) / (p.m_s + p.m_uf + p.m_ur)
            loads[i] = _loads(p, state)
            speeds[i], roll_rate[i] = state[_VX], -state[_ROLL + 1]
            sideslip[i] = atan2(state[_VY], state[_VX])
            body[i] = rate[_VY] + state[_YAW_RATE] * state[_VX]
    return Motion(yaw_rate, roll, lateral, loads, speeds, sideslip, roll_rate, body)


def _loads(p: Any, state: Vector) -> list[float]:
    found = []
    for axle, track in zip(_AXLES, (p.T_f, p.T_r), strict=True):
        middle = state[axle.height] + p.R_w * (cos(state[axle.roll]) - 1.0)
        apart = 0.5 * track * sin(state[axle.roll])
        # mirrored: its left wheel is our right one
        found += [p.K_zt * (middle + apart), p.K_zt * (middle - apart)]
    return found
