"""What the tables of an axle say, as sections ``[axles.front]`` and ``[axles.rear]``.

Compression of a wheel is its way up against the body, 0 where the kinematics were measured from:
where the vehicle of the file stands at rest, unless the spring's ``installed`` says otherwise.
Toe is positive inwards, camber with the top outwards, ``side`` the way of the contact patch
outwards. The road's side force counts towards the middle of the car, as on the outer wheel of a
curve; its aligning moment counts towards toe-in. Forces of springs and dampers resist compression.
Angles of the steering are those of the left wheel, positive to the left; the right wheel is its
mirror image.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from math import degrees
from pathlib import Path
from typing import Any, NamedTuple

from canroll.errors import CanrollError, UnknownNameError
from canroll.vehicles.suspensions.columns import Columns, inline, read
from canroll.vehicles.suspensions.curve import Curve, rises

SECTION = "axles"
AXLES = ("front", "rear")


class TableKind(NamedTuple):
    """One table: its column x, and the curve that each other column is; units by column."""

    x: str
    curves: Mapping[str, str]
    units: Mapping[str, str]


KINDS = {
    "spring": TableKind("compression", {"force": "spring"}, {"compression": "m", "force": "N"}),
    "damper": TableKind(
        "compression_speed", {"force": "damper"}, {"compression_speed": "m/s", "force": "N"}
    ),
    "stops": TableKind("compression", {"force": "stops"}, {"compression": "m", "force": "N"}),
    "kinematics": TableKind(
        "compression",
        {key: key for key in ("toe", "camber", "side", "spring_ratio", "damper_ratio")},
        {
            **{"compression": "m", "toe": "rad", "camber": "rad", "side": "m"},
            **{"spring_ratio": "", "damper_ratio": ""},
        },
    ),
    "side_force": TableKind(
        "side_force",
        {"toe": "toe_by_force", "camber": "camber_by_force"},
        {"side_force": "N", "toe": "rad", "camber": "rad"},
    ),
    "aligning_moment": TableKind(
        "aligning_moment",
        {"toe": "toe_by_moment", "camber": "camber_by_moment"},
        {"aligning_moment": "N·m", "toe": "rad", "camber": "rad"},
    ),
    "steering": TableKind(
        "steering_wheel",
        {"road_wheel": "steering"},
        {"steering_wheel": "rad", "road_wheel": "rad"},
    ),
}
"""Tables of an axle by their keys."""
TOE = ("toe", "toe_by_force", "toe_by_moment")
CAMBER = ("camber", "camber_by_force", "camber_by_moment")
"""Curves whose sum is the toe or the camber of a wheel."""
OF_FRONT = ("steering", "steering_system")
"""Keys that only the axle that is steered has."""
INSTALLED = "installed"
"""Key of the spring's compression (m) at compression 0 of the wheel."""
RANGES = {
    "compression": (1.0, "is it in mm? Write compression [mm]"),
    "compression_speed": (20.0, "is it in mm/s? Write compression_speed [mm/s]"),
    "toe": (0.6, "is it in degrees? Write toe [deg]"),
    "camber": (0.6, "is it in degrees? Write camber [deg]"),
    "side": (1.0, "is it in mm? Write side [mm]"),
    "force": (1e6, "is it in N?"),
    "side_force": (1e5, "is it in N?"),
    "aligning_moment": (1e4, "is it in N·m?"),
    "spring_ratio": (3.0, "it is the spring's way over that of the wheel"),
    "damper_ratio": (3.0, "it is the damper's way over that of the wheel"),
    "steering_wheel": (30.0, "is it in degrees? Write steering_wheel [deg]"),
    "road_wheel": (1.2, "is it in degrees? Write road_wheel [deg]"),
}
"""Largest number of a column in SI units, and what may be wrong beyond it."""
LONGEST_TRAIL = 0.5
"""Most caster trail (m) of a road vehicle."""


@dataclass(frozen=True, slots=True)
class Bar:
    """An anti-roll bar: torsional stiffness (N·m/rad), lever (m), way of its end over the wheel's.

    The stiffness is the torque over the angle between the two levers.
    """

    torsional_stiffness: float
    lever: float
    ratio: float

    @property
    def stiffness(self) -> float:
        """Force on a wheel (N) per difference of the wheels' compressions (m)."""
        return self.torsional_stiffness * (self.ratio / self.lever) ** 2


@dataclass(frozen=True, slots=True)
class SteeringSystem:
    """What the steering gives way to with its wheel held; both road wheels turn alike.

    Torsional stiffness (N·m/rad) is the moment about the kingpins of both wheels over their turn,
    ``caster_trail`` (m) the way of the contact patch behind the kingpin.
    """

    torsional_stiffness: float
    caster_trail: float


RECORDS: dict[str, type[Any]] = {"bar": Bar, "steering_system": SteeringSystem}
"""Numbers of an axle that are no tables, by their keys."""


@dataclass(frozen=True, slots=True)
class AxleTables:
    """Curves of an axle, SI units, None without a table.

    ``installed`` is the compression of the spring at compression 0 of the wheel.
    """

    spring: Curve | None = None
    damper: Curve | None = None
    stops: Curve | None = None
    toe: Curve | None = None
    camber: Curve | None = None
    side: Curve | None = None
    spring_ratio: Curve | None = None
    damper_ratio: Curve | None = None
    toe_by_force: Curve | None = None
    camber_by_force: Curve | None = None
    toe_by_moment: Curve | None = None
    camber_by_moment: Curve | None = None
    steering: Curve | None = None
    bar: Bar | None = None
    steering_system: SteeringSystem | None = None
    installed: float | None = None

    @property
    def has_attitudes(self) -> bool:
        """Whether toe or camber has a table."""
        return any(getattr(self, name) is not None for name in (*TOE, *CAMBER))

    @property
    def document(self) -> dict[str, Any]:
        """The section of a vehicle file."""
        table: dict[str, Any] = {}
        for key, kind in KINDS.items():
            for column, name in kind.curves.items():
                curve: Curve | None = getattr(self, name)
                if curve is not None:
                    part = table.setdefault(key, {_head(kind, kind.x): list(curve.x)})
                    part[_head(kind, column)] = list(curve.y)
        for key, kind_of in RECORDS.items():
            record = getattr(self, key)
            if record is not None:
                table[key] = {each.name: getattr(record, each.name) for each in fields(kind_of)}
        if self.installed is not None:
            table[INSTALLED] = self.installed
        return table


@dataclass(frozen=True, slots=True)
class VehicleTables:
    """The tables of both axles."""

    front: AxleTables = field(default_factory=AxleTables)
    rear: AxleTables = field(default_factory=AxleTables)

    @property
    def document(self) -> dict[str, Any]:
        """The section of a vehicle file."""
        both = {name: getattr(self, name).document for name in AXLES}
        return {name: table for name, table in both.items() if table}

    @property
    def has_attitudes(self) -> bool:
        """Whether an axle has a table of toe or camber."""
        return any(axle.has_attitudes for axle in self.both)

    @property
    def moves_wheels(self) -> bool:
        """Whether wheels turn or lean beside the driver's steering."""
        return self.has_attitudes or self.front.steering_system is not None

    @property
    def both(self) -> tuple[AxleTables, AxleTables]:
        """Front and rear."""
        return self.front, self.rear


def _head(kind: TableKind, column: str) -> str:
    unit = kind.units[column]
    return f"{column} [{unit}]" if unit else column


def section(given: Any, where: str, folder: Path | None = None) -> VehicleTables:  # noqa: ANN401
    """Return the tables of a vehicle file's section ``axles``.

    Args:
        given: the section.
        where: begins every error message.
        folder: that paths of CSV files are relative to; None where there are none.

    Raises:
        CanrollError: a table that is none, or says what no axle does; the message has the file and
            its line, or the key.
    """
    if not isinstance(given, Mapping):
        raise CanrollError(f"{where}: '{SECTION}' must be a table")
    for name in given:
        if name not in AXLES:
            raise CanrollError(f"{where}: [{SECTION}] {UnknownNameError('axle', name, AXLES)}")
    return VehicleTables(
        **{
            name: _axle(table, f"{where}: {SECTION}.{name}", folder)
            for name, table in given.items()
        }
    )


def files_of(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Axle and name of each CSV file that a section names."""
    for name, table in given.items():
        if isinstance(table, Mapping):
            for key in KINDS:
                if isinstance(table.get(key), str):
                    yield name, table[key]


def _axle(given: Any, place: str, folder: Path | None) -> AxleTables:  # noqa: ANN401
    if not isinstance(given, Mapping):
        raise CanrollError(f"{place} must be a table")
    known = (*KINDS, *RECORDS, INSTALLED)
    curves: dict[str, Any] = {}
    for key, value in given.items():
        if key not in known:
            raise CanrollError(f"{place}: {UnknownNameError('key', key, known)}")
        if key in OF_FRONT and not place.endswith("front"):
            raise CanrollError(f"{place}.{key}: only the front axle is steered: remove it")
        if key in RECORDS:
            curves[key] = _record(key, value, f"{place}.{key}")
        elif key == INSTALLED:
            curves[INSTALLED] = _number(value, f"{place}.{INSTALLED}")
        else:
            curves |= _curves(KINDS[key], _columns(key, value, place, folder))
    for name in ("spring", "damper"):
        if f"{name}_ratio" in curves and name not in curves:
            raise CanrollError(f"{place}: {name}_ratio needs a table {name}")
    if INSTALLED in curves and "spring" not in curves:
        raise CanrollError(f"{place}: {INSTALLED} needs a table spring")
    return AxleTables(**curves)


def _columns(key: str, value: Any, place: str, folder: Path | None) -> Columns:  # noqa: ANN401
    kind = KINDS[key]
    if isinstance(value, Mapping):
        columns = inline(value, kind.units, f"{place}.{key}")
    elif isinstance(value, str) and folder is not None:
        columns = read(folder / value, kind.units)
    else:
        raise CanrollError(f"{place}.{key} must be the path of a CSV file or a table of lists")
    if kind.x not in columns.values:
        raise CanrollError(f"{columns.place}: column {kind.x} is missing")
    if len(columns.values) < 2:
        raise CanrollError(f"{columns.place}: no column but {kind.x}: {', '.join(kind.curves)}")
    return columns


def _curves(kind: TableKind, columns: Columns) -> dict[str, Curve]:
    """The curves of a table, checked."""
    x = columns.values[kind.x]
    for row in range(1, len(x)):
        if not x[row] > x[row - 1]:
            raise CanrollError(f"{columns.at(row)}: {kind.x} must increase from row to row")
    for column, values in columns.values.items():
        most, hint = RANGES[column]
        for row, value in enumerate(values):
            if abs(value) > most:
                raise CanrollError(f"{columns.at(row)}: {column} = {value:g}: {hint}")
            if column.endswith("_ratio") and not value > 0.0:
                raise CanrollError(f"{columns.at(row)}: {column} = {value:g}: must be positive")
    curves = {
        name: Curve(x, columns.values[column])
        for column, name in kind.curves.items()
        if column in columns.values
    }
    _check_forces(curves, columns)
    if "steering" in curves:
        _check_steering(curves["steering"], columns)
    return curves


def _check_forces(curves: Mapping[str, Curve], columns: Columns) -> None:
    if "spring" in curves and not rises(force := curves["spring"].y):
        row = next(row for row in range(1, len(force)) if not force[row] > force[row - 1])
        raise CanrollError(f"{columns.at(row)}: a spring's force must increase with compression")
    if "stops" in curves:
        force = curves["stops"].y
        for row in range(1, len(force)):
            if force[row] < force[row - 1]:
                raise CanrollError(f"{columns.at(row)}: a stop's force must not fall")
    if "damper" in curves:
        damper = curves["damper"]
        if not damper.x[0] < 0.0 < damper.x[-1]:
            raise CanrollError(
                f"{columns.place}: compression_speed must cover compression (> 0) and rebound (< 0)"
            )
        largest = max(map(abs, damper.y))
        for row, (speed, force_there) in enumerate(zip(damper.x, damper.y, strict=True)):
            if speed * force_there < 0.0:
                raise CanrollError(
                    f"{columns.at(row)}: force {force_there:g} N drives the damper at "
                    f"{speed:g} m/s: its sign must be that of compression_speed"
                )
        if abs(damper(0.0)) > 1e-9 * largest or not damper.slope(0.0) > 0.0:
            raise CanrollError(
                f"{columns.place}: force {damper(0.0):g} N at rest: subtract the gas force, and "
                "give the row 0, 0"
            )


def _check_steering(steering: Curve, columns: Columns) -> None:
    if not steering.x[0] < 0.0 < steering.x[-1]:
        raise CanrollError(f"{columns.place}: steering_wheel must cover left (> 0) and right (< 0)")
    angle = steering.y
    if not rises(angle):
        row = next(row for row in range(1, len(angle)) if not angle[row] > angle[row - 1])
        raise CanrollError(f"{columns.at(row)}: road_wheel must increase with steering_wheel")
    if abs(steering(0.0)) > 1e-9 * (angle[-1] - angle[0]):
        raise CanrollError(
            f"{columns.place}: road_wheel {degrees(steering(0.0)):g}° with the steering wheel "
            "straight: subtract it, as toe of kinematics, and give the row 0, 0"
        )


def _record(key: str, value: Any, place: str) -> Bar | SteeringSystem:  # noqa: ANN401
    kind = RECORDS[key]
    names = tuple(each.name for each in fields(kind))
    if not isinstance(value, Mapping) or set(value) != set(names):
        raise CanrollError(f"{place} must be a table of {', '.join(names)}")
    record: Bar | SteeringSystem = kind(
        **{name: _number(value[name], f"{place}.{name}") for name in names}
    )
    if isinstance(record, SteeringSystem):
        if not record.torsional_stiffness > 0.0:
            raise CanrollError(f"{place}: the stiffness must be positive")
        if abs(record.caster_trail) > LONGEST_TRAIL:
            raise CanrollError(f"{place}.caster_trail = {record.caster_trail:g}: is it in mm?")
    elif not (record.torsional_stiffness >= 0.0 and record.lever > 0.0 and record.ratio > 0.0):
        raise CanrollError(f"{place}: lever and ratio must be positive, the stiffness at least 0")
    return record


def _number(value: Any, place: str) -> float:  # noqa: ANN401
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CanrollError(f"{place} must be a number, not {value!r}")
    return float(value)
