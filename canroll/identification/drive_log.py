"""The signals of a measured drive: CSV, MF4, or a bus log with its description, in SI units.

Columns of a CSV and channels of an MF4 are found by name, with the unit as a suffix of the name or
as the file states it; those of a bus log by the map of its signals to the ECU's fields.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.typing import Vector
from codegen.frame import units
from codegen.generated import bus_map
from dbc.reader import network
from plant_sim.bodies.ports import AXLES, WHEELS
from plant_sim.driving import signal_file


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity of a drive: its label, kind of unit, SI unit, and names in logs and maps."""

    label: str
    kind: str
    unit: str
    names: tuple[str, ...]
    field: str = ""


QUANTITIES = {
    "steering": Quantity(
        "steering-wheel angle",
        "angle",
        "rad",
        ("steering", "steering_wheel", "steering_wheel_angle"),
        "steering",
    ),
    "speed": Quantity("speed", "speed", "m/s", ("speed", "vehicle_speed", "vx"), "speed"),
    "yaw_rate": Quantity("yaw rate", "rate", "rad/s", ("yaw_rate",), "yaw_rate"),
    "lateral_acceleration": Quantity(
        "lateral acceleration",
        "acceleration",
        "m/s²",
        ("lateral_acceleration", "ay"),
        "lateral_acceleration",
    ),
    "roll_rate": Quantity("roll rate", "rate", "rad/s", ("roll_rate",), "roll_rate"),
    "roll": Quantity("roll", "angle", "rad", ("roll", "roll_angle")),
    "sideslip": Quantity(
        "sideslip of the CG", "angle", "rad", ("sideslip", "sideslip_angle", "beta")
    ),
    **{
        f"travel_{wheel}": Quantity(
            f"travel {wheel.replace('_', ' ')}", "length", "m", (f"travel_{wheel}",)
        )
        for wheel in WHEELS
    },
    **{
        f"delivered_{axle}": Quantity(
            f"delivered moment, {axle}",
            "moment",
            "N·m",
            (f"delivered_{axle}", f"delivered_moment_{axle}", f"moment_{axle}"),
            f"delivered[{k}]",
        )
        for k, axle in enumerate(AXLES)
    },
    **{
        f"commanded_{axle}": Quantity(
            f"commanded moment, {axle}",
            "moment",
            "N·m",
            (f"commanded_{axle}", f"commanded_moment_{axle}"),
            f"bar[{k}]",
        )
        for k, axle in enumerate(AXLES)
    },
    **{
        f"commanded_force_{wheel}": Quantity(
            f"commanded force, {wheel.replace('_', ' ')}",
            "force",
            "N",
            (f"commanded_force_{wheel}",),
            f"force[{k}]",
        )
        for k, wheel in enumerate(WHEELS)
    },
}
"""What a log may have, by name."""
REQUIRED = INPUTS = ("steering", "speed")
"""What drives the car: a log must have it."""
MOTION = ("yaw_rate", "lateral_acceleration", "roll_rate")
"""What is compared of most logs: what of it is missing is remarked."""
DELIVERED = tuple(f"delivered_{axle}" for axle in AXLES)
COMMANDED = tuple(f"commanded_{axle}" for axle in AXLES)
FORCES = tuple(f"commanded_force_{wheel}" for wheel in WHEELS)
"""Moments on the body by axle, > 0 lifts the left side, and forces on it, > 0 upwards."""
OUTPUTS = tuple(
    name for name in QUANTITIES if name not in (*INPUTS, *DELIVERED, *COMMANDED, *FORCES)
)
"""What is compared; a log must have one of them."""

_SUFFIXES = {
    "deg": "deg",
    "rad": "rad",
    "deg_s": "deg/s",
    "rad_s": "rad/s",
    "m_s": "m/s",
    "kmh": "km/h",
    "km_h": "km/h",
    "mph": "mph",
    "m_s2": "m/s2",
    "g": "g",
    "m": "m",
    "mm": "mm",
    "nm": "Nm",
    "n_m": "Nm",
    "knm": "kNm",
    "kn": "kN",
}
_TIMES = ("time", "time_s", "t", "timestamp", "timestamps")


@dataclass(frozen=True, slots=True)
class SignalChoice:
    """Which signal of a log is a quantity: its name, unit ("": as stated), and a further factor."""

    name: str
    unit: str = ""
    factor: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """A measured quantity: values in SI units at times (s), in the order of the file.

    ``choice`` is the signal of the file that it was read as.
    """

    choice: SignalChoice
    times: Vector
    values: Vector

    @property
    def source(self) -> str:
        """Name of the signal in the file."""
        return self.choice.name


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A measured drive: its channels by the names of :data:`QUANTITIES`, and what was left out."""

    name: str
    channels: Mapping[str, Channel]
    remarks: tuple[str, ...] = ()


def choice_of(text: str) -> tuple[str, SignalChoice]:
    """Return quantity and choice of "QUANTITY=[-]NAME[:UNIT]".

    Raises:
        UnknownNameError: no such quantity.
        CanrollError: another form, or an unknown unit.
    """
    quantity, equals, name = text.partition("=")
    if not equals or not name.strip("-"):
        raise CanrollError(f"--signal {text}: expected QUANTITY=NAME, such as yaw_rate=YawRate")
    if quantity not in QUANTITIES:
        raise UnknownNameError("quantity of a log", quantity, QUANTITIES)
    name, _, unit = name.partition(":")
    sign = -1.0 if name.startswith("-") else 1.0
    if unit:
        _factor(f"--signal {text}", QUANTITIES[quantity], unit)
    return quantity, SignalChoice(name.removeprefix("-"), unit, sign)


def read(
    file: str,
    choices: Mapping[str, SignalChoice],
    *,
    dbc: str = "",
    map_file: str = "",
) -> Log:
    """Read a measured drive.

    Args:
        file: the log; one channel of several in a bus log is ``file#channel``.
        choices: which signals to take for quantities, over what the names say.
        dbc: network description of a bus log; "": the file is none.
        map_file: map of its signals to the ECU's fields.

    Raises:
        CanrollError: the file cannot be read, a required quantity is missing, or a unit cannot be
            that of its quantity.
    """
    if signal_file.is_csv(file, dbc):
        return _of_csv(Path(file), choices)
    known = dict(choices)
    if map_file:
        mapped = _mapped(Path(dbc), Path(map_file))
        own = {name: one for name, one in mapped.items() if name not in known}
        known |= {name: one.choice for name, one in own.items() if name in REQUIRED}
        # a log may be without the frames of what it need not have
        needed = [choice.name for choice in known.values()]
        others = [one.choice.name for name, one in own.items() if name not in REQUIRED]
        there = signal_file.carried(file, needed, others, dbc)
        for name, one in own.items():
            if name in REQUIRED or one.choice.name in there:
                known[name] = one.choice
                if one.refusal:
                    raise CanrollError(f"{map_file}: {one.refusal}")
    elif not dbc:
        there = signal_file.channels(file)
        for name, quantity in QUANTITIES.items():
            for candidate in () if name in known else quantity.names:
                if candidate in there:
                    known[name] = SignalChoice(candidate)
                    break
    _complete(file, known, "--signal QUANTITY=NAME")
    signals = signal_file.read(file, [choice.name for choice in known.values()], dbc)
    channels = {}
    for (name, choice), signal in zip(known.items(), signals, strict=True):
        unit = choice.unit or signal.unit
        factor = choice.factor * _factor(f"{file}: {signal.name}", QUANTITIES[name], unit)
        channels[name] = Channel(choice, signal.times, factor * signal.values)
    return Log(file, channels, tuple(dict.fromkeys(text for s in signals for text in s.remarks)))


class _Mapped(NamedTuple):
    """The signal of a quantity by a map, and why a log cannot be read by it, "" if it can."""

    choice: SignalChoice
    refusal: str


def _mapped(dbc: Path, map_file: Path) -> dict[str, _Mapped]:
    """Return the signals that a map takes for fields of the ECU that are quantities."""
    of_field = {quantity.field: name for name, quantity in QUANTITIES.items() if quantity.field}
    database = network(dbc).database
    choices = {}
    bus = bus_map.load(dbc, map_file)
    for box in (*bus.received, *bus.transmitted):
        for signal in box.signals:
            name = of_field.get(signal.place.text)
            if name is None:
                continue
            described = database.get_message_by_name(box.name).get_signal_by_name(signal.name)
            factor = signal.scale / 2**signal.place.q / Fraction(described.scale)
            shifted = factor * Fraction(described.offset) != signal.offset / 2**signal.place.q
            refusal = ""
            if shifted or signal.minus is not None or signal.added:
                refusal = (
                    f"{signal.name}: a log is read with the signs and offsets of {dbc}, without "
                    f"sums: name the signal by --signal {name}=NAME:UNIT"
                )
            unit = QUANTITIES[name].unit
            choice = SignalChoice(f"{box.name}.{signal.name}", unit, float(factor))
            choices[name] = _Mapped(choice, refusal)
    return choices


def _of_csv(path: Path, choices: Mapping[str, SignalChoice]) -> Log:
    """Read a CSV whose times may repeat or jump: they are judged later."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            header, *rows = [row for row in csv.reader(file) if row] or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CanrollError(f"cannot read {path}: {reason(error)}") from error
    header = [name.strip() for name in header]
    for i, row in enumerate(rows):
        # a decimal comma would move what follows it to other columns
        if any(row[len(header) :]):
            raise CanrollError(f"{path}: row {i + 2}: {len(row)} values in {len(header)} columns")
    time = next((name for name in header if name.lower() in _TIMES), None)
    if time is None:
        raise CanrollError(f"{path}: line 1: no column {' or '.join(_TIMES[:2])}")
    known = dict(choices)
    for name in header:
        quantity, unit = _recognised(name)
        if quantity:
            known.setdefault(quantity, SignalChoice(name, unit))
    _complete(str(path), known, "--signal QUANTITY=COLUMN:UNIT", header)
    times = _numbers(path, rows, header, time)
    channels, remarks = {}, []
    for name, choice in known.items():
        if choice.name not in header:
            raise UnknownNameError(f"column of {path}", choice.name, header)
        # a column with its unit in its name needs none in the option
        unit = choice.unit or _recognised(choice.name)[1] or _suffix(choice.name)
        factor = choice.factor * _factor(f"{path}: {choice.name}", QUANTITIES[name], unit)
        values = factor * _numbers(path, rows, header, choice.name)
        kept = np.isfinite(values) & np.isfinite(times)
        if not kept.all():
            remarks.append(f"{choice.name}: {np.sum(~kept)} rows without a number: left out")
        channels[name] = Channel(choice, times[kept], values[kept])
    return Log(str(path), channels, tuple(remarks))


def _numbers(path: Path, rows: Sequence[Sequence[str]], header: list[str], name: str) -> Vector:
    place = header.index(name)
    values = np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        text = row[place].strip() if place < len(row) else ""
        try:
            values[i] = float(text) if text else np.nan
        except ValueError as error:
            raise CanrollError(f"{path}: row {i + 2}: {name}: '{text}' is no number") from error
    if np.sum(np.isfinite(values)) < 2:
        raise CanrollError(f"{path}: column {name} has fewer than two numbers")
    return values


def _recognised(column: str) -> tuple[str, str]:
    """Return quantity and unit that a column's name says, "" if it says none."""
    for name, quantity in QUANTITIES.items():
        for known in quantity.names:
            if column.lower() == known:
                return name, ""
            suffix = column.lower().removeprefix(f"{known}_")
            if suffix in _SUFFIXES and suffix != column.lower():
                return name, _SUFFIXES[suffix]
    return "", ""


def _suffix(column: str) -> str:
    match = re.search("_(" + "|".join(sorted(_SUFFIXES, key=len, reverse=True)) + ")$", column)
    return _SUFFIXES[match.group(1)] if match else ""


def _complete(
    file: str, known: Mapping[str, SignalChoice], option: str, names: Sequence[str] = ()
) -> None:
    missing = [QUANTITIES[name].label for name in REQUIRED if name not in known]
    if not missing and not set(OUTPUTS) & set(known):
        missing = [QUANTITIES[name].label for name in MOTION]
    if missing:
        there = f"; it has {', '.join(names)}" if names else ""
        raise CanrollError(f"{file}: no {', no '.join(missing)}: name it by {option}{there}")


def _factor(where: str, quantity: Quantity, unit: str) -> float:
    """Return the factor of a unit to the SI unit of a quantity; without one it is that unit."""
    if not unit:
        return 1.0
    known = units.UNITS.get(units.normal(unit) or "")
    if known is None or known.quantity != quantity.kind:
        raise CanrollError(f"{where}: {quantity.label} in '{unit}': its unit is as {quantity.unit}")
    return float(known.factor)
