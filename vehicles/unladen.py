"""The vehicle without its load: the same springs, bars, dampers and tyres with a lighter body."""

from dataclasses import replace

from vehicles.model import GRAVITY, Empty, Vehicle
from vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness
from vehicles.tyre_files import followed

MASS_SHARE = 0.75
"""Sprung mass of the empty over that of the laden car, where the vehicle file has no ``empty``."""
HEIGHT_SHARE = 0.9
"""Likewise for the height of the sprung CG above the roll axis."""


def empty_body(vehicle: Vehicle) -> Empty:
    """Return the file's empty body, or an estimate: inertia about the CG proportional to mass."""
    if vehicle.empty is not None:
        return vehicle.empty
    laden = vehicle.plant
    mass = MASS_SHARE * laden.sprung_mass
    height = HEIGHT_SHARE * laden.cg_height_above_roll_axis
    return Empty(mass, height, MASS_SHARE * laden.inertia_about_cg + mass * height**2)


def unladen(vehicle: Vehicle) -> Vehicle:
    """Return ``vehicle`` with its empty body.

    Springs, bars and dampers are unchanged. Cornering stiffness and friction follow the tyre's load
    sensitivity to the lower static load. The CG's distances from the axles, and pitch and yaw
    inertia, are unchanged.
    """
    body = empty_body(vehicle)
    changed = {
        "sprung_mass": body.sprung_mass,
        "cg_height_above_roll_axis": body.cg_height_above_roll_axis,
        "roll_inertia": body.roll_inertia,
    }
    lighter = replace(vehicle, plant=replace(vehicle.plant, **changed))
    load = lighter.total_mass / vehicle.total_mass
    gradient = steady_roll(lighter, suspension_roll_stiffness(vehicle))[0]
    stiffness = lighter.plant.roll_arm / gradient + lighter.plant.roll_arm * GRAVITY
    plant = replace(lighter.plant, roll_stiffness=stiffness)
    return followed(
        replace(
            vehicle,
            plant=plant,
            design=replace(vehicle.design, **changed),
            tyre=vehicle.tyre.at_load(load),
        )
    )
