"""A body: what is simulated, advanced by one compiled step."""

from dataclasses import replace

from canroll.typing import Vector
from plant_sim.bodies import roll
from plant_sim.bodies.ports import Body
from plant_sim.kernels.jit import STEP_SIGNATURE, cfunc
from vehicles import Vehicle

ROOF_LOAD = 150.0
"""Mass on the roof, kg."""
ROOF_HEIGHT = 1.6
"""Of the load above the roll axis, m."""


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """Return the state at ``speed`` (m/s) and the parameters of the car with its roof loaded."""
    plant = vehicle.plant
    mass = plant.sprung_mass + ROOF_LOAD
    arm = plant.roll_arm + ROOF_LOAD * ROOF_HEIGHT
    loaded = replace(
        plant,
        sprung_mass=mass,
        cg_height_above_roll_axis=arm / mass,
        roll_inertia=plant.roll_inertia + ROOF_LOAD * ROOF_HEIGHT**2,
    )
    state, parameters = roll.build(replace(vehicle, plant=loaded), speed)
    return state, parameters


@cfunc(STEP_SIGNATURE)
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance by ``dt`` (s): the equations of roll1, in two halves of a step."""
    roll.advance(state, inputs, parameters, 0.5 * dt)
    roll.advance(state, inputs, parameters, 0.5 * dt)
    roll.observe(state, inputs, parameters, outputs)


HEAVY_ROOF = Body("heavy_roof", step, build)
"""1-DOF roll model with 150 kg on the roof that the controller does not know of."""
