"""The manoeuvre of a measurement: steering or lateral acceleration, and speed, over time."""

from math import inf

import numpy as np

from canroll.codegen.frame import units
from canroll.errors import CanrollError
from canroll.plant_sim.driving import signal_file
from canroll.plant_sim.driving.drive import ManeuverKind, ManeuverPlan
from canroll.plant_sim.driving.driver import ACCELERATION_TABLE, STEER_TABLE
from canroll.plant_sim.driving.signal_file import Signal
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.typing import Vector
from canroll.vehicles import Vehicle

STEP = STEP_NS * 1e-9
"""Time between two values of the tables (s)."""
LONGEST = 36_000.0
"""Longest manoeuvre (s): its tables are kept in memory."""

CSV_COLUMNS = ("steering_wheel_deg", "lateral_acceleration")
"""Columns of a CSV of which one is the input if the user names none."""
CSV_SPEED = "speed_kmh"
"""Column of a CSV that is the speed if it is there and the user names none."""
NO_SPEED = "none"
"""Name of a speed column that stands for a constant speed."""

INPUT_KINDS = {"angle": STEER_TABLE, "acceleration": ACCELERATION_TABLE}
"""Quantities that can be the input."""
QUANTITIES = {"unit": tuple(INPUT_KINDS), "speed_unit": ("speed",)}
KNOWN_UNITS = {"unit": "deg, rad, m/s2", "speed_unit": "km/h, m/s, mph"}
"""Quantities that a unit of the user may have, by option, and units to be named."""


def from_file(
    vehicle: Vehicle,
    _speed: float,
    _seed: int,
    *,
    file: str = "",
    dbc: str = "",
    column: str = "",
    unit: str = "",
    speed_column: str = "",
    speed_unit: str = "",
) -> ManeuverPlan:
    """Steering-wheel angle or lateral acceleration over time, and speed if the file has one.

    ``column`` and ``speed_column`` are names as in
    :func:`canroll.plant_sim.driving.signal_file.read`; units are those of the file unless given.
    The manoeuvre lasts while both signals are there.

    Raises:
        CanrollError: invalid file, names or units.
    """
    if not file:
        raise CanrollError(
            "manoeuvre 'from_file' needs --set file=FILE.csv with the columns time and one of "
            f"{', '.join(CSV_COLUMNS)}; or --set file=FILE --set column=NAME of a CSV, of an MF4, "
            "or of a bus log with --set dbc=FILE"
        )
    for name, given, of in (("unit", unit, column), ("speed_unit", speed_unit, speed_column)):
        if given and not of:
            raise CanrollError(
                f"manoeuvre 'from_file': --set {name}={given} needs --set "
                f"{name.replace('unit', 'column')}=NAME"
            )
    names = _names(file, dbc, column, speed_column)
    steering, *speeds = signal_file.read(file, names, dbc)
    quantity, factor = _in_base_unit(file, steering, unit, "unit")
    begin = max(float(signal.times[0]) for signal in (steering, *speeds))
    duration = min(float(signal.times[-1]) for signal in (steering, *speeds)) - begin
    if duration < STEP:
        raise CanrollError(f"{file}: {' and '.join(names)} have no time in common")
    if duration > LONGEST:
        raise CanrollError(f"{file}: {duration:g} s, at most {LONGEST:g}: is its time in s?")
    at = np.arange(0.0, duration + STEP / 2, STEP)
    table = factor * _sampled(steering, begin, at)
    if quantity == "angle":
        table = table / vehicle.steering.ratio
    speed = None
    for signal in speeds:
        _, factor = _in_base_unit(file, signal, speed_unit, "speed_unit")
        speed = factor * _sampled(signal, begin, at)
    return ManeuverPlan(
        duration,
        kind=INPUT_KINDS[quantity],
        table=table,
        table_step=STEP,
        speed=speed,
        steer_rate=inf,
        remarks=tuple(dict.fromkeys(text for s in (steering, *speeds) for text in s.remarks)),
    )


def _names(file: str, dbc: str, column: str, speed_column: str) -> tuple[str, ...]:
    """Return the name of the input, and that of the speed, if any."""
    is_csv = signal_file.is_csv(file, dbc)
    header = signal_file.columns(file) if is_csv else ()
    if not column and not is_csv:
        raise CanrollError(f"{file}: --set column=NAME says which signal of it is the steering")
    if not column:
        present = [name for name in CSV_COLUMNS if name in header]
        if len(present) != 1:
            raise CanrollError(
                f"{file}: line 1: the header must name the columns time and "
                f"{' or '.join(CSV_COLUMNS)} once; another column is named by --set column=NAME "
                f"--set unit=UNIT ({KNOWN_UNITS['unit']}); it has {', '.join(header) or 'none'}"
            )
        column = present[0]
    if not speed_column and CSV_SPEED in header:
        speed_column = CSV_SPEED
    return (column, speed_column) if speed_column not in ("", NO_SPEED) else (column,)


def _in_base_unit(file: str, signal: Signal, given: str, option: str) -> tuple[str, float]:
    """Return the quantity of a signal and the factor to its base unit; "": as the file states."""
    stated = given or signal.unit
    known = units.UNITS[units.normal(stated) or ""]
    if known.quantity not in QUANTITIES[option]:
        what = f"in '{stated}'" if stated else "without a unit"
        raise CanrollError(
            f"{file}: {signal.name} {what}: it needs --set {option}={KNOWN_UNITS[option]}"
        )
    return known.quantity, float(known.factor)


def _sampled(signal: Signal, begin: float, at: Vector) -> Vector:
    return np.interp(at, signal.times - begin, signal.values)


FROM_FILE = ManeuverKind("signal of a file", 80.0, 200.0, "none", from_file)
"""Steering or lateral acceleration, and speed, from a file."""
