"""The plant alone, without sensors, bus or controller: for tuning, limits and checks."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import Body, initial_inputs
from canroll.plant_sim.driving.driver import ACCELERATION_TABLE, DriveInputs, uncounted
from canroll.plant_sim.driving.driver import drive as apply_drive
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import borrowed, njit
from canroll.plant_sim.world import recording
from canroll.typing import Vector
from canroll.vehicles import Vehicle


@njit
def advance(  # noqa: PLR0917
    step: Any,  # noqa: ANN401
    state: Vector,
    inputs: Vector,
    parameters: Vector,
    outputs: Vector,
    dt: float,
) -> None:
    """One step of the body with the C function ``step``, callable from Python."""
    step(state, inputs, parameters, outputs, dt)


class _OpenRun(NamedTuple):
    state: Vector
    inputs: Vector
    parameters: Vector
    outputs: Vector
    record: NDArray[np.float64]
    steer: Vector


@njit
def _drive_through(step: Any, drive: DriveInputs, run: _OpenRun, step_ns: int) -> int:  # noqa: ANN401
    """Run until the record is full or the car has rolled over; return the number of steps."""
    inputs, outputs, record = borrowed(run.inputs), borrowed(run.outputs), borrowed(run.record)
    state, parameters, steer = borrowed(run.state), borrowed(run.parameters), borrowed(run.steer)
    driver = uncounted(drive)
    for k in range(len(record)):
        apply_drive(k * step_ns, outputs, inputs, driver)
        step(state, inputs, parameters, outputs, step_ns * 1e-9)
        record[k] = outputs
        steer[k] = inputs[ports.STEER]
        if outputs[ports.ROLLOVER] != 0.0:
            return k + 1
    return len(record)


def start(
    vehicle: Vehicle, body: Body, maneuver: Maneuver
) -> tuple[Vector, Vector, Vector, Vector]:
    """State, inputs, parameters and outputs of ``body`` before the first step of ``maneuver``.

    Raises:
        CanrollError: the manoeuvre prescribes the lateral acceleration, but the body computes it
            from its tyres; or it prescribes a speed over time, but the body keeps its own; or it
            has wind, friction over distance or braking, of which the body has none.
    """
    if maneuver.drive.kind == ACCELERATION_TABLE and body.name != "roll1":
        raise CanrollError(
            f"a lateral acceleration is an input of the plant roll1 only: {body.name} computes it, "
            "give it a steering-wheel angle"
        )
    if len(maneuver.drive.speed) > 1 and body.constant_speed:
        raise CanrollError(
            f"a speed over time cannot be driven on {body.name}, which keeps its entry speed: "
            "choose --plant nonlinear, or leave it out (from_file: --set speed_column=none)"
        )
    drive = maneuver.drive
    for needs, has, what in (
        (len(drive.friction_left) > 1, body.friction, "friction over distance has no effect"),
        (len(drive.wind) > 1, body.wind, "wind has no effect"),
        (len(drive.pedal) > 1, not body.constant_speed, "pedals have no effect"),
    ):
        if needs and not has:
            raise CanrollError(f"{maneuver.title}: {what} on {body.name}: --plant nonlinear")
    state, parameters = body.build(vehicle, maneuver.speed)
    inputs, outputs = initial_inputs(), np.zeros(ports.N_OUTPUTS)
    advance(body.step, state, inputs, parameters, outputs, 0.0)
    if body.outside is not None:
        body.outside.check(parameters)
    return state, inputs, parameters, outputs


def run_passive(
    vehicle: Vehicle, body: Body, maneuver: Maneuver
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Drive ``maneuver`` with all actuators off.

    Returns:
        outputs: one row per millisecond, columns of :mod:`canroll.plant_sim.bodies.ports`; ends
            early on a rollover.
        steer: the road-wheel angle of each row (rad).
    """
    state, inputs, parameters, outputs = start(vehicle, body, maneuver)
    steps = maneuver.duration_ns // STEP_NS
    record = np.empty((steps, ports.N_OUTPUTS))
    run = _OpenRun(state, inputs, parameters, outputs, record, np.empty(steps))
    count = _drive_through(body.step, maneuver.drive, run, STEP_NS)
    return run.record[:count], run.steer[:count]


def load_transfer(outputs: NDArray[np.float64], axle: int) -> NDArray[np.float64]:
    """Normalised load transfer (F_zR − F_zL)/(F_zR + F_zL) of axle 0 (front) or 1 (rear).

    ``outputs``: rows as returned by :func:`run_passive`. 0 if the whole axle is off the road.
    """
    left = outputs[:, ports.WHEEL_LOAD + 2 * axle]
    right = outputs[:, ports.WHEEL_LOAD + 2 * axle + 1]
    total = left + right
    return np.divide(right - left, total, out=np.zeros_like(total), where=total > 0)


def signals(
    outputs: NDArray[np.float64], steer: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """The rows of :func:`run_passive` by signal name, as in a world's recording."""
    named = {
        name: outputs[:, column]
        for name, column in recording.SIGNALS.items()
        if column < ports.N_OUTPUTS
    }
    time = (np.arange(1, len(outputs) + 1) * (STEP_NS * 1e-9)).astype(np.float64)
    return {"time": time, **named, "steer": steer}


PULSE = 100.0
"""Moment (N·m) of the pulse: small enough for no tyre or stop to leave its linear range."""


def moment_response(
    vehicle: Vehicle, body: Body, speed: float, *, front_share: float, held: float, count: int
) -> Vector:
    """Roll angle (rad) after 1 N·m on the body over the first ``held`` seconds, straight ahead.

    The dampers have the mean of their bump and rebound rates: rolling involves both, while a
    difference would couple the response with heave.

    Args:
        vehicle: vehicle to drive.
        body: its model.
        speed: m/s; without traction and steering.
        front_share: front axle's share of the moment, whose reaction acts on the wheels.
        held: duration of the pulse and interval of the values (s).
        count: number of values, the first at ``held``.
    """
    even = replace(vehicle.suspension, rebound_bump_ratio=1.0)
    state, parameters = body.build(replace(vehicle, suspension=even), speed)
    inputs, outputs = initial_inputs(), np.zeros(ports.N_OUTPUTS)
    steps, dt = round(held * 1e9 / STEP_NS), STEP_NS * 1e-9
    response = np.empty(count)
    inputs[ports.BAR_MOMENT_FRONT] = front_share * PULSE
    inputs[ports.BAR_MOMENT_REAR] = (1.0 - front_share) * PULSE
    for k in range(count):
        for _ in range(steps):
            advance(body.step, state, inputs, parameters, outputs, dt)
        response[k] = outputs[ports.ROLL] / PULSE
        inputs[ports.BAR_MOMENT_FRONT : ports.BAR_MOMENT_REAR + 1] = 0.0
    return response
