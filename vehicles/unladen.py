"""The vehicle without its load: the same springs, bars, dampers and tyres with a lighter body."""

from dataclasses import replace

from canroll.vehicles.axle_files import followed
from canroll.vehicles.axles import axles
from canroll.vehicles.model import GRAVITY, Empty, Vehicle
from canroll.vehicles.roll_stiffness import steady_roll, suspension_roll_stiffness

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

    Springs, bars and dampers are unchanged; on springs by tables the body stands higher. Cornering
    stiffness and friction follow the tyre's load sensitivity to the lower static load. The CG's
    distances from the axles, and pitch and yaw inertia, are unchanged.
    """
    body = empty_body(vehicle)
    changed = {
        "sprung_mass": body.sprung_mass,
        "cg_height_above_roll_axis": body.cg_height_above_roll_axis,
        "roll_inertia": body.roll_inertia,
    }
    lighter = replace(vehicle, plant=replace(vehicle.plant, **changed))
    load = lighter.total_mass / vehicle.total_mass
    lighter, suspension = _on_its_springs(lighter, vehicle)
    gradient = steady_roll(lighter, suspension)[0]
    stiffness = lighter.plant.roll_arm / gradient + lighter.plant.roll_arm * GRAVITY
    plant = replace(lighter.plant, roll_stiffness=stiffness)
    return followed(
        replace(
            lighter,
            plant=plant,
            design=replace(vehicle.design, **changed),
            tyre=vehicle.tyre.at_load(load),
        )
    )


def _on_its_springs(lighter: Vehicle, laden: Vehicle) -> tuple[Vehicle, float]:
    """The car where it stands on the tables of its springs, and their and the bars' stiffness."""
    suspension = suspension_roll_stiffness(laden)
    if laden.axles is None:
        return lighter, suspension
    lighter = followed(lighter)
    parts = [
        before.roll_share * suspension + 2.0 * before.half_track**2 * (after.spring - before.spring)
        for before, after in zip(axles(laden), axles(lighter), strict=True)
    ]
    share = replace(lighter.suspension, roll_stiffness_front_share=parts[0] / sum(parts))
    return replace(lighter, suspension=share), sum(parts)
