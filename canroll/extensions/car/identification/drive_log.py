"""The signals of a measured drive: CSV, MF4, or a bus log with its description, in SI units.

Columns of a CSV and channels of an MF4 are found by name, with the unit as a suffix of the name or
as the file states it; those of a bus log by the map of its signals to the ECU's fields.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from canroll.codegen.frame import units
from canroll.codegen.generated import bus_map
from canroll.dbc.reader import network
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.bodies.ports import AXLES, WHEELS
from canroll.plant_sim.driving import signal_file
from canroll.plant_sim.driving.columns import TIME_UNITS, LogTable, parted, read_table
from canroll.typing import Vector


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
INPUTS = ("steering", "speed")
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

TIME = Quantity("time", "time", "s", ("time", "t", "timestamp", "timestamps"))
"""Not of a bus log or an MF4, whose signals have times of their own."""


@dataclass(frozen=True, slots=True)
class SignalChoice:
    """Which signal of a log is a quantity: its name, unit ("": as stated), and a further factor.

    The unit may have a factor: "16*rad", or "16*" of the unit that is stated.
    """

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
    """Return quantity and choice of "QUANTITY=[-]NAME[:UNIT]"; without a name it is left out.

    Raises:
        UnknownNameError: no such quantity.
        CanrollError: another form, or an unknown unit.
    """
    quantity, equals, name = text.partition("=")
    if not equals or (name and not name.strip("-")):
        raise CanrollError(f"--signal {text}: expected QUANTITY=NAME, such as yaw_rate=YawRate")
    if quantity not in _BY_NAME:
        raise UnknownNameError("quantity of a log", quantity, _BY_NAME)
    name, _, unit = name.partition(":")
    sign = -1.0 if name.startswith("-") else 1.0
    _factor(f"--signal {text}", _BY_NAME[quantity], unit)
    return quantity, SignalChoice(name.removeprefix("-"), unit, sign)


def read(
    file: str,
    choices: Mapping[str, SignalChoice],
    *,
    dbc: str = "",
    map_file: str = "",
    rate: float | None = None,
) -> Log:
    """Read a measured drive.

    Args:
        file: the log; one channel of several in a bus log is ``file#channel``.
        choices: which signals to take for quantities, over what the names say.
        dbc: network description of a bus log; "": the file is none.
        map_file: map of its signals to the ECU's fields.
        rate: samples per second of a CSV or .mat without times.

    Raises:
        CanrollError: the file cannot be read, a required quantity is missing, a unit cannot be
            that of its quantity, or a map is of no network.
    """
    if map_file and not dbc:
        raise CanrollError("--map: it belongs to --dbc: add that, or omit it")
    if signal_file.is_csv(file, dbc):
        return _of_table(read_table(Path(file)), choices, rate)
    if rate is not None or "time" in choices:
        option = "--signal time" if rate is None else "--rate"
        raise CanrollError(f"{file}: {option}: its signals have times of their own: omit it")
    known = dict(choices)
    if map_file:
        mapped = _mapped(Path(dbc), Path(map_file))
        own = {name: one for name, one in mapped.items() if name not in known}
        known |= {name: one.choice for name, one in own.items() if name in INPUTS}
        # a log may be without the frames of what it need not have
        needed = [choice.name for choice in known.values() if choice.name]
        others = [one.choice.name for name, one in own.items() if name not in INPUTS]
        there = signal_file.carried(file, needed, others, dbc)
        for name, one in own.items():
            if name in INPUTS or one.choice.name in there:
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
    known = {name: choice for name, choice in known.items() if choice.name}
    _complete(file, known, "--signal QUANTITY=NAME")
    signals = signal_file.read(file, [choice.name for choice in known.values()], dbc)
    channels = {}
    for (name, choice), signal in zip(known.items(), signals, strict=True):
        where = f"{file}: {signal.name}"
        factor = choice.factor * _factor(where, QUANTITIES[name], choice.unit, signal.unit)
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


def _of_table(table: LogTable, choices: Mapping[str, SignalChoice], rate: float | None) -> Log:
    """Read columns whose times may repeat or jump: they are judged later."""
    path = table.path
    known = {name: choice for name, choice in choices.items() if choice.name}
    for column in table.names:
        name = _recognised(column)
        if name and name not in choices:
            known.setdefault(name, SignalChoice(column))
    remarks = []
    if rate is not None:
        if not 0.0 < rate < np.inf:
            raise CanrollError(f"--rate {rate:g}: must be positive")
        if "time" in choices:
            raise CanrollError("--rate: --signal time has the times: omit one")
        if there := known.pop("time", None):
            remarks.append(f"times are those of --rate {rate:g}, not of the column {there.name}")
    elif "time" not in known:
        raise CanrollError(
            f"{table.where}: no column time or time_s: name it by --signal time=NAME:UNIT, or give "
            f"the samples per second, --rate HZ; it has {', '.join(table.names) or 'none'}"
        )
    _complete(str(path), known, "--signal QUANTITY=COLUMN:UNIT", table.names)
    columns = {name: _values(table, _BY_NAME[name], choice) for name, choice in known.items()}
    times = columns.pop("time") if rate is None else np.arange(len(columns["speed"])) / rate
    channels = {}
    for name, values in columns.items():
        choice = known[name]
        if len(values) != len(times):
            raise CanrollError(
                f"{path}: {choice.name} has {len(values)} numbers, its times are {len(times)}"
            )
        kept = np.isfinite(values) & np.isfinite(times)
        if not kept.all():
            remarks.append(f"{choice.name}: {np.sum(~kept)} rows without a number: left out")
        channels[name] = Channel(choice, times[kept], values[kept])
    return Log(str(path), channels, tuple(remarks))


def _values(table: LogTable, quantity: Quantity, choice: SignalChoice) -> Vector:
    """Return a column in SI units."""
    place = table.place(choice.name)
    column = table.names[place]
    where = f"{table.path}: {column}"
    factor = choice.factor * _factor(where, quantity, choice.unit, parted(column)[1])
    values = table.numbers(place)
    if np.sum(np.isfinite(values)) < 2:
        raise CanrollError(f"{table.path}: column {column} has fewer than two numbers")
    return factor * values


def _recognised(column: str) -> str:
    """Return the quantity that a column's name and unit say, "" if they say none."""
    for text, unit in ((column, ""), parted(column)):
        key = re.sub(r"[\s-]+", "_", text.lower())
        for name, quantity in _BY_NAME.items():
            if key in quantity.names and _unit_factor(quantity, unit) is not None:
                return name
    return ""


def _complete(
    file: str, known: Mapping[str, SignalChoice], option: str, names: Sequence[str] = ()
) -> None:
    missing = [QUANTITIES[name].label for name in INPUTS if name not in known]
    if not missing and not set(OUTPUTS) & set(known):
        missing = [QUANTITIES[name].label for name in MOTION]
    if missing:
        there = f"; it has {', '.join(names)}" if names else ""
        raise CanrollError(f"{file}: no {', no '.join(missing)}: name it by {option}{there}")


def _factor(where: str, quantity: Quantity, chosen: str, stated: str = "") -> float:
    """Return the factor to the SI unit of a quantity; without a unit it is that."""
    match = _SCALED.fullmatch(chosen)
    factor, unit = (float(match[1]), match[2]) if match else (1.0, chosen)
    known = _unit_factor(quantity, unit := unit or stated)
    if known is None:
        raise CanrollError(f"{where}: {quantity.label} in '{unit}': its unit is as {quantity.unit}")
    return factor * known


def _unit_factor(quantity: Quantity, unit: str) -> float | None:
    """Return the factor of a unit, 1 of none, None if the quantity cannot be in it."""
    if quantity is TIME or not unit:
        return TIME_UNITS.get(unit.casefold() or quantity.unit, None if unit else 1.0)
    known = units.UNITS[units.normal(unit) or ""]
    return float(known.factor) if known.quantity == quantity.kind else None


_BY_NAME = {"time": TIME, **QUANTITIES}
_SCALED = re.compile(r"(\d*\.?\d+)\*(.*)")
