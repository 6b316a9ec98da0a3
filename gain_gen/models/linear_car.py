"""The ten-state linear car of a vehicle's data sheet: the design model of the full vehicle.

Lateral slip, yaw, roll, the roll of both axles on their tyres, and the slip angles that build up
over the relaxation length, at constant speed, about straight running or a steady curve:

    [m, −m_s h; −m_s h, I] [v_y' + v r; φ''] = [ΣF; ΣT + m_s g h φ],     I_z r' = l_f F_f − l_r F_r
    T_i = k_i (ψ_i − φ) + c_i (ψ_i' − φ') + s_i M
    m_i t_i² ψ_i'' = −T_i − 2 t_i² (k_t ψ_i + c_t ψ_i') + h_i (F_i − m_i ΣF/m + W_i ψ_i)
                     + m_i R (ΣF/m + g ψ_i)
    σ/v α_i' = δ_i − (v_y + x_i r)/v − α_i,     F_i = C_i α_i + G_i · load moved to the right

for axle i with track t_i, roll-centre height h_i, unsprung mass m_i, sprung load W_i and its share
s_i of the moment M. Signs as everywhere: roll > 0 lifts the left side, steering > 0 is left. Active
suspension and active bars are the same here: one moment on the body, its reaction on the wheels.
With ``kinematics.scrub`` s the slip angles and the moment on the body have two more terms,

    σ/v α_i' = … − s ((h_a − h_i) φ' + h_i ψ_i')/v,     I φ'' = … + Σ s (h_a − h_i) (F_i − m_i ΣF/m)

h_a being the height of the roll axis under the sprung CG.
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
    geometry, mass, plant, tyre = vehicle.geometry, vehicle.mass, vehicle.plant, vehicle.tyre
    share = geometry.static_front_share if front_share is None else front_share
    stiffness = suspension_roll_stiffness(vehicle)
    damped_front = vehicle.suspension.roll_damping_front_share
    total, arm = vehicle.total_mass, plant.roll_arm
    unit = np.eye(_WIDTH)
    tyres = steady_curve(vehicle, lateral_acceleration, friction)
    shares = (share, 1.0 - share)
    springs = [part * stiffness for part in axle_roll_shares(vehicle)]
    dampers = [damped_front * plant.roll_damping, (1.0 - damped_front) * plant.roll_damping]
    tracks = (geometry.half_track_front, geometry.half_track_rear)
    distances = (geometry.cg_to_front_axle, -geometry.cg_to_rear_axle)
    unsprung = (mass.unsprung_front, mass.unsprung_rear)
    centres = (geometry.roll_centre_height_front, geometry.roll_centre_height_rear)
    static = (
        geometry.static_front_share * total * GRAVITY,
        total * GRAVITY * (1.0 - geometry.static_front_share),
    )

    forces, torques, road = [], [], []
    for i in range(2):
        tilt, tilt_rate = unit[_TILT + i], unit[_TILT_RATE + i]
        on_road = tracks[i] * (tyre.vertical_stiffness * tilt + tyre.vertical_damping * tilt_rate)
        road.append(2.0 * tracks[i] * on_road)
        forces.append(tyres[i].cornering * unit[_SLIP + i] + tyres[i].transfer * on_road)
        torques.append(
            springs[i] * (tilt - unit[_ROLL])
            + dampers[i] * (tilt_rate - unit[_ROLL_RATE])
            + shares[i] * unit[_MOMENT]
        )
    lateral = forces[0] + forces[1]
    body = torques[0] + torques[1] + arm * GRAVITY * unit[_ROLL] + unit[_DISTURBANCE]
    for i, (by_roll, _) in enumerate(vehicle.scrub_arms):
        body = body + by_roll * (forces[i] - unsprung[i] * lateral / total)
    determinant = total * plant.roll_inertia - arm**2
    roll_acceleration = (total * body + arm * lateral) / determinant

    rows = np.zeros((len(STATES), _WIDTH))
    rows[_VY] = (plant.roll_inertia * lateral + arm * body) / determinant - speed * unit[_YAW]
    rows[_YAW] = (distances[0] * forces[0] + distances[1] * forces[1]) / mass.yaw_inertia
    rows[_ROLL], rows[_ROLL_RATE] = unit[_ROLL_RATE], roll_acceleration
    for i in range(2):
        tilt = unit[_TILT + i]
        sprung_load = static[i] - unsprung[i] * GRAVITY
        at_centre = forces[i] - unsprung[i] * lateral / total + sprung_load * tilt
        at_hub = unsprung[i] * (lateral / total + GRAVITY * tilt)
        moment = centres[i] * at_centre + tyre.radius * at_hub - torques[i] - road[i]
        rows[_TILT + i] = unit[_TILT_RATE + i]
        rows[_TILT_RATE + i] = moment / (unsprung[i] * tracks[i] ** 2)
        by_roll, by_tilt = vehicle.scrub_arms[i]
        aside = unit[_VY] + distances[i] * unit[_YAW]
        aside = aside + by_roll * unit[_ROLL_RATE] + by_tilt * unit[_TILT_RATE + i]
        steady = -aside / speed
        steady = steady + unit[_STEER] if i == 0 else steady
        rows[_SLIP + i] = speed / tyre.relaxation_length * (steady - unit[_SLIP + i])

    ahead, _, up = vehicle.sensors.imu_position
    outputs = np.stack(
        [
            unit[_ROLL_RATE],
            lateral / total + GRAVITY * unit[_ROLL] + ahead * rows[_YAW] - up * roll_acceleration,
            unit[_ROLL],
            unit[_YAW],
            lateral / total,
        ]
    )
    n = len(STATES)
    return LinearModel(rows[:, :n], rows[:, n:], outputs[:, :n], outputs[:, n:], speed)
