"""A vehicle and its class: ratios and handling quantities with their usual ranges."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import degrees, pi

from canroll.extensions.car.sizing.classes import class_named
from canroll.vehicles.axles import axles
from canroll.vehicles.model import GRAVITY, Vehicle
from canroll.vehicles.plausible import BANDS, cornering_coefficient, ride_frequency
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness


@dataclass(frozen=True, slots=True)
class ReviewedQuantity:
    """A derived number of a vehicle.

    Attributes:
        label: what it is.
        value: in ``unit``.
        unit: empty for a ratio.
        low: lower end of the usual range, or None without one.
        high: upper end.
    """

    label: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None

    @property
    def usual(self) -> bool:
        """Whether the value is within the usual range, or there is none."""
        return self.low is None or self.high is None or self.low <= self.value <= self.high


def _index(vehicle: Vehicle) -> float:
    geometry = vehicle.geometry
    arms = geometry.cg_to_front_axle * geometry.cg_to_rear_axle
    return vehicle.mass.yaw_inertia / (vehicle.total_mass * arms)


def _springs(vehicle: Vehicle) -> float:
    return sum(2 * axle.spring * axle.half_track**2 for axle in axles(vehicle))


def _track(vehicle: Vehicle) -> float:
    return vehicle.geometry.half_track_front + vehicle.geometry.half_track_rear


def _gyration(vehicle: Vehicle) -> float:
    return float((vehicle.plant.inertia_about_cg / vehicle.plant.sprung_mass) ** 0.5)


def _wheel(vehicle: Vehicle) -> float:
    unsprung = vehicle.mass.unsprung_front + vehicle.mass.unsprung_rear
    return vehicle.tyre.wheel_inertia / (unsprung / 4 * vehicle.tyre.radius**2)


def _wheel_load(vehicle: Vehicle) -> float:
    return vehicle.total_mass * GRAVITY / 4


RATIO_OF: dict[str, Callable[[Vehicle], float]] = {
    "front_share": lambda v: v.geometry.static_front_share,
    "width": lambda v: v.geometry.width / _track(v),
    "unsprung": lambda v: (v.mass.unsprung_front + v.mass.unsprung_rear) / v.total_mass,
    "roll_gyration": lambda v: _gyration(v) / v.geometry.width,
    "yaw_index": _index,
    "pitch_index": lambda v: v.mass.pitch_inertia / v.mass.yaw_inertia,
    "ride_front": ride_frequency(0),
    "ride_rear": ride_frequency(1),
    "bars": lambda v: suspension_roll_stiffness(v) / _springs(v),
    "front_damping": lambda v: v.suspension.roll_damping_front_share,
    "roll_damping": lambda v: v.plant.damping_ratio,
    "roll_centre_front": lambda v: v.geometry.roll_centre_height_front / v.cg_height,
    "roll_centre_rear": lambda v: v.geometry.roll_centre_height_rear / v.cg_height,
    "cornering_front": cornering_coefficient(0),
    "cornering_rear": cornering_coefficient(1),
    "deflection": lambda v: _wheel_load(v) / v.tyre.vertical_stiffness / v.tyre.radius,
    "longitudinal": lambda v: v.tyre.longitudinal_stiffness / _wheel_load(v),
    "wheel_gyration": _wheel,
    "radius": lambda v: v.tyre.radius,
}
"""Ratios of a class that follow from a vehicle's numbers alone."""
LABELS = {
    "front_share": ("front share of the weight", ""),
    "width": ("width over track", ""),
    "unsprung": ("unsprung share of the mass", ""),
    "roll_gyration": ("radius of gyration in roll over width", ""),
    "yaw_index": ("yaw inertia over mass × axle distances", ""),
    "pitch_index": ("pitch over yaw inertia", ""),
    "ride_front": ("ride frequency, front", "Hz"),
    "ride_rear": ("ride frequency, rear", "Hz"),
    "bars": ("roll stiffness over that of the springs", ""),
    "front_damping": ("front share of the roll damping", ""),
    "roll_damping": ("damping ratio in roll", ""),
    "roll_centre_front": ("roll centre over CG height, front", ""),
    "roll_centre_rear": ("roll centre over CG height, rear", ""),
    "cornering_front": ("cornering stiffness over load, front", "1/rad"),
    "cornering_rear": ("cornering stiffness over load, rear", "1/rad"),
    "deflection": ("tyre deflection over radius", ""),
    "longitudinal": ("longitudinal stiffness over load", ""),
    "wheel_gyration": ("wheel inertia over mass × radius²", ""),
    "radius": ("tyre radius", "m"),
}
"""Label and unit of each ratio."""


def handling(vehicle: Vehicle, kind: str | None = None) -> Iterator[ReviewedQuantity]:
    """Quantities by which a vehicle's roll and handling are judged.

    A range is the usual one of a class; without a class it is that beyond which
    :mod:`canroll.vehicles.plausible` refuses a vehicle file.
    """
    plausible = {band.quantity: (band.low, band.high) for band in BANDS}
    gradient, steer = plausible["a roll gradient"], plausible["an understeer gradient"]
    if kind is not None:
        gradient, steer = class_named(kind).roll_gradient, class_named(kind).understeer
    plant = vehicle.plant
    understeer = degrees(vehicle.understeer) * GRAVITY
    yield ReviewedQuantity("mass", vehicle.total_mass, "kg")
    yield ReviewedQuantity("height of the centre of gravity", vehicle.cg_height, "m")
    yield ReviewedQuantity("static stability factor", vehicle.static_stability_factor, "g")
    yield ReviewedQuantity("roll gradient", plant.roll_gradient_deg_per_g, "deg/g", *gradient)
    yield ReviewedQuantity("natural frequency in roll", plant.natural_frequency / (2 * pi), "Hz")
    yield ReviewedQuantity("understeer gradient", understeer, "deg/g", *steer)


def beside_class(
    vehicle: Vehicle, kind: str, drive: str | None = None
) -> Iterator[ReviewedQuantity]:
    """Ratios of a vehicle with the usual ranges of a class, of its driven axles if given."""
    of_class = class_named(kind, drive)
    for name, value in RATIO_OF.items():
        ratio = getattr(of_class, name)
        label, unit = LABELS[name]
        yield ReviewedQuantity(label, value(vehicle), unit, ratio.low, ratio.high)
