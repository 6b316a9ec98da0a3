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

from dataclasses import dataclass

import numpy as np

from gain_gen.models.roll import Matrix
from gain_gen.models.trim import steady_curve
from vehicles import GRAVITY, Vehicle
from vehicles.roll_stiffness import axle_roll_shares, suspension_roll_stiffness

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


@dataclass(frozen=True, slots=True)
class LinearModel:
    """x' = A x + B u, y = C x + D u with :data:`INPUTS` and :data:`OUTPUTS` as u and y.

    Attributes:
        a: (n, n); the ten :data:`STATES` unless it is reduced.
        b: (n, 3).
        c: (5, n).
        d: (5, 3).
        speed: m/s.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    speed: float

    def response(self, frequencies: Matrix) -> Matrix:
        """Return C (jω − A)⁻¹ B + D at ``frequencies`` in rad/s, (frequencies, 5, 3), complex."""
        shifted = 1j * frequencies[:, None, None] * np.eye(len(self.a)) - self.a
        inputs = np.broadcast_to(self.b.astype(complex), (len(frequencies), *self.b.shape))
        return np.asarray(self.c @ np.linalg.solve(shifted, inputs) + self.d)


@dataclass(frozen=True, slots=True)
class _Axle:
    """An axle: place, mass, sprung load, and its share of the moment; lengths in m, SI units."""

    ahead: float
    track: float
    centre: float
    mass: float
    sprung_load: float
    stiffness: float
    damping: float
    share: float


def _axles(vehicle: Vehicle, share: float) -> tuple[_Axle, _Axle]:
    """Return front and rear axle; ``share`` is the front one's of the moment."""
    geometry, mass = vehicle.geometry, vehicle.mass
    stiffness, damping = suspension_roll_stiffness(vehicle), vehicle.plant.roll_damping
    front_stiffness, rear_stiffness = axle_roll_shares(vehicle)
    front_damping = vehicle.suspension.roll_damping_front_share
    weight, on_front = vehicle.total_mass * GRAVITY, geometry.static_front_share
    front = _Axle(
        ahead=geometry.cg_to_front_axle,
        track=geometry.half_track_front,
        centre=geometry.roll_centre_height_front,
        mass=mass.unsprung_front,
        sprung_load=on_front * weight - mass.unsprung_front * GRAVITY,
        stiffness=front_stiffness * stiffness,
        damping=front_damping * damping,
        share=share,
    )
    rear = _Axle(
        ahead=-geometry.cg_to_rear_axle,
        track=geometry.half_track_rear,
        centre=geometry.roll_centre_height_rear,
        mass=mass.unsprung_rear,
        sprung_load=(1.0 - on_front) * weight - mass.unsprung_rear * GRAVITY,
        stiffness=rear_stiffness * stiffness,
        damping=(1.0 - front_damping) * damping,
        share=1.0 - share,
    )
    return front, rear


def linear_car(
    vehicle: Vehicle,
    speed: float,
    *,
    lateral_acceleration: float = 0.0,
    friction: float = 1.0,
    front_share: float | None = None,
) -> LinearModel:
    """Return the car of the vehicle file, linear about straight running or a steady curve.

    Args:
        vehicle: its ``plant`` part and all others; see :func:`vehicles.unladen.unladen`.
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
    unit = np.eye(_WIDTH)
    axles = _axles(vehicle, share)
    tyres = steady_curve(vehicle, lateral_acceleration, friction)

    sprung = np.array([1.0, vehicle.sprung_cg_offset, -plant.cg_height_above_roll_axis, 0.0, 0.0])
    inertia = plant.sprung_mass * np.outer(sprung, sprung)
    inertia[1, 1] += vehicle.sprung_yaw_inertia
    inertia[2, 2] += plant.inertia_about_cg
    momentum = plant.sprung_mass * sprung
    forces = np.zeros((len(_SPEEDS), _WIDTH))
    forces[2] = plant.roll_arm * GRAVITY * unit[_ROLL] + unit[_DISTURBANCE]
    for i, axle in enumerate(axles):
        tilt, tilt_rate = unit[_TILT + i], unit[_TILT_RATE + i]
        centre = np.array([1.0, axle.ahead, vehicle.roll_axis_height - axle.centre, 0.0, 0.0])
        turned = np.eye(len(_SPEEDS))[3 + i]
        hub = centre - (tyre.radius - axle.centre) * turned
        patch = centre + axle.centre * turned
        polar = axle.mass * axle.track**2
        inertia += axle.mass * np.outer(hub, hub)
        inertia[1, 1] += polar + 2.0 * tyre.wheel_inertia * (axle.track / tyre.radius) ** 2
        inertia[3 + i, 3 + i] += polar
        momentum = momentum + axle.mass * hub
        on_road = axle.track * (tyre.vertical_stiffness * tilt + tyre.vertical_damping * tilt_rate)
        torque = (
            axle.stiffness * (tilt - unit[_ROLL])
            + axle.damping * (tilt_rate - unit[_ROLL_RATE])
            + axle.share * unit[_MOMENT]
        )
        spin = 2.0 * tyre.wheel_inertia * speed / tyre.radius
        weight = axle.sprung_load * axle.centre + axle.mass * GRAVITY * tyre.radius
        forces[1] -= spin * tilt_rate + 2.0 * axle.track * tyre.rolling_resistance * on_road
        forces[2] += torque
        forces[3 + i] += weight * tilt - torque - 2.0 * axle.track * on_road + spin * unit[_YAW]
        force = tyres[i].cornering * unit[_SLIP + i] + tyres[i].transfer * on_road
        forces += np.outer(patch, force)
    forces -= speed * np.outer(momentum, unit[_YAW])
    rates = np.linalg.solve(inertia, forces)

    rows = np.zeros((len(STATES), _WIDTH))
    rows[_SPEEDS] = rates
    rows[_ROLL] = unit[_ROLL_RATE]
    for i, axle in enumerate(axles):
        rows[_TILT + i] = unit[_TILT_RATE + i]
        aside = unit[_VY] + axle.ahead * unit[_YAW]
        aside = aside + (vehicle.roll_axis_height - axle.centre) * unit[_ROLL_RATE]
        aside = aside + axle.centre * unit[_TILT_RATE + i]
        steady = -aside / speed
        steady = steady + unit[_STEER] if i == 0 else steady
        rows[_SLIP + i] = speed / tyre.relaxation_length * (steady - unit[_SLIP + i])

    ahead, _, up = vehicle.sensors.imu_position
    turning = speed * unit[_YAW]
    sensed = sprung @ rates + turning + GRAVITY * unit[_ROLL] + ahead * rates[1] - up * rates[2]
    of_cg = momentum @ rates / vehicle.total_mass + turning
    outputs = np.stack([unit[_ROLL_RATE], sensed, unit[_ROLL], unit[_YAW], of_cg])
    n = len(STATES)
    return LinearModel(rows[:, :n], rows[:, n:], outputs[:, :n], outputs[:, n:], speed)
