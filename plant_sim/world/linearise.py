"""Any plant body as a linear system about a steady motion, straight or in a curve.

A body is known only by its step, so the matrices are derived from that: central differences of one
step's map give the sampled system, and its matrix logarithm the continuous system with the same
steps under held inputs. Where a slope differs by side, as a damper's in bump and rebound, the mean
of both is used. States that affect only position and heading are left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, logm, matrix_balance

from canroll.errors import CanrollError
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import Body, initial_inputs
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.nodes.imu_motion import FORCE, N_MOTION, specific_motion
from canroll.plant_sim.world.open_loop import advance
from canroll.typing import Vector
from canroll.vehicles import Vehicle

Matrix = NDArray[np.float64]

STEP = STEP_NS * 1e-9
"""Step (s) of the map that is differentiated: that of the simulation."""

DIFFERENCE = 1e-5
"""Half the width of a central difference, relative to what is varied or 1 SI unit, the larger.

Small against the widths over which tyres and stops bend (some 0.01), large against rounding: the
matrices are right to about 1e-7.
"""

FORCE_DIFFERENCE = 1.0
"""The same of forces and moments that are inputs (N, N·m)."""

IMU_LATERAL_ACCELERATION = ports.N_OUTPUTS
"""Row after a body's own outputs: what the inertial unit feels to the left (m/s²)."""

_FORCES = slice(ports.DRIVE_FORCE, ports.BAR_MOMENT_REAR + 1)
_LOADS = slice(ports.WHEEL_LOAD, ports.WHEEL_LOAD + 4)
_PLACE = (ports.X, ports.Y, ports.YAW)
_APPROACH = 0.5  # m/s²: a steady curve is reached from straight ahead in steps
_ITERATIONS = 25
_STEADY = 1e-7  # largest rate of a state, relative to it or 1 SI unit, that counts as none
_FORGOTTEN = 1e-6  # least factor by which a state may decay in one step


@dataclass(frozen=True, slots=True)
class Trim:
    """A steady motion of a body, in which only position and heading change.

    Attributes:
        vehicle: vehicle of the body.
        body: the body.
        state: its state there.
        inputs: its inputs there, steering and traction among them.
        parameters: its parameters.
        relevant: indices of the states that affect an output other than position and heading.
        outputs: the body's outputs there, then the inertial unit's lateral acceleration.
    """

    vehicle: Vehicle
    body: Body
    state: Vector
    inputs: Vector
    parameters: Vector
    relevant: NDArray[np.intp]
    outputs: Vector


@dataclass(frozen=True, slots=True)
class LinearPlant:
    """x' = A x + B u, y = C x + D u for small deviations from a trim.

    ``b`` (n, N_INPUTS) and ``d`` have a column for each input slot of
    :mod:`canroll.plant_sim.bodies.ports`; ``c`` (N_OUTPUTS + 1, n) and ``d`` a row for each output
    slot, and a last one, :data:`IMU_LATERAL_ACCELERATION`.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix

    def response(
        self, frequency: Vector, excitation: Vector, outputs: Sequence[int]
    ) -> NDArray[np.complex128]:
        """Return the complex response (outputs, frequencies) at ``frequency`` > 0 (Hz).

        ``excitation`` (N_INPUTS,) is the amplitude of each input per unit; ``outputs`` are row
        indices.
        """
        b, rows = self.b @ excitation, list(outputs)
        gains = np.empty((len(rows), frequency.size), dtype=np.complex128)
        for i, s in enumerate(2j * np.pi * frequency):
            gains[:, i] = self.c[rows] @ np.linalg.solve(s * np.eye(len(b)) - self.a, b)
        return gains + (self.d[rows] @ excitation)[:, None]


def find_trim(
    vehicle: Vehicle,
    body: Body,
    *,
    speed: float,
    lateral_acceleration: float = 0.0,
    friction: float = 1.0,
) -> Trim:
    """Find the steady curve, to the left for a lateral acceleration > 0, and its inputs.

    Newton's method on the rates of the states, from straight ahead to the curve in steps, solves
    for the states, the steering and the traction.

    Args:
        vehicle: vehicle to drive.
        body: its model.
        speed: m/s.
        lateral_acceleration: of the CG (m/s²); 0 is straight ahead.
        friction: of the road.

    Raises:
        CanrollError: the vehicle has no such steady curve with all wheels on the road.
    """
    state, parameters = body.build(vehicle, speed)
    inputs = initial_inputs()
    inputs[ports.FRICTION] = friction
    relevant = _relevant(vehicle, body, state, inputs, parameters)
    unknown = np.append(state[relevant], inputs[[ports.STEER, ports.DRIVE_FORCE]])

    def apply(values: Vector) -> tuple[Vector, Vector]:
        at, given = state.copy(), inputs.copy()
        at[relevant] = values[:-2]
        given[[ports.STEER, ports.DRIVE_FORCE]] = values[-2:]
        return at, given

    count = max(int(np.ceil(abs(lateral_acceleration) / _APPROACH)), 1)
    for target in np.linspace(0.0, lateral_acceleration, count + 1):

        def residual(values: Vector, lateral: float = float(target)) -> Vector:
            at, given = apply(values)
            outputs = _measured(vehicle, body, at, given, parameters)
            rates = (_stepped(body, at, given, parameters) - at)[relevant] / STEP
            return np.append(rates, (outputs[ports.AY] - lateral, outputs[ports.VX] - speed))

        root = _root(residual, unknown)
        if root is None:
            break
        unknown = root
    at, given = apply(unknown)
    outputs = _measured(vehicle, body, at, given, parameters)
    straight = _measured(vehicle, body, state, inputs, parameters)
    lifted = (straight[_LOADS] > 0.0) & (outputs[_LOADS] == 0.0)
    if root is None or lifted.any():
        raise CanrollError(
            f"{vehicle.name} ({body.name}) at {3.6 * speed:g} km/h and friction {friction:g}: no "
            f"steady curve of {abs(lateral_acceleration):g} m/s² on four wheels, lower it"
        )
    return Trim(vehicle, body, at, given, parameters, relevant, outputs)


def linearise(trim: Trim) -> LinearPlant:
    """Return the body's linear system about ``trim``.

    Raises:
        CanrollError: a state is overwritten in each step instead of integrated, or the body's
        outputs
            cannot be differentiated there.
    """
    body, parameters, relevant = trim.body, trim.parameters, trim.relevant
    states, slots = relevant.size, ports.N_INPUTS
    base = np.concatenate([trim.state[relevant], trim.inputs])
    widths = DIFFERENCE * np.maximum(np.abs(base), 1.0)
    widths[states:][_FORCES] = FORCE_DIFFERENCE

    def apply(values: Vector) -> tuple[Vector, Vector]:
        at = trim.state.copy()
        at[relevant] = values[:states]
        return at, values[states:].copy()

    varied = [i for i in range(base.size) if i != states + ports.LATERAL_ACCELERATION]
    after = _slopes(lambda v: _stepped(body, *apply(v), parameters)[relevant], base, widths, varied)
    outputs = _slopes(
        lambda v: _measured(trim.vehicle, body, *apply(v), parameters), base, widths, varied
    )
    if np.abs(np.linalg.eigvals(after[:, :states])).min() < _FORGOTTEN:
        raise CanrollError(
            f"the body {body.name} overwrites a state in each step: only integrated states can be "
            "linearised"
        )
    held = np.eye(states + slots)
    held[:states] = after
    balanced, scale = matrix_balance(held, permute=False)
    rates = scale @ np.real(logm(balanced)) @ np.linalg.inv(scale) / STEP
    if not np.allclose(expm(STEP * rates), held, rtol=1e-6, atol=1e-6 * np.abs(held).max()):
        raise CanrollError(f"the body {body.name} cannot be linearised at this trim")
    return LinearPlant(
        a=rates[:states, :states],
        b=rates[:states, states:],
        c=outputs[:, :states],
        d=outputs[:, states:],
    )


def _stepped(body: Body, state: Vector, inputs: Vector, parameters: Vector) -> Vector:
    after = state.copy()
    advance(body.step, after, inputs, parameters, np.zeros(ports.N_OUTPUTS), STEP)
    return after


def _measured(
    vehicle: Vehicle, body: Body, state: Vector, inputs: Vector, parameters: Vector
) -> Vector:
    """Return the outputs and the inertial unit's lateral acceleration, from a step of no time."""
    outputs, motion = np.zeros(ports.N_OUTPUTS), np.empty(N_MOTION)
    advance(body.step, state.copy(), inputs, parameters, outputs, 0.0)
    specific_motion(inputs, outputs, np.array(vehicle.sensors.imu_position), motion)
    return np.append(outputs, motion[FORCE + 1])


def _slopes(
    function: Callable[[Vector], Vector], base: Vector, widths: Vector, varied: Sequence[int]
) -> Matrix:
    """Return the derivative of ``function`` by central differences; 0 for what is not varied."""
    slopes = np.zeros((function(base).size, base.size))
    for i in varied:
        above, below = base.copy(), base.copy()
        above[i] += widths[i]
        below[i] -= widths[i]
        slopes[:, i] = (function(above) - function(below)) / (above[i] - below[i])
    return slopes


def _relevant(
    vehicle: Vehicle, body: Body, state: Vector, inputs: Vector, parameters: Vector
) -> NDArray[np.intp]:
    """Return the states that affect an output other than position and heading."""
    widths, all_of_it = np.full(state.size, DIFFERENCE), range(state.size)
    after = _slopes(lambda x: _stepped(body, x, inputs, parameters), state, widths, all_of_it)
    outputs = _slopes(
        lambda x: _measured(vehicle, body, x, inputs, parameters), state, widths, all_of_it
    )
    outputs[list(_PLACE)] = 0.0
    acts = after != 0.0
    reaching = (outputs != 0.0).any(axis=0)
    for _ in all_of_it:
        reaching |= (acts & reaching[:, None]).any(axis=0)
    return np.flatnonzero(reaching)


def _root(function: Callable[[Vector], Vector], start: Vector) -> Vector | None:
    """Return a zero of ``function`` by Newton's method, or None if that does not converge."""
    values = start
    for _ in range(_ITERATIONS):
        rest = function(values)
        if not np.isfinite(rest).all():
            return None
        if (np.abs(rest[:-2]) <= _STEADY * np.maximum(np.abs(values[:-2]), 1.0)).all() and (
            np.abs(rest[-2:]) <= _STEADY
        ).all():
            return values
        widths = DIFFERENCE * np.maximum(np.abs(values), 1.0)
        widths[-1] = FORCE_DIFFERENCE
        slopes = _slopes(function, values, widths, range(values.size))
        if not np.isfinite(slopes).all():
            return None
        values = values - _solve(slopes, rest)
    return None


def _solve(matrix: Matrix, right: Vector) -> Vector:
    """Return the least-norm solution, with rows and columns scaled, as units differ widely."""
    rows = np.abs(matrix).max(axis=1)
    rows[rows == 0.0] = 1.0
    columns = np.abs(matrix / rows[:, None]).max(axis=0)
    columns[columns == 0.0] = 1.0
    scaled = matrix / rows[:, None] / columns
    solution: Vector = np.linalg.lstsq(scaled, right / rows, rcond=1e-12)[0] / columns
    return solution
