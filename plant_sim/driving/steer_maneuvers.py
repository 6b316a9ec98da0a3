"""Manoeuvres of a steering robot: fishhook, J-turn, sine with dwell, and signals from files.

The robots of FMVSS 126 and of NHTSA's rollover tests scale their steering by the angle at which
the car corners at 0.3 g at 80 km/h; here that is the linear car's.
"""

import csv
from math import inf, pi, radians
from pathlib import Path

import numpy as np

from canroll.errors import CanrollError, reason
from canroll.typing import Vector
from plant_sim.driving.drive import Kind, Plan, steady_steer
from plant_sim.driving.driver import ACCELERATION_TABLE, FISHHOOK, STEER_TABLE
from vehicles import GRAVITY, Vehicle

START = 0.5
"""Straight running before the steering begins (s)."""

TABLE_STEP = 1e-3
REFERENCE_SPEED = 80 / 3.6
REFERENCE_ACCELERATION = 0.3 * GRAVITY


def reference_angle(vehicle: Vehicle) -> float:
    """Road-wheel angle (rad) for 0.3 g at 80 km/h, the A of FMVSS 126 and of the fishhook."""
    return steady_steer(vehicle, REFERENCE_SPEED, REFERENCE_ACCELERATION)


def _amplitude(vehicle: Vehicle, scale: float) -> float:
    return min(scale * reference_angle(vehicle), vehicle.steering.angle_limit)


def fishhook(vehicle: Vehicle, _speed: float, _seed: int, *, scale: float = 6.5) -> Plan:
    """NHTSA's roll-rate feedback fishhook: 720 degrees/s at the steering wheel, 3 s held."""
    return Plan(
        8.0,
        kind=FISHHOOK,
        release_time=START,
        steer_rate=radians(720.0) / vehicle.steering.ratio,
        fishhook=(START, _amplitude(vehicle, scale), 3.0, 2.0),
    )


def j_turn(vehicle: Vehicle, _speed: float, _seed: int, *, scale: float = 8.0) -> Plan:
    """NHTSA's J-turn: one ramp at 1000 degrees/s at the steering wheel, held 4 s, back in 2 s."""
    rate = radians(1000.0) / vehicle.steering.ratio
    amplitude = _amplitude(vehicle, scale)
    rise = amplitude / rate
    knots = np.array([0.0, START, START + rise, START + rise + 4.0, START + rise + 6.0])
    time = np.arange(0.0, knots[-1] + 1.0, TABLE_STEP)
    return Plan(
        float(time[-1]),
        kind=STEER_TABLE,
        table=np.interp(time, knots, [0.0, 0.0, amplitude, amplitude, 0.0]),
        table_step=TABLE_STEP,
        release_time=START,
        steer_rate=2 * rate,
    )


def sine_with_dwell_table(amplitude: float) -> Vector:
    """0.7 Hz sine whose second peak is held for 500 ms (FMVSS 126, S7.9), at 1 ms steps."""
    frequency, dwell = 0.7, 0.5
    time = np.arange(0.0, START + 1 / frequency + dwell + 3.0, TABLE_STEP) - START
    peak = 0.75 / frequency
    phase = np.where(time < peak, time, np.maximum(time - dwell, peak))
    steer = np.sin(2 * pi * frequency * phase)
    return amplitude * np.where((time < 0) | (time > 1 / frequency + dwell), 0.0, steer)


def sine_with_dwell(vehicle: Vehicle, _speed: float, _seed: int, *, scale: float = 5.0) -> Plan:
    """FMVSS 126 sine with dwell at ``scale`` times the angle for 0.3 g, accelerator released."""
    table = sine_with_dwell_table(_amplitude(vehicle, scale))
    return Plan(
        table.size * TABLE_STEP,
        kind=STEER_TABLE,
        table=table,
        table_step=TABLE_STEP,
        release_time=START,
        steer_rate=inf,
    )


CSV_COLUMNS = {"steering_wheel_deg": STEER_TABLE, "lateral_acceleration": ACCELERATION_TABLE}
"""Second column of a signal file, and the input it sets."""


def read_signal(path: Path) -> tuple[str, Vector, Vector]:
    """Column name, times (s) and values of a file with the columns ``time`` and one other.

    Raises:
        CanrollError: the file cannot be read, its header is wrong, a field is not a number, or
        times
            do not increase.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError) as error:
        raise CanrollError(f"cannot read signal file {path}: {reason(error)}") from error
    header = [name.strip() for name in rows[0]] if rows else []
    if len(header) != 2 or header[0] != "time" or header[1] not in CSV_COLUMNS:
        known = " or ".join(f"'time,{name}'" for name in CSV_COLUMNS)
        raise CanrollError(f"{path}: line 1: the header must be {known}")
    numbers: list[tuple[float, float]] = []
    for line, row in enumerate(rows[1:], start=2):
        try:
            time, value = (float(field) for field in row)
        except ValueError as error:
            raise CanrollError(f"{path}: line {line}: expected two numbers, got {row}") from error
        if not np.isfinite([time, value]).all():
            raise CanrollError(f"{path}: line {line}: not a finite number")
        if numbers and time <= numbers[-1][0]:
            raise CanrollError(f"{path}: line {line}: time must increase")
        numbers.append((time, value))
    if len(numbers) < 2:
        raise CanrollError(f"{path}: at least two rows of numbers are required")
    times, values = np.array(numbers).T
    return header[1], times - times[0], values


def from_file(vehicle: Vehicle, _speed: float, _seed: int, *, file: str = "") -> Plan:
    """Steering-wheel angle (degrees) or lateral acceleration (m/s²) over time, from a CSV file."""
    if not file:
        raise CanrollError("manoeuvre 'from_file' needs a file: columns time, and the signal")
    column, times, values = read_signal(Path(file))
    kind = CSV_COLUMNS[column]
    table = np.interp(np.arange(0.0, times[-1] + TABLE_STEP / 2, TABLE_STEP), times, values)
    if kind == STEER_TABLE:
        table = np.radians(table) / vehicle.steering.ratio
    return Plan(float(times[-1]), kind=kind, table=table, table_step=TABLE_STEP, steer_rate=inf)


NHTSA_FISHHOOK = Kind("fishhook", 80.0, 120.0, "NHTSA roll-rate feedback fishhook", fishhook)
"""Fishhook with roll-rate feedback, NHTSA."""
J_TURN = Kind("J-turn", 80.0, 120.0, "NHTSA J-turn", j_turn)
"""J-turn, NHTSA."""
SINE_WITH_DWELL = Kind("sine with dwell", 80.0, 120.0, "FMVSS 126", sine_with_dwell)
"""Sine with dwell, FMVSS 126."""
FROM_FILE = Kind("signal of a file", 80.0, 200.0, "none", from_file)
"""Steering or lateral acceleration from a file."""
