"""The plant bodies, and their names."""

from typing import TYPE_CHECKING

from canroll.registry import Registry

if TYPE_CHECKING:
    from plant_sim.bodies.ports import Body

BODIES: "Registry[Body]" = Registry(
    "plant",
    "canroll.bodies",
    {
        "roll1": "plant_sim.bodies.roll:BODY",
        "linear_car": "plant_sim.bodies.linear_car:BODY",
        "linear_car_hydraulic": "plant_sim.bodies.linear_car:HYDRAULIC_BODY",
        "nonlinear": "plant_sim.bodies.nonlinear_car:BODY",
    },
    accept="plant_sim.bodies.ports:accept",
)


def body(name: str) -> "Body":
    """Return the body of that name; raise :class:`UnknownNameError` for an unknown one."""
    return BODIES[name]
