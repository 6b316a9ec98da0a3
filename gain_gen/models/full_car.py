"""The 26-state full car as design model: ideal LQR of Vu 2020, reductions, measured outputs."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_are

from canroll.gain_gen.models.linear_car import accelerometer
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import resolvent
from canroll.vehicles import Vehicle
from canroll.vehicles.full_car import (
    INPUTS,
    REPAIRED,
    STATES,
    FullCar,
    from_vehicle,
    state_matrices,
)
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

SPEED = 70.0 / 3.6
"""Speed of the paper's frequency responses, m/s."""
STATE_WEIGHTS = (1e5, 1e5, 1e9, 1e8, 1e8, 1e8, 1e8)
"""Heave, pitch, roll, four wheels (Vu 2020, (16)); all others 1, on pressures in MPa."""
INPUT_WEIGHT = 1e3
"""Weight of a current squared, 1/A²; of the printed 1 no unit is printed."""
PRINTED_CAR = "car_2020"
"""Vehicle that corresponds to the paper's car."""
MILLI = 1e3
"""The ECU commands valves in mA."""

ROLL, ROLL_RATE = STATES.index("roll"), STATES.index("roll_rate")
SIDESLIP, YAW_RATE = STATES.index("sideslip"), STATES.index("yaw_rate")
STEER = INPUTS.index("steer")
CURRENTS = [INPUTS.index("current_front"), INPUTS.index("current_rear")]
ROADS = [INPUTS.index(f"road_{wheel}") for wheel in ("fl", "fr", "rl", "rr")]


def _state_scale() -> Matrix:
    """Size of each state: spools in 0.1 mm, pressures in MPa, so that the pencil is balanced."""
    scale = np.ones(len(STATES))
    for i, name in enumerate(STATES):
        if name.startswith("pressure"):
            scale[i] = 1e6
        elif name.startswith("spool_rate"):
            scale[i] = 1e-2
        elif name.startswith("spool"):
            scale[i] = 1e-4
    return scale


SCALE = _state_scale()


def car_of(vehicle: Vehicle) -> FullCar:
    """Return the full car with hydraulic bars: the paper's corrected car, or the vehicle's."""
    if vehicle.name == PRINTED_CAR:
        return REPAIRED
    return from_vehicle(
        vehicle, suspension_stiffness=suspension_roll_stiffness(vehicle), hydraulic=True
    )


@dataclass(frozen=True, slots=True)
class FullCarModel:
    """x' = A x + B u with states scaled by :data:`SCALE`.

    Attributes:
        a: (26, 26).
        b: (26, 15), inputs as in ``canroll.vehicles.full_car.INPUTS``.
        outputs: rows roll rate, accelerometer, roll, moment of the bars, (4, 26).
        steer: feedthrough from the steering to those, (4,).
    """

    a: Matrix
    b: Matrix
    outputs: Matrix
    steer: Matrix


def full_car_model(
    car: FullCar, speed: float, imu_position: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> FullCarModel:
    """Return the scaled model at ``speed`` with the ECU's sensor readings as outputs.

    ``imu_position`` is that of the sensors from the sprung CG (x, y, z), m.
    """
    a, b = state_matrices(car, speed)
    n, unit = len(STATES), np.eye(len(STATES) + 1)
    rates = np.column_stack([a, b[:, STEER]])
    place = (
        car.distance[0] - car.body_distance[0] + imu_position[0],
        car.roll_height + imu_position[2],
    )
    lateral = speed * rates[SIDESLIP], rates[YAW_RATE], rates[ROLL_RATE]
    felt = accelerometer(place, lateral, speed * unit[YAW_RATE], unit[ROLL])
    outputs = np.stack([unit[ROLL_RATE], felt, unit[ROLL], np.append(_bar_moment(car), 0.0)])
    return FullCarModel(
        a * SCALE[None, :] / SCALE[:, None],
        b / SCALE[:, None],
        outputs[:, :n] * SCALE,
        outputs[:, n],
    )


def _bar_moment(car: FullCar) -> Matrix:
    """Return the moment of both hydraulic bars on the body as a row on the unscaled state."""
    row = np.zeros(len(STATES))
    if car.valves is None:
        return row
    for axle, side in enumerate(("front", "rear")):
        left, right = (("fl", "fr"), ("rl", "rr"))[axle]
        twist = np.zeros(len(STATES))
        twist[ROLL] = 1.0
        twist[STATES.index(f"hop_{left}")] = -0.5 / car.half_track[axle]
        twist[STATES.index(f"hop_{right}")] = 0.5 / car.half_track[axle]
        torque = car.valves.bar_stiffness * car.valves.lever_ratio * twist
        torque[STATES.index(f"angle_{side}")] += car.valves.bar_stiffness
        row -= car.valves.lever_ratio * torque
    return row


def weights() -> Matrix:
    """Return the diagonal of Q on the scaled states."""
    q = np.ones(len(STATES))
    q[: len(STATE_WEIGHTS)] = STATE_WEIGHTS
    for i, name in enumerate(STATES):
        if name.startswith("spool"):
            q[i] = SCALE[i] ** 2
    return q


def ideal_gain(
    model: FullCarModel,
    *,
    input_weight: float = INPUT_WEIGHT,
    roads: bool = False,
    state_weights: Matrix | None = None,
) -> tuple[Matrix, Matrix]:
    """Return K of u = −K x on all 26 states, continuous time, and its columns of B.

    Args:
        model: scaled model.
        input_weight: R on each current, 1/A².
        roads: feed back to the four road inputs too, as the paper's B = [B1, B2] does; no actuator
            can, but it explains the printed reduction of the tyre forces.
        state_weights: diagonal of Q on the scaled states; by default :func:`weights`.

    Raises:
        numpy.linalg.LinAlgError: the Riccati equation has no stabilising solution.
    """
    columns = [*(ROADS if roads else []), *CURRENTS]
    b = model.b[:, columns]
    r = np.eye(len(columns)) * input_weight
    q = weights() if state_weights is None else state_weights
    cost = solve_continuous_are(model.a, b, np.diag(q), r)
    gain: Matrix = np.linalg.solve(r, b.T @ cost)
    return gain, b


def reduction_db(
    model: FullCarModel, closed: Matrix, state: int, *, frequency: float = 1.0
) -> float:
    """Return the reduction of the response of ``state`` to steering at ``frequency``, dB."""
    point, column = np.array([1j * frequency]), model.b[:, [STEER]]
    before, after = (abs(resolvent(a, column, point)[0, state, 0]) for a in (model.a, closed))
    return float(20.0 * np.log10(before / after))


def reductions(model: FullCarModel, gain: Matrix, b: Matrix) -> dict[str, float]:
    """Return the reductions at 1 rad/s of Vu 2020, Table 3, by state, dB."""
    closed = model.a - b @ gain
    names = ("roll", "roll_rate", "hop_fl", "hop_rl")
    return {f"{name}_db": reduction_db(model, closed, STATES.index(name)) for name in names}
