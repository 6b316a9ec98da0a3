"""The ten-state linear car of a vehicle's data sheet: the design model of the full vehicle.

Lateral slip, yaw, roll, the roll of both axles on their tyres, and the slip angles that build up
over the relaxation length, at constant speed, about straight running or a steady curve. With the
sideways motion of sprung CG, axle CGs and contact patches per rate of u = (v_y, r, φ', ψ_f', ψ_r'),

    J_s = (1, x_s, −h, 0, 0)      J_i = (1, x_i, h_a − h_i, −(R − h_i))      P_i = (…, h_i)

Lagrange's equations in u are, W_i being the sprung load on axle i and H_i the angular momentum of
its wheels,

    (Σ m J'J + diag(0, I_ψ, I_φ, m_f t_f², m_r t_r²)) u' = P'F − v r Σ m J' + Q
    Q_φ = ΣT + m_s g h φ        Q_r = −Σ (H_i ψ_i' + 2 t_i c · load moved to the right)
    Q_ψi = −T_i − 2 t_i² (k_t ψ_i + c_t ψ_i') + (W_i h_i + m_i g R) ψ_i + H_i r
    T_i = k_i (ψ_i − φ) + c_i (ψ_i' − φ') + s_i M
    σ/v α_i' = δ_i − P_i u/v − α_i,     F_i = C_i α_i + G_i · load moved to the right

with I_ψ the yaw inertia of the body, of the axles (m_i t_i²) and of their wheels (2 I_w t_i²/R²),
which roll faster on the outside, and c the rolling resistance; for axle i with track t_i,
roll-centre height h_i, mass m_i and its share s_i of the moment M; h_a is the height of the roll
axis under the sprung CG. Signs as everywhere: roll > 0 lifts the left side, steering > 0 is left.
Active suspension and active bars are the same here: one moment on the body, its reaction on the
wheels.
"""

from collections.abc import Sequence

import numpy as np

from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.models.trim import steady_curve
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

STATES = (
    *("lateral_velocity", "yaw_rate", "roll", "roll_rate"),
    *("axle_roll_front", "axle_roll_rear", "axle_roll_rate_front", "axle_roll_rate_rear"),
    *("slip_front", "slip_rear"),
)
INPUTS = ("moment", "steering", "roll_disturbance")
"""Anti-roll moment (N·m), road-wheel angle (rad), roll moment on the body from outside (N·m)."""
OUTPUTS = ("roll_rate", "imu_lateral", "roll", "yaw_rate", "lateral_acceleration")
"""Roll rate (rad/s), what the accelerometer reads at its place (m/s²), roll (rad), yaw rate (rad/s)
and the acceleration of the car's CG along the road (m/s²)."""

_VY, _YAW, _ROLL, _ROLL_RATE = range(4)
_TILT, _TILT_RATE, _SLIP = 4, 6, 8
_SPEEDS = [_VY, _YAW, _ROLL_RATE, _TILT_RATE, _TILT_RATE + 1]
_MOMENT, _STEER, _DISTURBANCE = (len(STATES) + i for i in range(len(INPUTS)))
_WIDTH = len(STATES) + len(INPUTS)


def linear_car(
    vehicle: Vehicle,
    speed: float,
    *,
    lateral_acceleration: float = 0.0,
    friction: float = 1.0,
    front_share: float | None = None,
) -> StateSpace:
    """Return the car of the vehicle file, linear about straight running or a steady curve.

    Its states are :data:`STATES`, its inputs and outputs :data:`INPUTS` and :data:`OUTPUTS`.

    Args:
        vehicle: its ``plant`` part and all others; see :func:`canroll.vehicles.unladen.unladen`.
        speed: m/s.
        lateral_acceleration: of the steady curve, m/s². Friction matters only in a curve: in
            straight running the tyres are far from their grip.
        friction: of the road.
        front_share: front axle's share of the moment; None for that of the static load.

    Raises:
        CanrollError: no such steady curve; tyres too soft for the roll stiffness of the file.
    """
    plant, tyre = vehicle.plant, vehicle.tyre
    share = vehicle.geometry.static_front_share if front_share is None else front_share
    stiffness = suspension_roll_stiffness(vehicle)
    unit = np.eye(_WIDTH)
    tyres = steady_curve(vehicle, lateral_acceleration, friction)

    sprung = np.array([1.0, vehicle.sprung_cg_offset, -plant.cg_height_above_roll_axis, 0.0, 0.0])
    inertia = plant.sprung_mass * np.outer(sprung, sprung)
    inertia[1, 1] += vehicle.sprung_yaw_inertia
    inertia[2, 2] += plant.inertia_about_cg
    momentum = plant.sprung_mass * sprung
    forces = np.zeros((len(_SPEEDS), _WIDTH))
    forces[2] = plant.roll_arm * GRAVITY * unit[_ROLL] + unit[_DISTURBANCE]
    for i, axle in enumerate(axles(vehicle)):
        tilt, tilt_rate = unit[_TILT + i], unit[_TILT_RATE + i]
        centre = np.array([1.0, axle.ahead, vehicle.roll_axis_height - axle.roll_centre, 0.0, 0.0])
        turned = np.eye(len(_SPEEDS))[3 + i]
        hub = centre - (tyre.radius - axle.roll_centre) * turned
        patch = centre + axle.roll_centre * turned
        polar = axle.unsprung * axle.half_track**2
        inertia += axle.unsprung * np.outer(hub, hub)
        inertia[1, 1] += polar + 2.0 * tyre.wheel_inertia * (axle.half_track / tyre.radius) ** 2
        inertia[3 + i, 3 + i] += polar
        momentum = momentum + axle.unsprung * hub
        on_road = axle.half_track * (
            tyre.vertical_stiffness * tilt + tyre.vertical_damping * tilt_rate
        )
        torque = (
            axle.roll_share * stiffness * (tilt - unit[_ROLL])
            + axle.roll_damping * (tilt_rate - unit[_ROLL_RATE])
            + (share, 1.0 - share)[i] * unit[_MOMENT]
        )
        spin = 2.0 * tyre.wheel_inertia * speed / tyre.radius
        sprung_load = axle.share * vehicle.total_mass * GRAVITY - axle.unsprung * GRAVITY
        weight = sprung_load * axle.roll_centre + axle.unsprung * GRAVITY * tyre.radius
        forces[1] -= spin * tilt_rate + 2.0 * axle.half_track * tyre.rolling_resistance * on_road
        forces[2] += torque
        forces[3 + i] += (
            weight * tilt - torque - 2.0 * axle.half_track * on_road + spin * unit[_YAW]
        )
        force = tyres[i].cornering * unit[_SLIP + i] + tyres[i].transfer * on_road
        forces += np.outer(patch, force)
    forces -= speed * np.outer(momentum, unit[_YAW])
    rates = np.linalg.solve(inertia, forces)

    rows = np.zeros((len(STATES), _WIDTH))
    rows[_SPEEDS] = rates
    rows[_ROLL] = unit[_ROLL_RATE]
    for i, axle in enumerate(axles(vehicle)):
        rows[_TILT + i] = unit[_TILT_RATE + i]
        aside = unit[_VY] + axle.ahead * unit[_YAW]
        aside = aside + (vehicle.roll_axis_height - axle.roll_centre) * unit[_ROLL_RATE]
        aside = aside + axle.roll_centre * unit[_TILT_RATE + i]
        steady = -aside / speed
        steady = steady + unit[_STEER] if i == 0 else steady
        rows[_SLIP + i] = speed / axle.relaxation_length * (steady - unit[_SLIP + i])

    ahead, _, up = vehicle.sensors.imu_position
    turning = speed * unit[_YAW]
    place = (vehicle.sprung_cg_offset + ahead, plant.cg_height_above_roll_axis + up)
    sensed = accelerometer(place, rates[:3], turning, unit[_ROLL])
    of_cg = momentum @ rates / vehicle.total_mass + turning
    outputs = np.stack([unit[_ROLL_RATE], sensed, unit[_ROLL], unit[_YAW], of_cg])
    n = len(STATES)
    return StateSpace(rows[:, :n], rows[:, n:], outputs[:, :n], outputs[:, n:])


def accelerometer(
    place: tuple[float, float], rates: Sequence[Matrix] | Matrix, turning: Matrix, roll: Matrix
) -> Matrix:
    """Return the row of what an accelerometer on the body reads to the left (m/s²).

    Args:
        place: of the sensor ahead of the CG and above the roll axis, m.
        rates: rows of the rates of lateral velocity, yaw rate and roll rate.
        turning: row of the speed times the yaw rate.
        roll: row of the roll angle, through which it reads gravity.
    """
    ahead, up = place
    reading: Matrix = rates[0] + ahead * rates[1] - up * rates[2] + turning + GRAVITY * roll
    return reading
