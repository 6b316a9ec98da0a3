"""A vehicle as frozen dataclasses: the data of designs and plants, in SI units.

Axes: x forward, y left, z up. Wheels: front left, front right, rear left, rear right.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import degrees, inf, pi, sqrt
from pkgutil import resolve_name
from typing import Any

from canroll.vehicles.equipment import (
    Actuators,
    Aerodynamics,
    ElectroHydraulicBars,
    SemiActiveDampers,
    SensorChannel,
    Sensors,
)
from canroll.vehicles.fit_spread import FitSpread
from canroll.vehicles.suspensions.tables import SECTION, VehicleTables

__all__ = [
    "GRAVITY",
    "Actuators",
    "Aerodynamics",
    "Driver",
    "ElectroHydraulicBars",
    "Empty",
    "Geometry",
    "Mass",
    "RollModel",
    "SemiActiveDampers",
    "SensorChannel",
    "Sensors",
    "Steering",
    "Suspension",
    "Tyre",
    "TyreFiles",
    "Vehicle",
]

GRAVITY = 9.81
"""Standard gravity as every paper of the presets uses it (m/s²)."""

SCHEMA = 1
"""Version of the format of vehicle files."""
WORDS = ("schema", "title", "basis", "sources")
"""Keys of a vehicle file without numbers of the vehicle."""


@dataclass(frozen=True, slots=True)
class RollModel:
    """I φ'' + C φ' + (K − m g h) φ = m h a_y + M, the 1-DOF roll model about the roll axis.

    Units: kg·m², N·m·s/rad, N·m/rad, kg, m. ``roll_stiffness`` is K, before subtracting gravity.
    """

    roll_inertia: float
    roll_damping: float
    roll_stiffness: float
    sprung_mass: float
    cg_height_above_roll_axis: float

    @property
    def roll_arm(self) -> float:
        """m h (kg·m): the moment on the body per unit of lateral acceleration."""
        return self.sprung_mass * self.cg_height_above_roll_axis

    @property
    def effective_stiffness(self) -> float:
        """K − m g h (N·m/rad): roll stiffness reduced by gravity."""
        return self.roll_stiffness - self.roll_arm * GRAVITY

    @property
    def natural_frequency(self) -> float:
        """Undamped natural frequency (rad/s)."""
        return sqrt(self.effective_stiffness / self.roll_inertia)

    @property
    def roll_period(self) -> float:
        """Undamped period (s), infinite without stiffness.

        When a moment fades in so long the body hardly overshoots.
        """
        return 2 * pi / self.natural_frequency if self.effective_stiffness > 0 else inf

    @property
    def damping_ratio(self) -> float:
        """Damping ratio."""
        return self.roll_damping / (2 * sqrt(self.effective_stiffness * self.roll_inertia))

    @property
    def roll_gradient_deg_per_g(self) -> float:
        """Steady roll angle per lateral acceleration (degrees per g)."""
        return degrees(self.roll_arm * GRAVITY / self.effective_stiffness)

    @property
    def inertia_about_cg(self) -> float:
        """Roll inertia of the sprung mass about its own centre of gravity (kg·m²)."""
        return self.roll_inertia - self.roll_arm * self.cg_height_above_roll_axis


@dataclass(frozen=True, slots=True)
class Geometry:
    """Lengths in m; heights above the road. Distances to the axles are from the whole car's CG."""

    cg_to_front_axle: float
    cg_to_rear_axle: float
    half_track_front: float
    half_track_rear: float
    roll_centre_height_front: float
    roll_centre_height_rear: float
    width: float

    @property
    def wheelbase(self) -> float:
        """Distance between the axles (m)."""
        return self.cg_to_front_axle + self.cg_to_rear_axle

    @property
    def static_front_share(self) -> float:
        """l_r / l, of weight and of the anti-roll moment (Redondo 2021, (53)–(56))."""
        return self.cg_to_rear_axle / self.wheelbase


@dataclass(frozen=True, slots=True)
class Mass:
    """Unsprung masses by axle (kg) and the sprung body's inertia about its own CG (kg·m²).

    The roll inertia comes from the plant's roll model; ``yaw_inertia`` is that of the whole car.
    """

    unsprung_front: float
    unsprung_rear: float
    pitch_inertia: float
    yaw_inertia: float


@dataclass(frozen=True, slots=True)
class Empty:
    """The sprung body without load: kg, m above the roll axis, kg·m² about the roll axis."""

    sprung_mass: float
    cg_height_above_roll_axis: float
    roll_inertia: float


@dataclass(frozen=True, slots=True)
class Suspension:
    """Wheel rates and dampers; anti-roll bars provide the roll stiffness not provided by springs.

    Spring rates per corner at the wheel (N/m). Shares are the front axle's part of the plant's roll
    stiffness and damping. Dampers are bilinear: rebound over bump ratio, and above ``knee_speed``
    (m/s) ``high_speed_ratio`` of the slope. Bump stops: clearance (m), quadratic rate (N/m²).
    """

    spring_rate_front: float
    spring_rate_rear: float
    roll_stiffness_front_share: float
    roll_damping_front_share: float
    rebound_bump_ratio: float
    knee_speed: float
    high_speed_ratio: float
    bump_clearance: float
    rebound_clearance: float
    bump_stop_rate: float


@dataclass(frozen=True, slots=True)
class Tyre:
    """Tyres of both axles. Cornering stiffnesses per axle at the static load (N/rad).

    ``friction`` is the peak friction coefficient at the static load on a road of friction 1;
    ``friction_load_slope`` is its fall per relative overload; ``cornering_load_slope`` the fall of
    cornering stiffness over load. ``shape`` and ``curvature`` are the magic formula's C and E.
    Radius (m), stiffness (N/m) and damping (N·s/m) per wheel, wheel inertia (kg·m²).
    """

    cornering_stiffness_front: float
    cornering_stiffness_rear: float
    longitudinal_stiffness: float
    friction: float
    friction_load_slope: float
    cornering_load_slope: float
    shape: float
    curvature: float
    relaxation_length: float
    vertical_stiffness: float
    vertical_damping: float
    radius: float
    wheel_inertia: float
    rolling_resistance: float

    def at_load(self, ratio: float) -> "Tyre":
        """The same tyres with their numbers at ``ratio`` times the static load."""
        cornering = ratio * (1.0 + self.cornering_load_slope * (1.0 - ratio))
        return replace(
            self,
            cornering_stiffness_front=cornering * self.cornering_stiffness_front,
            cornering_stiffness_rear=cornering * self.cornering_stiffness_rear,
            friction=self.friction * (1.0 + self.friction_load_slope * (1.0 - ratio)),
        )


@dataclass(frozen=True, slots=True)
class TyreFiles:
    """Coefficients of the tyres of both axles by the keys of their .tir files.

    See :mod:`canroll.vehicles.tyres.magic_formula`. ``TYRESIDE`` is 1 for left and -1 for right.
    """

    front: dict[str, float] = field(hash=False)
    rear: dict[str, float] = field(hash=False)


@dataclass(frozen=True, slots=True)
class Steering:
    """Steering-wheel to road-wheel ratio, and limits at the road wheels (rad, rad/s)."""

    ratio: float
    angle_limit: float
    rate_limit: float


@dataclass(frozen=True, slots=True)
class Driver:
    """Driver on a path: ``lag`` of the arms (s)."""

    lag: float


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Everything known about one vehicle.

    ``design`` is the model known to a controller; ``plant`` is the roll model of the simulated
    vehicle, calibrated separately. ``speeds`` holds a default speed (m/s) by manoeuvre name and
    ``lane_offset`` the lateral offset (m) of the double lane change. ``sources`` maps a section or
    ``section.key`` to where its numbers come from. ``file`` is the path of a user's file.
    ``empty`` is the body without load, if the file has it; see :mod:`canroll.vehicles.unladen`.
    ``magic_formula`` has the tyres' coefficients, if they are those of .tir files; ``axles`` the
    tables of the axles; ``aerodynamics`` if the file has them, see :attr:`side_wind`; ``fit`` how
    sure the fitted numbers are.
    """

    name: str
    title: str
    basis: str
    design: RollModel
    plant: RollModel
    geometry: Geometry
    mass: Mass
    suspension: Suspension
    tyre: Tyre
    steering: Steering
    driver: Driver
    actuators: Actuators
    sensors: Sensors
    speeds: dict[str, float] = field(hash=False)
    lane_offset: float
    sources: dict[str, str] = field(hash=False)
    file: str = ""
    empty: Empty | None = None
    magic_formula: TyreFiles | None = None
    aerodynamics: Aerodynamics | None = None
    axles: VehicleTables | None = None
    fit: FitSpread | None = None

    @property
    def reference(self) -> str:
        """Its reference for :func:`canroll.vehicles.load`: the file, or the preset's name."""
        return self.file or self.name

    @property
    def document(self) -> dict[str, Any]:
        """The table of its file: :func:`canroll.vehicles.from_table` gives the same vehicle.

        Speeds are in km/h there, rounded to nine decimals.
        """
        parts = asdict(replace(self, axles=None))
        table = _plain({key: value for key, value in parts.items() if value is not None})
        del table["name"], table["file"]
        if self.magic_formula is not None:
            # by name: it reads files of vehicles, whose records are of this class
            kept = resolve_name("canroll.vehicles.tyre_files:standing")(self)
            table["tyre"] = {key: table["tyre"][key] for key in table["tyre"] if key in kept}
        if self.axles is not None:
            for section, key in resolve_name("canroll.vehicles.axle_files:standing")(self):
                del table[section][key]
            table[SECTION] = self.axles.document
        speeds = {name: round(3.6 * speed, 9) for name, speed in table.pop("speeds").items()}
        maneuvers = {"lane_offset": table.pop("lane_offset"), "speed_kmh": speeds}
        return {"schema": SCHEMA, **table, "maneuvers": maneuvers}

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all its numbers, in hexadecimal, without names, title and sources."""
        numbers = {key: value for key, value in self.document.items() if key not in WORDS}
        return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()

    @property
    def total_mass(self) -> float:
        """Sprung and unsprung mass together (kg)."""
        return self.plant.sprung_mass + self.mass.unsprung_front + self.mass.unsprung_rear

    @property
    def wheel_loads(self) -> tuple[float, float]:
        """Load of one front and one rear wheel at rest (N)."""
        geometry = self.geometry
        weight = self.total_mass * GRAVITY / (2 * geometry.wheelbase)
        return weight * geometry.cg_to_rear_axle, weight * geometry.cg_to_front_axle

    @property
    def sprung_cg_offset(self) -> float:
        """Distance of the sprung CG ahead of the whole car's (m)."""
        moment = (
            self.mass.unsprung_rear * self.geometry.cg_to_rear_axle
            - self.mass.unsprung_front * self.geometry.cg_to_front_axle
        )
        return moment / self.plant.sprung_mass

    @property
    def sprung_yaw_inertia(self) -> float:
        """Yaw inertia of the sprung body about its own CG (kg·m²): the car's less the axles'."""
        geometry, mass = self.geometry, self.mass
        front = geometry.cg_to_front_axle**2 + geometry.half_track_front**2
        rear = geometry.cg_to_rear_axle**2 + geometry.half_track_rear**2
        axles = mass.unsprung_front * front + mass.unsprung_rear * rear
        return mass.yaw_inertia - axles - self.plant.sprung_mass * self.sprung_cg_offset**2

    @property
    def roll_axis_height(self) -> float:
        """Height of the roll axis above the road under the sprung CG (m)."""
        geometry = self.geometry
        ahead = geometry.cg_to_rear_axle + self.sprung_cg_offset
        slope = geometry.roll_centre_height_front - geometry.roll_centre_height_rear
        return geometry.roll_centre_height_rear + slope * ahead / geometry.wheelbase

    @property
    def sprung_cg_height(self) -> float:
        """Height of the sprung CG above the road (m): roll axis there plus the plant's h."""
        return self.roll_axis_height + self.plant.cg_height_above_roll_axis

    @property
    def cg_height(self) -> float:
        """Height of the whole car's CG above the road (m), unsprung masses at wheel height."""
        unsprung = self.mass.unsprung_front + self.mass.unsprung_rear
        moment = self.plant.sprung_mass * self.sprung_cg_height + unsprung * self.tyre.radius
        return moment / self.total_mass

    @property
    def understeer(self) -> float:
        """Understeer gradient of the linear bicycle (rad per m/s²): δ = l/R + K a_y.

        With what the axles' tables steer them: roll steer and side-force compliance steer.
        """
        geometry, tyre = self.geometry, self.tyre
        of_tyres = (self.total_mass / geometry.wheelbase) * (
            geometry.cg_to_rear_axle / tyre.cornering_stiffness_front
            - geometry.cg_to_front_axle / tyre.cornering_stiffness_rear
        )
        if self.axles is None or not self.axles.moves_wheels:
            return of_tyres
        # by name: it reads vehicles, whose records are of this class
        front, rear = resolve_name("canroll.vehicles.roll_stiffness:axle_steer")(self)
        return of_tyres - float(front) + float(rear)

    def lateral_gain(self, speed: float) -> float:
        """Steady lateral acceleration per road-wheel angle (m/s² per rad) at ``speed`` (m/s)."""
        return speed**2 / (self.geometry.wheelbase + self.understeer * speed**2)

    @property
    def side_wind(self) -> Aerodynamics:
        """Aerodynamics of its file, or guessed ones."""
        geometry = self.geometry
        return self.aerodynamics or Aerodynamics.guessed(
            width=geometry.width, cg_height=self.cg_height, wheelbase=geometry.wheelbase
        )

    @property
    def static_stability_factor(self) -> float:
        """Mean half track over CG height: the lateral acceleration in g that tips a rigid car."""
        geometry = self.geometry
        return (geometry.half_track_front + geometry.half_track_rear) / (2 * self.cg_height)

    def replace(self, changes: Mapping[str, Any], *, name: str = "") -> "Vehicle":
        """Return the vehicle with other numbers, checked.

        A design equal to the plant stays equal to it.

        Args:
            changes: values by dotted key of the vehicle file, as ``{"plant.sprung_mass": 2500}``.
            name: of the new vehicle; by default this one's with the changes.

        Raises:
            UnknownNameError: no such key; the nearest is suggested.
            CanrollError: the changes make an impossible or implausible vehicle.
        """
        # by name: it reads vehicles, whose records are of this class
        vehicle: Vehicle = resolve_name("canroll.vehicles.changes:changed")(
            self, changes, name=name
        )
        return vehicle

    def source(self, key: str) -> str:
        """Source of the number at ``section.key``: the longest matching source entry."""
        parts = key.split(".")
        for length in range(len(parts), 0, -1):
            text = self.sources.get(".".join(parts[:length]))
            if text is not None:
                return text
        return ""


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return tables, lists, floats and texts for what a vehicle's parts consist of."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, str) else float(value)
