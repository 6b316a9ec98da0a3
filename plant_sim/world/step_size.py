"""Refusal of a vehicle too stiff for the fixed step, before anything is driven with it.

A step of the simulation maps small deviations of the state to those a step later. An eigenvalue
of modulus μ of that map makes a deviation grow by the factor μ per step. No motion of a vehicle,
however unstable, grows as fast as :data:`GROWTH_MAX`; a step too long for the fastest mode does.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import njit
from canroll.typing import Vector

STEP = STEP_NS * 1e-9
GROWTH_MAX = 1.05
"""Largest growth per step: e-fold in 20 ms."""
DIFFERENCE = 1e-6
KEYS = (
    *("plant.roll_inertia", "plant.roll_damping", "plant.roll_stiffness", "plant.sprung_mass"),
    *("mass.unsprung_front", "mass.unsprung_rear", "mass.yaw_inertia"),
    *("suspension.spring_rate_front", "suspension.spring_rate_rear", "suspension.bump_stop_rate"),
    *("tyre.cornering_stiffness_front", "tyre.cornering_stiffness_rear"),
    *("tyre.longitudinal_stiffness", "tyre.wheel_inertia"),
    *("tyre.vertical_stiffness", "tyre.vertical_damping", "tyre.relaxation_length"),
)
"""Numbers of the vehicle file that can make a mode too fast for the step."""


def check_step(
    body: Body,
    state: Vector,
    inputs: Vector,
    parameters: Vector,
    rebuild: Callable[[str, float], Vector] | None = None,
) -> None:
    """Check that the step is short enough for ``body`` near ``state``.

    Args:
        body: the body.
        state: where it is linearised.
        inputs: of the body.
        parameters: of the body.
        rebuild: returns the parameters of the vehicle with the number of a key multiplied by a
            factor, to find the keys that make the fastest mode.

    Raises:
        CanrollError: it is not.
    """
    growth = growth_per_step(body, state, inputs, parameters)
    if not growth <= GROWTH_MAX:
        raise CanrollError(
            f"body {body.name} is unstable at the fixed step of {1e3 * STEP:g} ms: a deviation "
            f"grows {growth:.3g}-fold per step (at most {GROWTH_MAX:g}): check "
            f"{_causes(body, state, inputs, rebuild)} in the vehicle's file"
        )


def _causes(
    body: Body,
    state: Vector,
    inputs: Vector,
    rebuild: Callable[[str, float], Vector] | None,
) -> str:
    """Name the keys on which the fastest mode depends most, and the change that slows it."""
    if rebuild is None:
        return "stiffness, damping and mass"
    growths = {}
    for key in KEYS:
        for factor, word in ((0.9, "lower"), (1 / 0.9, "raise")):
            try:
                parameters = rebuild(key, factor)
            except CanrollError:
                continue
            growth = growth_per_step(body, state, inputs, parameters)
            growths[f"{key} ({word} it)"] = growth
    return " and ".join(sorted(growths, key=lambda cause: growths[cause])[:2])


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
