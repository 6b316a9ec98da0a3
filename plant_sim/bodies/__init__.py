"""The plant bodies, and their names."""

from canroll.registry import Registry
from plant_sim.bodies.ports import Body, initial_inputs

__all__ = ["BODIES", "Body", "body", "initial_inputs"]

BODIES: Registry[Body] = Registry(
    "plant",
    "canroll.bodies",
    {
        "roll1": "plant_sim.bodies.roll:BODY",
        "fullcar": "plant_sim.bodies.linear_car:BODY",
        "fullcar_hydraulic": "plant_sim.bodies.linear_car:HYDRAULIC_BODY",
        "nonlinear": "plant_sim.bodies.nonlinear_car:BODY",
    },
)


def body(name: str) -> Body:
    """The body of that name; :class:`UnknownNameError` suggests the nearest for another."""
    return BODIES[name]
