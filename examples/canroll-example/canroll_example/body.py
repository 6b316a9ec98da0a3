"""A body: what is simulated, advanced by one compiled step."""

from dataclasses import replace

from canroll.plant_sim.bodies import roll
from canroll.plant_sim.bodies.ports import Body
from canroll.plant_sim.kernels.jit import STEP_SIGNATURE, cfunc
from canroll.typing import Vector
from canroll.vehicles import Vehicle

ROOF_LOAD = 150.0
"""Part of the load that is stowed on the roof, kg; the car's mass stays."""
ROOF_HEIGHT = 1.6
"""Of that part above the roll axis, m."""


def build(vehicle: Vehicle, speed: float) -> tuple[Vector, Vector]:
    """Return the state at ``speed`` (m/s) and the parameters of the car with its roof loaded."""
    plant = vehicle.plant
    height = plant.cg_height_above_roll_axis
    raised = replace(
        plant,
        cg_height_above_roll_axis=height + ROOF_LOAD * (ROOF_HEIGHT - height) / plant.sprung_mass,
        roll_inertia=plant.roll_inertia + ROOF_LOAD * (ROOF_HEIGHT**2 - height**2),
    )
    return roll.build(replace(vehicle, plant=raised), speed)


@cfunc(STEP_SIGNATURE)
def step(state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float) -> None:
    """Advance by ``dt`` (s): the equations of roll1, in two halves of a step."""
    roll.advance(state, inputs, parameters, 0.5 * dt)
    roll.advance(state, inputs, parameters, 0.5 * dt)
    roll.observe(state, inputs, parameters, outputs)


HEAVY_ROOF = Body("heavy_roof", step, build)
"""1-DOF roll model with 150 kg of its load on the roof, unknown to the controller."""
