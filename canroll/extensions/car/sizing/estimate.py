"""A complete vehicle from its mass and size: every other number is estimated by its class."""

from collections.abc import Mapping
from math import pi, sqrt
from typing import Any

from canroll.documents import refuse_unknown
from canroll.errors import CanrollError
from canroll.extensions.car.sizing.classes import RATIOS, Ratio, class_named
from canroll.vehicles.check import POUND
from canroll.vehicles.load import from_table, load
from canroll.vehicles.model import GRAVITY, SCHEMA, Vehicle
from canroll.vehicles.roll_stiffness import steady_roll

SIZES = {
    "mass": (300.0, 40e3, "kg", {1e3: "t", POUND: "lb"}),
    "wheelbase": (1.2, 8.0, "m", {1e-3: "mm", 1e-2: "cm"}),
    "track": (0.8, 2.6, "m", {1e-3: "mm", 1e-2: "cm"}),
    "height": (0.8, 4.5, "m", {1e-3: "mm", 1e-2: "cm"}),
}
"""What has to be known: least, most, unit, and by their factors the units it may be in instead.

Track is the mean of both axles', height that of the vehicle."""

SHARED = ("steering", "driver", "actuators", "sensors")
"""Sections of the base."""
SHAPES = {
    "suspension": (
        *("rebound_bump_ratio", "knee_speed", "high_speed_ratio"),
        *("bump_clearance", "rebound_clearance", "bump_stop_rate"),
    ),
    "tyre": (
        *("friction", "friction_load_slope", "cornering_load_slope", "shape", "curvature"),
        *("relaxation_length", "vertical_damping", "rolling_resistance"),
    ),
}
"""Numbers of other sections that are the base's."""


def estimated(
    kind: str, known: Mapping[str, float], *, name: str, drive: str | None = None
) -> Vehicle:
    """Return a vehicle of a class, checked.

    The source of an estimated number says so, with its spread and where that comes from. A number
    that depends on several ratios has the root of the sum of squares of their spreads.

    Args:
        kind: a class of :data:`canroll.extensions.car.sizing.classes.CLASSES`.
        known: :data:`SIZES`, and ratios of the class that are known, by their names.
        name: of the vehicle.
        drive: the driven axles, front, rear or all, where they are known.

    Raises:
        UnknownNameError: no such class, ratio or drive.
        CanrollError: a size is missing, or they make an impossible or implausible vehicle.
    """
    kept = class_named(kind, drive)
    refuse_unknown(known, (*SIZES, *RATIOS), "size or ratio of a vehicle")
    for key, (low, high, unit, slips) in SIZES.items():
        if key not in known:
            raise CanrollError(f"a vehicle needs its {key}")
        if not low <= known[key] <= high:
            meant = ((f * known[key], other) for f, other in slips.items())
            hint = next((f": in {u}? Then give {v:g}" for v, u in meant if low <= v <= high), "")
            message = f"{key} {known[key]:g}: must be {low:g} to {high:g} {unit}{hint}"
            raise CanrollError(message)
    for key, value in known.items():
        if not value > 0.0:
            raise CanrollError(f"{key} {value:g}: must be positive")
    given = {
        key: Ratio(known[key], 0.0, "given") if key in known else getattr(kept, key)
        for key in RATIOS
    }
    base = load(kept.base)
    table = _Estimate(known, given).table(base)
    words = {
        "schema": SCHEMA,
        "title": f"{kept.title}, estimated from mass and size",
        "basis": f"sizes given, the rest estimated for a {kept.title}; equipment of {kept.base}",
        "sources": _sources(table, given, base),
    }
    _add_roll(table, from_table(table | words, name=name), given)
    return from_table(_rounded(table) | words, name=name, where=f"vehicle {name}", unusual=())


class _Estimate:
    """The numbers of a vehicle by its sizes and ratios."""

    def __init__(self, known: Mapping[str, float], ratios: Mapping[str, Ratio]) -> None:
        self.known, self.ratios = known, ratios
        self.mass, self.wheelbase = known["mass"], known["wheelbase"]
        self.half_track = known["track"] / 2
        self.unsprung = self["unsprung"] * self.mass / 2
        self.sprung = self.mass - 2 * self.unsprung
        self.front = self["front_share"]
        self.radius = self["radius"]
        self.wheel_load = self.mass * GRAVITY / 4

    def __getitem__(self, ratio: str) -> float:
        return self.ratios[ratio].value

    def table(self, base: Vehicle) -> dict[str, Any]:
        """All sections; the plant's stiffness and damping are those of the springs alone."""
        known, mass, half = self.known, self.mass, self.half_track
        ahead = (1.0 - self.front) * self.wheelbase, self.front * self.wheelbase
        cg = self["cg_height"] * known["height"]
        centres = self["roll_centre_front"] * cg, self["roll_centre_rear"] * cg
        # of the body alone, whose mass is nearer to the heavier axle
        offset = self.unsprung * (ahead[1] - ahead[0]) / self.sprung
        axis = centres[1] + (centres[0] - centres[1]) * (ahead[1] + offset) / self.wheelbase
        arm = (mass * cg - 2 * self.unsprung * self.radius) / self.sprung - axis
        if arm <= 0.0:
            raise CanrollError("the centre of gravity is not above the roll axis: check the height")
        width = self["width"] * known["track"]
        yaw = self["yaw_index"] * mass * ahead[0] * ahead[1]
        springs = [self._spring(axle) for axle in (0, 1)]
        bars = (self["bars"] - 1.0) * sum(springs)
        stiffness = sum(springs) + bars
        document = base.document
        plant = {
            "roll_inertia": self.sprung * ((self["roll_gyration"] * width) ** 2 + arm**2),
            "roll_damping": 1.0,
            "roll_stiffness": stiffness,
            "sprung_mass": self.sprung,
            "cg_height_above_roll_axis": arm,
        }
        loads = [self.front * mass * GRAVITY, (1.0 - self.front) * mass * GRAVITY]
        return {
            "plant": plant,
            "geometry": {
                "cg_to_front_axle": ahead[0],
                "cg_to_rear_axle": ahead[1],
                "half_track_front": half,
                "half_track_rear": half,
                "roll_centre_height_front": centres[0],
                "roll_centre_height_rear": centres[1],
                "width": width,
            },
            "mass": {
                "unsprung_front": self.unsprung,
                "unsprung_rear": self.unsprung,
                "pitch_inertia": self["pitch_index"] * yaw,
                "yaw_inertia": yaw,
            },
            "suspension": {
                "spring_rate_front": springs[0] / (2 * half**2),
                "spring_rate_rear": springs[1] / (2 * half**2),
                "roll_stiffness_front_share": (springs[0] + self["front_bar"] * bars) / stiffness,
                "roll_damping_front_share": self["front_damping"],
                **{key: document["suspension"][key] for key in SHAPES["suspension"]},
            },
            "tyre": {
                "cornering_stiffness_front": self["cornering_front"] * loads[0],
                "cornering_stiffness_rear": self["cornering_rear"] * loads[1],
                "longitudinal_stiffness": self["longitudinal"] * self.wheel_load,
                "vertical_stiffness": self.wheel_load / (self["deflection"] * self.radius),
                "radius": self.radius,
                "wheel_inertia": self["wheel_gyration"] * self.unsprung / 2 * self.radius**2,
                **{key: document["tyre"][key] for key in SHAPES["tyre"]},
            },
            **{key: document[key] for key in (*SHARED, "maneuvers")},
        }

    def _spring(self, axle: int) -> float:
        """Roll stiffness of both springs of an axle, N·m/rad."""
        share = (self.front, 1.0 - self.front)[axle]
        carried = (share * self.mass - self.unsprung) / 2
        frequency = 2 * pi * self[("ride_front", "ride_rear")[axle]]
        return 2 * carried * frequency**2 * self.half_track**2


def _add_roll(table: dict[str, Any], vehicle: Vehicle, ratios: Mapping[str, Ratio]) -> None:
    """Put stiffness, tyres in series, and damping of the whole car into the plant's section."""
    roll = steady_roll(vehicle, vehicle.plant.roll_stiffness)[0]
    plant = vehicle.plant
    effective = plant.roll_arm / roll
    table["plant"]["roll_stiffness"] = effective + plant.roll_arm * GRAVITY
    damping = 2 * ratios["roll_damping"].value * sqrt(effective * plant.roll_inertia)
    table["plant"]["roll_damping"] = damping


_DEPENDS = {
    "plant.roll_inertia": ("roll_gyration", "width", "cg_height"),
    "plant.roll_damping": ("roll_damping", "bars", "ride_front", "roll_gyration"),
    "plant.roll_stiffness": ("ride_front", "ride_rear", "bars", "deflection"),
    "plant.sprung_mass": ("unsprung",),
    "plant.cg_height_above_roll_axis": ("cg_height", "unsprung"),
    "geometry.cg_to_front_axle": ("front_share",),
    "geometry.cg_to_rear_axle": ("front_share",),
    "geometry.roll_centre_height_front": ("roll_centre_front",),
    "geometry.roll_centre_height_rear": ("roll_centre_rear",),
    "geometry.width": ("width",),
    "mass.unsprung_front": ("unsprung",),
    "mass.unsprung_rear": ("unsprung",),
    "mass.pitch_inertia": ("pitch_index", "yaw_index", "front_share"),
    "mass.yaw_inertia": ("yaw_index", "front_share"),
    "suspension.spring_rate_front": ("ride_front", "front_share"),
    "suspension.spring_rate_rear": ("ride_rear", "front_share"),
    "suspension.roll_stiffness_front_share": ("ride_front", "ride_rear", "bars", "front_bar"),
    "suspension.roll_damping_front_share": ("front_damping",),
    "tyre.cornering_stiffness_front": ("cornering_front", "front_share"),
    "tyre.cornering_stiffness_rear": ("cornering_rear", "front_share"),
    "tyre.longitudinal_stiffness": ("longitudinal",),
    "tyre.vertical_stiffness": ("deflection", "radius"),
    "tyre.radius": ("radius",),
    "tyre.wheel_inertia": ("wheel_gyration", "unsprung", "radius"),
}
"""Ratios on which a number depends."""


def _sources(
    table: Mapping[str, Any], ratios: Mapping[str, Ratio], base: Vehicle
) -> dict[str, str]:
    sources = {"geometry.half_track_front": "given", "geometry.half_track_rear": "given"}
    for key, names in _DEPENDS.items():
        used = [ratios[name] for name in names]
        spread = sqrt(sum(ratio.spread**2 for ratio in used))
        origins = "; ".join(dict.fromkeys(ratio.source for ratio in used))
        words = ", ".join(name.replace("_", " ") for name in names)
        sources[key] = (
            f"estimated ±{100 * spread:.0f} % by {words}: {origins}"
            if spread
            else f"given by {words}"
        )
    for section, part in table.items():
        for key in part:
            path = f"{section}.{key}"
            if path not in sources:
                sources[path] = f"of {base.name}: {base.source(path)}"
    return sources


def _rounded(table: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers to four digits: they are known to a few per cent."""
    return {
        section: {
            key: float(f"{value:.4g}") if isinstance(value, float) else value
            for key, value in part.items()
        }
        for section, part in table.items()
    }
