"""Refusal of a vehicle too stiff for the fixed step, before anything is driven with it.

A step of the simulation maps small deviations of the state to those a step later. An eigenvalue
of modulus μ of that map makes a deviation grow by the factor μ per step. No motion of a vehicle,
however unstable, grows as fast as :data:`GROWTH_MAX`; a step too long for the fastest mode does.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.typing import Vector
from plant_sim.bodies import ports
from plant_sim.bodies.ports import Body
from plant_sim.driving.drive import STEP_NS
from plant_sim.kernels.jit import njit

STEP = STEP_NS * 1e-9
GROWTH_MAX = 1.05
"""Largest growth per step: e-fold in 20 ms."""
DIFFERENCE = 1e-6


def check_step(body: Body, state: Vector, inputs: Vector, parameters: Vector) -> None:
    """Check that the step is short enough for ``body`` near ``state``.

    Raises:
        CanrollError: it is not.
    """
    growth = growth_per_step(body, state, inputs, parameters)
    if not growth <= GROWTH_MAX:
        raise CanrollError(
            f"body {body.name} is unstable at the fixed step of {1e3 * STEP:g} ms: a deviation "
            f"grows {growth:.3g}-fold per step (at most {GROWTH_MAX:g}): check stiffness, damping "
            "and mass in the vehicle's file"
        )


def growth_per_step(body: Body, state: Vector, inputs: Vector, parameters: Vector) -> float:
    """Return the spectral radius of the map of one step; infinite if it is not finite."""
    slopes = np.empty((state.size, state.size))
    _differences(body.step, state, inputs, parameters, slopes)
    if not np.isfinite(slopes).all():
        return float("inf")
    return float(np.abs(np.linalg.eigvals(slopes)).max(initial=0.0))


@njit
def _differences(
    step: Any,  # noqa: ANN401
    state: Vector,
    inputs: Vector,
    parameters: Vector,
    slopes: NDArray[np.float64],
) -> None:
    """Fill in the central differences of the state after a step by the state before it."""
    outputs = np.zeros(ports.N_OUTPUTS)
    for i in range(state.size):
        width = DIFFERENCE * max(abs(state[i]), 1.0)
        above, below = state.copy(), state.copy()
        above[i] += width
        below[i] -= width
        step(above, inputs, parameters, outputs, STEP)
        step(below, inputs, parameters, outputs, STEP)
        slopes[:, i] = (above - below) / (2 * width)
