"""The plant bodies by name: what steps them and what builds their state and parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from canroll.errors import UnknownNameError
from plant_sim.bodies import linear_car, nonlinear_car, ports, roll
from plant_sim.bodies.integrate import Vector
from vehicles import Vehicle


@dataclass(frozen=True, slots=True)
class Body:
    """One plant body.

    ``step(state, inputs, parameters, outputs, dt)`` is a numba C function: it advances ``state``
    in place and fills ``outputs``. ``build(vehicle, speed)`` gives the state on a straight road
    at ``speed`` (m/s) and the parameter vector.
    """

    name: str
    title: str
    step: Any
    build: Callable[[Vehicle, float], tuple[Vector, Vector]]


BODIES: dict[str, Body] = {
    body.name: body
    for body in (
        Body("roll1", "1-DOF roll model with a linear bicycle", roll.step, roll.build),
        Body("fullcar", "linear full car", linear_car.step, linear_car.build),
        Body(
            "fullcar_hydraulic",
            "linear full car with electro-hydraulic bars",
            linear_car.step,
            linear_car.build_hydraulic,
        ),
        Body("nonlinear", "14-DOF nonlinear car", nonlinear_car.step, nonlinear_car.build),
    )
}


def body(name: str) -> Body:
    """The body of that name; :class:`UnknownNameError` suggests the nearest for another."""
    if name not in BODIES:
        raise UnknownNameError("plant", name, BODIES)
    return BODIES[name]


def initial_inputs() -> Vector:
    """Inputs of a car on a flat, dry road with nothing applied."""
    inputs = np.zeros(ports.N_INPUTS)
    inputs[ports.FRICTION] = 1.0
    inputs[ports.LATERAL_ACCELERATION] = np.nan
    return inputs
