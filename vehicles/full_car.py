"""The linear full car with electro-hydraulic anti-roll bars: 26 states (Vu 2020).

The matrices of the paper are not printed; they are derived here from its equations 1 to 12 in
the project's axes (z up, roll > 0 lifts the left side) and wheel order (front left, front right,
rear left, rear right; the paper counts front left, rear left, rear right, front right).

    s_i = z − x_i θ + y_i φ − Z_i,   F_i = −c_i s_i − k_i s_i'          (c stiffness, k damping)
    m_s z'' = ΣF_i                   (I_y + m_s h_p²) θ'' = −Σ x_i F_i + m_s g h_p θ
    (I_x + m_s h²) φ'' − m_s h v (β' + r) = Σ y_i F_i + m_s g h φ − M_f − M_r
    m_i Z_i'' = −F_i − k_t (Z_i − q_i) ± M/(2 t)
    m v (β' + r) − m_s h φ'' = F_yf + F_yr,   I_z r' = a F_yf − b F_yr
    Xv''/ω² + 2ζ/ω Xv' + Xv = Kv u,  V/(4E) ΔP' = Kq Xv − Kc ΔP − (D − l2) ψ' − l1 ΔP
    J ψ'' = D ΔP − d ψ' − T,  T = k_b (N φ_susp + ψ),  M = N T

Sums run over the corner forces F_i with the passive bars and the actuators added to them.

The paper's roll axis lies on the road, and its wheels are points there. A car with roll centres h_i
under a roll axis of height h_a has axles whose CG, at wheel height R, moves sideways with
v_y + x_i r + (h_a − h_i) φ' − (R − h_i) ψ_i', and whose contact patches move with
v_y + x_i r + (h_a − h_i) φ' + h_i ψ_i', ψ_i being the axle's tilt (Z_l − Z_r)/(2 t). Masses and
lateral forces enter all equations by these motions (Lagrange); an axle carries its sprung load at
its roll centre, and its wheels, of angular momentum 2 I_w v/R, resist its turning.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from canroll.vehicles.axles import axles
from canroll.vehicles.equipment import ElectroHydraulicBars
from canroll.vehicles.model import GRAVITY, Vehicle

STATES = (
    *("heave", "pitch", "roll", "hop_fl", "hop_fr", "hop_rl", "hop_rr"),
    *("heave_rate", "pitch_rate", "roll_rate"),
    *("hop_rate_fl", "hop_rate_fr", "hop_rate_rl", "hop_rate_rr"),
    *("sideslip", "yaw_rate"),
    *("spool_front", "spool_rate_front", "pressure_front", "angle_front", "angle_rate_front"),
    *("spool_rear", "spool_rate_rear", "pressure_rear", "angle_rear", "angle_rate_rear"),
)
"""Names of the 26 states in order."""

INPUTS = (
    "steer",
    *("road_fl", "road_fr", "road_rl", "road_rr"),
    *("current_front", "current_rear"),
    *("force_fl", "force_fr", "force_rl", "force_rr"),
    *("moment_front", "moment_rear"),
    *("bank", "normal"),
)
"""Names of the inputs in order: rad, m, A, N on the body, N·m on the body, rad, m/s².

``normal`` is what presses the car on the road beyond g: the road's acceleration along its normal.
"""

_Z, _ZR, _BETA, _YAW, _OIL = 0, 7, 14, 15, 16

Matrix = NDArray[np.float64]
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class FullCar:
    """Parameters of the linear full car; pairs are (front, rear).

    ``spring``, ``damping`` and ``unsprung`` per corner, ``cornering`` per axle, ``bar`` the passive
    bar's roll stiffness (N·m/rad), ``distance`` of the axles from the CG and ``body_distance`` from
    the sprung CG, both positive forward. ``roll_inertia`` about the sprung CG; ``pitch_coupling``
    is Σ m x² of the lengthwise motion x that a unit of pitch brings about (kg·m²). Without
    ``valves`` the bars have no hydraulics.
    """

    mass: float
    sprung_mass: float
    roll_inertia: float
    pitch_inertia: float
    yaw_inertia: float
    roll_height: float
    pitch_height: float
    pitch_coupling: float
    distance: Pair
    body_distance: Pair
    half_track: Pair
    unsprung: Pair
    spring: Pair
    damping: Pair
    bar: Pair
    cornering: Pair
    tyre_stiffness: float
    tyre_damping: float
    roll_centre_height: Pair
    roll_axis_height: float
    wheel_radius: float
    wheel_inertia: float
    valves: ElectroHydraulicBars | None


_TABLE_1 = ElectroHydraulicBars(
    valve_frequency=200.0,
    valve_damping=0.71,
    valve_gain=0.523,
    flow_gain=11.02,
    pressure_coefficient=4.2e-11,
    bulk_modulus=6.89e6,
    volume=0.0014,
    displacement=1.95e-4,
    leakage=7.85e-15,
    leakage_by_rotation=3.14e-6,
    motor_inertia=5.0,
    motor_damping=1000.0,
    bar_stiffness=150.0,
    lever_ratio=7.6,
    current_limit=10.0,
    supply_pressure=1.0e7,
    angle_limit=1.0471975511965976,
)

AS_PRINTED = FullCar(
    mass=943.0 + 2 * (50.0 + 75.0),
    sprung_mass=943.0,
    roll_inertia=960.0,
    pitch_inertia=720.0,
    yaw_inertia=4520.0,
    roll_height=0.2,
    pitch_height=0.1,
    pitch_coupling=943.0 * 0.1**2,
    distance=(1.1, -1.5),
    body_distance=(1.1, -1.5),
    half_track=(0.76, 0.76),
    unsprung=(50.0, 75.0),
    spring=(15500.0, 17000.0),
    damping=(2290.0, 1420.0),
    bar=(0.0, 0.0),
    cornering=(36000.0, 36000.0),
    tyre_stiffness=25000.0,
    tyre_damping=0.0,
    roll_centre_height=(0.0, 0.0),
    roll_axis_height=0.0,
    wheel_radius=0.0,
    wheel_inertia=0.0,
    valves=_TABLE_1,
)
"""Vu 2020, Tables 1 and 2, number by number; the bar's own stiffness is not printed."""

REPAIRED = replace(
    AS_PRINTED,
    roll_inertia=375.0,
    pitch_inertia=1150.0,
    yaw_inertia=1750.0,
    tyre_stiffness=250000.0,
    valves=replace(
        _TABLE_1,
        valve_damping=0.707,
        valve_gain=0.523 / 60000,
        bulk_modulus=6.89e8,
        motor_inertia=0.05,
        motor_damping=20.0,
    ),
)
"""The same car made possible: inertias of a rigid body, a tyre that deflects by 1 cm, oil."""


def from_vehicle(
    vehicle: Vehicle, *, suspension_stiffness: float, hydraulic: bool = False
) -> FullCar:
    """Linearise ``vehicle`` about straight running.

    ``suspension_stiffness`` is the roll stiffness of springs and bars (N·m/rad). With ``hydraulic``
    the electro-hydraulic bars replace an equally stiff part of the passive bars.
    """
    mass, plant, valves = vehicle.mass, vehicle.plant, vehicle.actuators.valves
    front, rear = both = axles(vehicle)
    replaced = valves.bar_stiffness * valves.lever_ratio**2 if hydraulic else 0.0
    bars = [max(axle.bar(suspension_stiffness) - replaced, 0.0) for axle in both]
    offset = vehicle.sprung_cg_offset
    return FullCar(
        mass=vehicle.total_mass,
        sprung_mass=plant.sprung_mass,
        roll_inertia=plant.inertia_about_cg,
        pitch_inertia=mass.pitch_inertia,
        yaw_inertia=mass.yaw_inertia,
        roll_height=plant.cg_height_above_roll_axis,
        pitch_height=plant.cg_height_above_roll_axis,
        pitch_coupling=_pitch_coupling(vehicle),
        distance=(front.ahead, rear.ahead),
        body_distance=(front.ahead - offset, rear.ahead - offset),
        half_track=(front.half_track, rear.half_track),
        unsprung=(front.unsprung / 2, rear.unsprung / 2),
        spring=(front.spring, rear.spring),
        damping=(front.damping, rear.damping),
        bar=(bars[0], bars[1]),
        cornering=(front.cornering, rear.cornering),
        tyre_stiffness=vehicle.tyre.vertical_stiffness,
        tyre_damping=vehicle.tyre.vertical_damping,
        roll_centre_height=(front.roll_centre, rear.roll_centre),
        roll_axis_height=vehicle.roll_axis_height,
        wheel_radius=vehicle.tyre.radius,
        wheel_inertia=vehicle.tyre.wheel_inertia,
        valves=valves if hydraulic else None,
    )


def _pitch_coupling(vehicle: Vehicle) -> float:
    """Σ m x² of sprung body and axles when the car pitches about the roll axis and rolls freely."""
    tyre, sprung = vehicle.tyre, vehicle.plant.sprung_mass
    on_wheels = vehicle.total_mass - sprung + 4.0 * tyre.wheel_inertia / tyre.radius**2
    between = vehicle.sprung_cg_height - tyre.radius
    return sprung * on_wheels / (sprung + on_wheels) * between**2


def _hydraulics(valves: ElectroHydraulicBars, e: Matrix, a: Matrix, b: Matrix) -> None:
    """Rows of both bars' spool, pressure and motor, without the twist of the bar."""
    for axle in range(2):
        i = _OIL + 5 * axle
        a[i, i + 1] = 1.0
        a[i + 1, i] = -(valves.valve_frequency**2)
        a[i + 1, i + 1] = -2 * valves.valve_damping * valves.valve_frequency
        b[i + 1, 5 + axle] = valves.valve_frequency**2 * valves.valve_gain
        e[i + 2, i + 2] = valves.volume / (4 * valves.bulk_modulus)
        a[i + 2, i] = valves.flow_gain
        a[i + 2, i + 2] = -valves.pressure_coefficient - valves.leakage
        a[i + 2, i + 4] = -(valves.displacement - valves.leakage_by_rotation)
        a[i + 3, i + 4] = 1.0
        e[i + 4, i + 4] = valves.motor_inertia
        a[i + 4, i + 2] = valves.displacement
        a[i + 4, i + 4] = -valves.motor_damping


def _lateral(car: FullCar, speed: float, e: Matrix, a: Matrix, b: Matrix) -> None:
    """Add masses and forces that lie in the road plane, and what tilts with an axle.

    A motion is a row: sideways velocity per generalised velocity, 1 for the lateral velocity v β.
    """
    n = len(STATES)
    roll = _ZR + 2
    sprung = np.zeros(n)
    sprung[[_BETA, _YAW, roll]] = 1.0, car.distance[0] - car.body_distance[0], -car.roll_height
    moved = [(car.sprung_mass, sprung)]
    for axle in range(2):
        hops = _ZR + 3 + 2 * axle
        tilt = np.zeros(n)
        tilt[[hops, hops + 1]] = 0.5 / car.half_track[axle], -0.5 / car.half_track[axle]
        held = car.roll_centre_height[axle]
        centre = np.zeros(n)
        centre[[_BETA, _YAW, roll]] = 1.0, car.distance[axle], car.roll_axis_height - held
        unsprung = 2.0 * car.unsprung[axle]
        moved.append((unsprung, centre - (car.wheel_radius - held) * tilt))
        patch = centre + held * tilt
        slip = -patch / speed
        slip[_BETA] = -1.0
        a += car.cornering[axle] * np.outer(patch, slip)
        if axle == 0:
            b[:, 0] += car.cornering[axle] * patch
        other = car.distance[1 - axle]
        share = abs(other) / (car.distance[0] - car.distance[1])
        carried = (share * car.mass - unsprung) * GRAVITY
        angle = np.zeros(n)
        angle[3 + 2 * axle : 5 + 2 * axle] = tilt[[hops, hops + 1]]
        a += (carried * held + unsprung * GRAVITY * car.wheel_radius) * np.outer(tilt, angle)
        if car.wheel_inertia:
            spin = 2.0 * car.wheel_inertia * speed / car.wheel_radius
            a[:, _YAW] += spin * tilt
            a[_YAW] -= spin * tilt
            e[_YAW, _YAW] += (
                2.0 * car.wheel_inertia * (car.half_track[axle] / car.wheel_radius) ** 2
            )
    masses, motions = np.array([mass for mass, _ in moved]), np.array([row for _, row in moved])
    momentum, inertia = masses @ motions, motions.T @ (masses[:, None] * motions)
    # the reference is the CG, about which the yaw inertia is given whole
    momentum[_YAW] = inertia[_YAW, _BETA] = inertia[_BETA, _YAW] = inertia[_YAW, _YAW] = 0.0
    inertia[:, _BETA] *= speed
    e += inertia
    a[:, _YAW] -= speed * momentum
    b[:, 13] -= GRAVITY * momentum


def state_matrices(car: FullCar, speed: float) -> tuple[Matrix, Matrix]:
    """A (26, 26) and B (26, 15) of x' = A x + B u at a constant ``speed`` (m/s).

    States and inputs in the order of :data:`STATES` and :data:`INPUTS`. Without valves the ten
    states of the hydraulics remain zero.
    """
    n, m = len(STATES), len(INPUTS)
    e, a, b = np.eye(n), np.zeros((n, n)), np.zeros((n, m))
    a[_Z : _Z + 7, _ZR : _ZR + 7] = np.eye(7)
    if car.valves is not None:
        _hydraulics(car.valves, e, a, b)

    heave, pitch, roll = _ZR, _ZR + 1, _ZR + 2
    e[heave, heave] = car.sprung_mass
    e[pitch, pitch] = car.pitch_inertia + car.pitch_coupling
    e[roll, roll] = car.roll_inertia
    e[_BETA, _BETA], e[_YAW, _YAW] = 0.0, car.yaw_inertia
    a[pitch, 1] += car.sprung_mass * GRAVITY * car.pitch_height
    a[roll, 2] += car.sprung_mass * car.roll_height * GRAVITY
    b[heave, 14] -= car.sprung_mass
    for axle in range(2):
        track, x = car.half_track[axle], car.body_distance[axle]
        travel = np.zeros((2, n))
        for side, sign in enumerate((1.0, -1.0)):
            travel[side, [0, 1, 2, 3 + 2 * axle + side]] = 1.0, -x, sign * track, -1.0
        twist = (travel[0] - travel[1]) / (2 * track)
        moment_x, moment_u = -car.bar[axle] * twist, np.zeros(m)
        moment_u[11 + axle] = 1.0
        if car.valves is not None:
            motor = _OIL + 5 * axle + 3
            torque = car.valves.bar_stiffness * car.valves.lever_ratio * twist
            torque[motor] += car.valves.bar_stiffness
            moment_x -= car.valves.lever_ratio * torque
            a[motor + 1] -= torque
        for side, sign in enumerate((1.0, -1.0)):
            wheel = 2 * axle + side
            stroke = np.zeros(n)
            stroke[_ZR : _ZR + 7] = travel[side, :7]
            force_x = -car.spring[axle] * travel[side] - car.damping[axle] * stroke
            force_x += sign * moment_x / (2 * track)
            force_u = sign * moment_u / (2 * track)
            force_u[7 + wheel] = 1.0
            a[heave] += force_x
            b[heave] += force_u
            a[roll] += sign * track * force_x
            b[roll] += sign * track * force_u
            a[pitch] -= x * force_x
            b[pitch] -= x * force_u
            row = _ZR + 3 + wheel
            e[row, row] = car.unsprung[axle]
            a[row] -= force_x
            a[row, 3 + wheel] -= car.tyre_stiffness
            a[row, row] -= car.tyre_damping
            b[row] -= force_u
            b[row, 1 + wheel] += car.tyre_stiffness
            b[row, 14] -= car.unsprung[axle]
    _lateral(car, speed, e, a, b)
    inverse = np.linalg.inv(e).astype(np.float64)
    return inverse @ a, inverse @ b
