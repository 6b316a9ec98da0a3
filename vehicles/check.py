"""Plausibility checks of a vehicle: each names the key and the fault."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from math import degrees, isfinite
from typing import Any

from canroll.vehicles.model import RollModel, Vehicle

SIGNED = (
    "imu_position",
    "imu_misalignment",
    "bias",
    "roll_centre_height",
    "tyre.curvature",
    "magic_formula",
    "centre_of_pressure_ahead",
    "axles.",
    "fit.correlation",
)
"""Keys whose numbers may be negative; every other number of a vehicle must not be."""

MAY_BE_ZERO = (
    "noise_density",
    "latency",
    "rolling_resistance",
    "friction_load_slope",
    "cornering_load_slope",
    "leakage",
    "spring_rate",
    "lane_offset",
    "soft_force",
    "firm_force",
    "dampers.rate",
    "fit.correlation",
)

POUND = 0.45359237
"""kg."""

SLOPES = ("friction_load_slope", "cornering_load_slope")
"""Keys that may be negative where they follow from a tyre's file."""


def _numbers(value: Any, path: str) -> Iterator[tuple[str, float]]:  # noqa: ANN401
    if is_dataclass(value):
        for field in fields(value):
            yield from _numbers(
                getattr(value, field.name), f"{path}.{field.name}" if path else field.name
            )
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _numbers(item, f"{path}.{key}")
    elif isinstance(value, tuple):
        for item in value:
            yield from _numbers(item, path)
    elif isinstance(value, float):
        yield path, value


def signs(vehicle: Vehicle) -> Iterator[str]:
    """Numbers that are not finite, negative, or zero where they must not be, one line each."""
    following = SLOPES if vehicle.magic_formula is not None else ()
    # the plant first: a file without a design has the plant's
    for path, value in (*_numbers(vehicle.plant, "plant"), *_numbers(vehicle, "")):
        if not isfinite(value):
            yield f"{path} = {value}: not a finite number"
        elif value < 0 and not any(key in path for key in (*SIGNED, *following)):
            yield f"{path} = {value:g}: must not be negative"
        elif value == 0 and not any(key in path for key in (*SIGNED, *MAY_BE_ZERO)):
            yield f"{path} = 0: must be positive"


def _roll_model(model: RollModel, part: str) -> Iterator[str]:
    if model.effective_stiffness <= 0:
        yield (
            f"{part}.roll_stiffness = {model.roll_stiffness:g}: does not hold the body up, "
            f"it must exceed m g h = {model.roll_stiffness - model.effective_stiffness:.0f} N·m/rad"
        )
    elif model.inertia_about_cg <= 0:
        arm = model.cg_height_above_roll_axis
        in_pounds = model.roll_inertia > POUND * model.sprung_mass * arm**2
        yield (
            f"{part}.roll_inertia = {model.roll_inertia:g}: taken about the roll axis it must "
            f"exceed m h² = {model.roll_inertia - model.inertia_about_cg:.0f} kg·m², of "
            f"{part}.sprung_mass = {model.sprung_mass:g} kg{' (lb?)' if in_pounds else ''} and "
            f"{part}.cg_height_above_roll_axis = {arm:g} m"
        )


def _empty(vehicle: Vehicle) -> Iterator[str]:
    empty, plant = vehicle.empty, vehicle.plant
    if empty is None:
        return
    if empty.sprung_mass >= plant.sprung_mass:
        yield (
            f"empty.sprung_mass = {empty.sprung_mass:g}: must be less than the laden body's, "
            f"{plant.sprung_mass:g} kg: change both, or omit [empty]"
        )
    least = empty.sprung_mass * empty.cg_height_above_roll_axis**2
    if empty.roll_inertia <= least:
        yield (
            f"empty.roll_inertia = {empty.roll_inertia:g}: taken about the roll axis it must "
            f"exceed m h² = {least:.0f} kg·m²"
        )


def _inertia(vehicle: Vehicle) -> Iterator[str]:
    """Each principal moment of a rigid body is at most the sum of the other two."""
    mass = vehicle.mass
    roll, pitch = vehicle.plant.inertia_about_cg, mass.pitch_inertia
    yaw = vehicle.sprung_yaw_inertia
    if yaw <= 0:
        yield (
            f"mass.yaw_inertia = {mass.yaw_inertia:g}: less than the wheels alone bring about "
            f"the centre of gravity, {mass.yaw_inertia - yaw:.0f} kg·m²"
        )
        return
    names = (("roll", roll), ("pitch", pitch), ("yaw", yaw))
    for name, moment in names:
        others = roll + pitch + yaw - moment
        if moment > others:
            yield (
                f"mass: impossible inertia, no rigid body has a {name} moment of {moment:.0f} "
                f"above the sum of the other two, {others:.0f} kg·m² (sprung body about its CG)"
            )


def _consistency(vehicle: Vehicle) -> Iterator[str]:
    for key in ("roll_stiffness_front_share", "roll_damping_front_share", "high_speed_ratio"):
        value = getattr(vehicle.suspension, key)
        if not 0 < value < 1 and not (key == "high_speed_ratio" and value == 1):
            yield f"suspension.{key} = {value:g}: must be between 0 and 1"
    tyre = vehicle.tyre
    for key in ("friction_load_slope", "cornering_load_slope"):
        if vehicle.magic_formula is None and getattr(tyre, key) >= 0.5:
            yield f"tyre.{key} = {getattr(tyre, key):g}: from 0.5 on, grip would fall with load"
    if vehicle.magic_formula is None and not 1 <= tyre.shape < 2:
        yield f"tyre.shape = {tyre.shape:g}: the magic formula's C lies in [1, 2)"
    if vehicle.magic_formula is None and tyre.curvature > 1:
        yield f"tyre.curvature = {tyre.curvature:g}: the magic formula's E is at most 1"
    dampers = vehicle.actuators.dampers
    count = len(dampers.rate)
    if count < 2 or len(dampers.soft_force) != count or len(dampers.firm_force) != count:
        yield "actuators.dampers: rate, soft_force and firm_force need the same length, at least 2"
    elif dampers.rate[0] != 0 or any(
        b <= a for a, b in zip(dampers.rate, dampers.rate[1:], strict=False)
    ):
        yield "actuators.dampers.rate: must start at 0 and increase"
    elif any(s > f for s, f in zip(dampers.soft_force, dampers.firm_force, strict=True)):
        yield "actuators.dampers: soft_force must nowhere exceed firm_force"
    if vehicle.geometry.width < 2 * 0.8 * vehicle.geometry.half_track_front:
        yield f"geometry.width = {vehicle.geometry.width:g}: narrower than the track"


def _steering(vehicle: Vehicle) -> Iterator[str]:
    table = None if vehicle.axles is None else vehicle.axles.front.steering
    if table is None:
        return
    reach, stop = min(-table.x[0], table.x[-1]), vehicle.steering.angle_limit
    if reach < (1.0 - 1e-9) * vehicle.steering.ratio * stop:
        yield (
            f"axles.front.steering ends at {degrees(reach):.0f}° of the steering wheel, but "
            f"steering.angle_limit = {stop:g} is {degrees(vehicle.steering.ratio * stop):.0f}°, "
            f"by the ratio on centre of {vehicle.steering.ratio:.4g}: give the table up to the "
            f"stop, or lower the limit to {reach / vehicle.steering.ratio:.4g}"
        )


def problems(vehicle: Vehicle) -> Iterator[str]:
    """Reasons why ``vehicle`` is impossible, one line each; empty for a possible one."""
    wrong = list(signs(vehicle))
    yield from wrong
    if wrong:
        return
    plant = list(_roll_model(vehicle.plant, "plant"))
    yield from plant
    yield from _roll_model(vehicle.design, "design")
    if not plant:
        yield from _inertia(vehicle)
    yield from _empty(vehicle)
    yield from _consistency(vehicle)
    yield from _steering(vehicle)
