"""Plausibility of a vehicle file's numbers: bands of derived quantities, and slips of units."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from math import degrees, pi, sqrt
from typing import Any

from canroll.vehicles.model import GRAVITY, Vehicle

SLIPS = (
    (1e3, "a number in thousands, as N/mm for N/m, t for kg or kN for N"),
    (180 / pi, "per degree instead of per radian"),
    (1e-2, "cm instead of m, or per cent"),
    (1e-3, "a number in thousandths, as mm for m or g for kg"),
    (pi / 180, "degrees instead of radians"),
    (GRAVITY, "a weight in kg instead of N"),
    (1 / GRAVITY, "N instead of kg"),
)
"""Factors that correct the usual slips of units, with their names."""


@dataclass(frozen=True, slots=True)
class Band:
    """A derived quantity of one key of the vehicle file, and its plausible range."""

    key: str
    quantity: str
    unit: str
    low: float
    high: float
    value: Callable[[Vehicle], float]
    source: str


def _loads(vehicle: Vehicle) -> tuple[float, float]:
    """Static load of the front and the rear axle, N."""
    share = vehicle.geometry.static_front_share
    weight = vehicle.total_mass * GRAVITY
    return share * weight, (1.0 - share) * weight


def _sprung(vehicle: Vehicle, axle: int) -> float:
    """Sprung mass on a wheel of the axle, kg."""
    unsprung = (vehicle.mass.unsprung_front, vehicle.mass.unsprung_rear)[axle]
    return (_loads(vehicle)[axle] / GRAVITY - unsprung) / 2


def _rate(vehicle: Vehicle, axle: int) -> float:
    suspension = vehicle.suspension
    return (suspension.spring_rate_front, suspension.spring_rate_rear)[axle]


def ride_frequency(axle: int) -> Callable[[Vehicle], float]:
    """Frequency of the body on one spring of an axle, Hz, of a vehicle."""
    return lambda vehicle: sqrt(_rate(vehicle, axle) / _sprung(vehicle, axle)) / (2 * pi)


def _hop(axle: int) -> Callable[[Vehicle], float]:
    def frequency(vehicle: Vehicle) -> float:
        mass = (vehicle.mass.unsprung_front, vehicle.mass.unsprung_rear)[axle] / 2
        return sqrt((_rate(vehicle, axle) + vehicle.tyre.vertical_stiffness) / mass) / (2 * pi)

    return frequency


def cornering_coefficient(axle: int) -> Callable[[Vehicle], float]:
    """Cornering stiffness of an axle over its load, 1/rad, of a vehicle."""

    def coefficient(vehicle: Vehicle) -> float:
        tyre = vehicle.tyre
        stiffness = (tyre.cornering_stiffness_front, tyre.cornering_stiffness_rear)[axle]
        return stiffness / _loads(vehicle)[axle]

    return coefficient


def _deflection(vehicle: Vehicle) -> float:
    tyre = vehicle.tyre
    return max(_loads(vehicle)) / 2 / tyre.vertical_stiffness / tyre.radius


def _understeer(vehicle: Vehicle) -> float:
    return degrees(1 / cornering_coefficient(0)(vehicle) - 1 / cornering_coefficient(1)(vehicle))


def _gyration(vehicle: Vehicle) -> float:
    mass = max(vehicle.mass.unsprung_front, vehicle.mass.unsprung_rear) / 2
    return vehicle.tyre.wheel_inertia / (mass * vehicle.tyre.radius**2)


def _tyre_stiffness(vehicle: Vehicle) -> float:
    """Roll stiffness of the tyres of both axles, N·m/rad."""
    geometry = vehicle.geometry
    tracks = geometry.half_track_front**2 + geometry.half_track_rear**2
    return 2 * vehicle.tyre.vertical_stiffness * tracks


def _over_springs(vehicle: Vehicle) -> float:
    """Roll stiffness of springs and bars over that of the springs alone.

    The tyres are in series; the load's tilt on them, a few per cent, is left out.
    """
    tracks = vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear
    springs = sum(2 * _rate(vehicle, axle) * tracks[axle] ** 2 for axle in (0, 1))
    stiffness, tyres = vehicle.plant.roll_stiffness, _tyre_stiffness(vehicle)
    if stiffness >= tyres:
        raise ValueError("tyres softer than the car")  # reported where the springs are separated
    return 1 / (1 / stiffness - 1 / tyres) / springs


GILLESPIE = "Gillespie, Fundamentals of Vehicle Dynamics, ride and suspension chapters"
CLASS = "from a kei car to a 40 t truck"
BANDS = (
    Band("plant.sprung_mass", "it", "kg", 300, 40e3, lambda v: v.plant.sprung_mass, CLASS),
    *(
        Band(f"geometry.{key}", "it", "m", low, high, value, CLASS)
        for key, low, high, value in (
            ("cg_to_front_axle", 0.4, 6.0, lambda v: v.geometry.cg_to_front_axle),
            ("cg_to_rear_axle", 0.4, 6.0, lambda v: v.geometry.cg_to_rear_axle),
            ("half_track_front", 0.4, 1.3, lambda v: v.geometry.half_track_front),
            ("half_track_rear", 0.4, 1.3, lambda v: v.geometry.half_track_rear),
        )
    ),
    Band("tyre.radius", "it", "m", 0.2, 0.7, lambda v: v.tyre.radius, CLASS),
    Band(
        "tyre.friction", "it", "", 0.1, 2.5, lambda v: v.tyre.friction, "from ice to racing slicks"
    ),
    Band("steering.ratio", "it", "", 5, 40, lambda v: v.steering.ratio, CLASS),
    *(
        Band(
            f"suspension.spring_rate_{axle}",
            "a ride frequency",
            "Hz",
            0.5,
            4.0,
            ride_frequency(i),
            f"{GILLESPIE}: soft van to race car",
        )
        for i, axle in enumerate(("front", "rear"))
    ),
    *(
        Band(
            f"tyre.cornering_stiffness_{axle}",
            "a cornering coefficient C/F_z",
            "1/rad",
            5,
            40,
            cornering_coefficient(i),
            "Pacejka, Tire and Vehicle Dynamics: truck tyre to racing tyre",
        )
        for i, axle in enumerate(("front", "rear"))
    ),
    Band(
        "tyre.vertical_stiffness",
        "a deflection over radius",
        "",
        0.01,
        0.2,
        _deflection,
        "rated deflection of tyres at their load",
    ),
    *(
        Band(f"mass.unsprung_{axle}", "a wheel hop", "Hz", 6, 20, _hop(i), GILLESPIE)
        for i, axle in enumerate(("front", "rear"))
    ),
    Band(
        "tyre.wheel_inertia",
        "a share of unsprung mass times radius²",
        "",
        0.01,
        1.0,
        _gyration,
        "no wheel's radius of gyration exceeds its radius",
    ),
    Band(
        "plant.roll_stiffness",
        "a roll gradient",
        "deg/g",
        0.5,
        20,
        lambda v: v.plant.roll_gradient_deg_per_g,
        f"{GILLESPIE}: race car to soft van",
    ),
    Band(
        "plant.roll_stiffness",
        "a roll stiffness of springs and bars over that of the springs alone",
        "",
        0.75,
        5,
        _over_springs,
        f"{GILLESPIE}: without bars to a race car's, less a fifth for variation",
    ),
    Band(
        "plant.roll_damping",
        "a roll damping ratio",
        "",
        0.03,
        2.0,
        lambda v: v.plant.damping_ratio,
        f"{GILLESPIE}: worn truck to sports car",
    ),
    Band(
        "tyre.cornering_stiffness_rear",
        "an understeer gradient",
        "deg/g",
        -3,
        10,
        _understeer,
        f"{GILLESPIE}: handling chapter",
    ),
    Band(
        "plant.cg_height_above_roll_axis",
        "a half track over the height of the CG above the road",
        "",
        0.3,
        3.0,
        lambda v: v.static_stability_factor,
        "static stability factor: tank truck to formula car; NHTSA has 1.0 to 1.6 of cars",
    ),
)
"""Derived quantities in the order of their check: what others depend on comes first."""

KEYS = tuple(dict.fromkeys(band.key for band in BANDS))
"""Keys that have a band."""


def outside(vehicle: Vehicle) -> set[str]:
    """Keys of the numbers outside their band: those that a file's ``unusual`` takes as meant."""
    return {
        band.key
        for band in BANDS
        if (value := _value(band, vehicle)) is not None and not band.low <= value <= band.high
    }


def implausible(vehicle: Vehicle, unusual: Collection[str] = ()) -> Iterator[str]:
    """Numbers outside their band, one line each; empty for a plausible vehicle.

    Args:
        vehicle: of positive numbers.
        unusual: keys that are not checked.
    """
    for band in BANDS:
        if band.key in unusual:
            continue
        value = _value(band, vehicle)
        if value is None or band.low <= value <= band.high:
            continue
        number = _number(vehicle, band.key)
        derived = "" if band.quantity == "it" else f"gives {band.quantity} of "
        unit = f" {band.unit}" if band.unit else ""
        shown = f"{derived}{value:.3g}{unit}" if derived else "is implausible"
        yield (
            f"{band.key} = {number:g} {shown} ({band.low:g} to {band.high:g}{unit})"
            f"{_slip(band, vehicle, number)}; if it is meant: unusual = ['{band.key}']"
        )


def _value(band: Band, vehicle: Vehicle) -> float | None:
    """Return the quantity, or None where the vehicle is impossible, which other checks report."""
    try:
        return band.value(vehicle)
    except (ValueError, ZeroDivisionError):
        return None


def _slip(band: Band, vehicle: Vehicle, number: float) -> str:
    of_key: tuple[tuple[float, str], ...] = ()
    if "half_track" in band.key:
        of_key = ((0.5, "the full track"),)
    elif band.key == "plant.roll_stiffness":
        tyres = _tyre_stiffness(vehicle)
        of_key = ((tyres / (tyres + number), "springs and bars without the tyres in series"),)
    for factor, name in (*of_key, *SLIPS):
        corrected = _value(band, _with(vehicle, band.key, factor * number))
        if corrected is not None and band.low <= corrected <= band.high:
            return f": {name}? Then write {factor * number:.6g}"
    is_ratio = band.key.endswith("ratio") and number
    inverse = _value(band, _with(vehicle, band.key, 1 / number)) if is_ratio else None
    if inverse is not None and band.low <= inverse <= band.high:
        return f": inverted? Then write {1 / number:.6g}"
    return ""


def _number(vehicle: Vehicle, key: str) -> float:
    section, name = key.split(".")
    return float(getattr(getattr(vehicle, section), name))


def _with(vehicle: Vehicle, key: str, number: float) -> Vehicle:
    section, name = key.split(".")
    changed: dict[str, Any] = {section: replace(getattr(vehicle, section), **{name: number})}
    return replace(vehicle, **changed)
