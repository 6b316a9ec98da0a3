"""The plant bodies, and their names."""

from typing import TYPE_CHECKING

from canroll.errors import CanrollError
from canroll.registry import Registry

if TYPE_CHECKING:
    from canroll.plant_sim.bodies.ports import Body

BODIES: "Registry[Body]" = Registry(
    "plant",
    "canroll.bodies",
    {
        "roll1": "canroll.plant_sim.bodies.roll:BODY",
        "linear_car": "canroll.plant_sim.bodies.linear_car:BODY",
        "linear_car_hydraulic": "canroll.plant_sim.bodies.linear_car:HYDRAULIC_BODY",
        "nonlinear": "canroll.plant_sim.bodies.nonlinear_car:BODY",
    },
    accept="canroll.plant_sim.bodies.ports:accept",
)


def body(name: str) -> "Body":
    """Return the body of that name; raise :class:`canroll.UnknownNameError` for an unknown one."""
    return BODIES[name]


def own_body(name: str, purpose: str) -> "Body":
    """Return the body of that name for a purpose for which an FMU will not do.

    Raises:
        UnknownNameError: there is none.
        CanrollError: it is an FMU.
    """
    chosen = body(name)
    if chosen.outside is not None:
        raise CanrollError(f"--plant {name}: {purpose} needs a model of canroll: omit --plant")
    return chosen
