"""Named signals over time from a file: columns of a CSV, channels of an MF4, signals of a bus log.

A bus log needs a network description (DBC, KCD, ARXML or SYM). Without one an MF4 is a measurement
and a CSV has a column ``time``.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import cantools
import numpy as np
from cantools.database import Message
from numpy.typing import NDArray

from canroll import documents
from canroll.dbc.reader import network
from canroll.errors import CanrollError, MissingExtraError, UnknownNameError, reason
from canroll.plant_sim.buses import LOGS
from canroll.plant_sim.can_bus.logs.databases import DAMAGED_MF4
from canroll.plant_sim.can_bus.traffic.log_name import LogName, log_name
from canroll.plant_sim.can_bus.traffic.log_reader import Logged, read_log, select_channel
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, REMOTE
from canroll.plant_sim.driving.columns import rows as rows_of
from canroll.typing import Vector

CSV_UNITS: Final = {
    "steering_wheel_deg": "deg",
    "lateral_acceleration": "m/s2",
    "speed_kmh": "km/h",
}
"""Columns of a CSV whose names state their units."""

_MF4_TO_NPZ: Final = """
import logging, sys, asammdf, numpy
logging.disable()

def number(value):
    try:
        return float(value)
    except (TypeError, ValueError):
        return numpy.nan

def places(mdf, name):
    exact = mdf.channels_db.get(name, ())
    group, dot, rest = name.partition(".")
    if not exact and dot and group.isdigit():
        exact = [place for place in mdf.channels_db.get(rest, ()) if place[0] == int(group)]
    return sorted(set(exact))

with asammdf.MDF(sys.argv[1]) as mdf:
    masters = set(mdf.masters_db.items())
    known = [name for name, there in mdf.channels_db.items() if not masters.issuperset(there)]
    table = {"known": numpy.array(known, str)}
    for i, name in enumerate(NAMES):
        there = places(mdf, name)
        table[f"groups{i}"] = numpy.array([group for group, _ in there], int)
        if len(there) == 1:
            signal = mdf.get(group=there[0][0], index=there[0][1])
            samples = signal.samples
            if samples.dtype.kind not in "fiub" or samples.ndim != 1:
                samples = numpy.array([number(value) for value in samples], float)
            table[f"values{i}"] = samples.astype(float)
            table[f"times{i}"] = signal.timestamps.astype(float)
            table[f"unit{i}"] = numpy.array(str(signal.unit))
numpy.savez(sys.stdout.buffer, **table)
"""
"""asammdf is ended by some damaged files."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """A signal over time.

    ``unit`` as the file states it, "" where it does not. ``times`` (s) increase, on one clock for
    all signals of a file; ``values`` in the unit, read-only as the times are. ``remarks``: what
    was left out.
    """

    name: str
    unit: str
    times: Vector
    values: Vector
    remarks: tuple[str, ...] = ()


def read(file: str, names: Sequence[str], dbc: str = "") -> tuple[Signal, ...]:
    """Return signals of a file, in the order of their names.

    Args:
        file: the file; one channel of several in a bus log is ``file#channel``.
        names: columns of a CSV, channels of an MF4 (``GROUP.NAME``, with the number of its group,
            where several have the name), signals of a bus log (``MESSAGE.SIGNAL`` likewise).
        dbc: network description of a bus log; "": the file is none.

    Raises:
        MissingExtraError: asammdf, which reads an MF4, is not installed.
        CanrollError: the file cannot be read, a signal is not there or several are, or it has no
            two values.
    """
    named = log_name(file)
    if dbc and named is None:
        raise CanrollError(
            f"{file}: --set dbc=FILE is for a bus log, which ends in {', '.join(LOGS)}"
        )
    path = named.path if named is not None and dbc else Path(file)
    if named is not None and not dbc and path.suffix.lower() not in (".csv", ".mf4"):
        raise CanrollError(f"{file}: a bus log needs its network description: --set dbc=FILE")
    return _read(file, tuple(names), dbc, (_state(path), _state(Path(dbc))))


def read_over(file: str, over: str, known: Collection[str]) -> tuple[Signal, ...]:
    """Return all columns of a CSV over another one, whose values are their ``times``.

    Args:
        file: the file.
        over: name of the column that increases, such as ``distance``.
        known: names that the others may have.

    Raises:
        UnknownNameError: another column.
        CanrollError: the file cannot be read, or a column has no two values.
    """
    path = Path(file)
    rows = rows_of(path)
    names = rows[0][1] if rows else []
    others = [name for name in names if name != over]
    for name in others:
        if name not in known:
            raise UnknownNameError(f"column of {path}", name, (over, *known))
    if not others:
        raise CanrollError(f"{path}: it needs the columns {over} and one of {', '.join(known)}")
    return tuple(_of_csv(path, rows, name, over) for name in others)


def is_csv(file: str, dbc: str = "") -> bool:
    """Whether a file is read as a CSV: whatever is no MF4 and no bus log."""
    return not dbc and (log_name(file) is None or Path(file).suffix.lower() == ".csv")


def columns(file: str) -> tuple[str, ...]:
    """Return the names in the first line of a CSV.

    Raises:
        CanrollError: it cannot be read.
    """
    path = Path(file)
    _state(path)
    return tuple(next(iter(rows_of(path)), (0, []))[1])


def channels(file: str) -> Collection[str]:
    """Return the names of the channels of an MF4.

    Raises:
        MissingExtraError: asammdf, which reads it, is not installed.
        CanrollError: it cannot be read.
    """
    path = Path(file)
    _state(path)
    return frozenset(_measurement(path, ())["known"].tolist())


def carried(file: str, needed: Sequence[str], others: Sequence[str], dbc: str) -> Collection[str]:
    """Return which ``others`` a bus log has beside the signals that are ``needed``.

    They are those with two frames or more on the channel that has frames of all needed; of a log
    without such a channel, or with several, none.

    Args:
        file: the log; one channel of several is ``file#channel``.
        needed: signals of the description.
        others: signals of it that may be missing.
        dbc: the description.

    Raises:
        CanrollError: the log cannot be read, or the description does not have a signal.
    """
    named = log_name(file)
    if named is None:
        return ()
    there = _having(named, [_message(Path(dbc), name) for name in needed])
    if len(there) != 1:
        return ()
    return [n for n in others if _rows_of(_message(Path(dbc), n), there[0]).sum() > 1]


def _state(path: Path) -> tuple[int, int]:
    """Return what changes with the content of a file."""
    try:
        stat = path.stat()
    except OSError as error:
        raise CanrollError(f"cannot read signal file {path}: {reason(error)}") from error
    return stat.st_mtime_ns, stat.st_size


@lru_cache(maxsize=8)  # each run of a manoeuvre plans it again
def _read(file: str, names: tuple[str, ...], dbc: str, _state: object) -> tuple[Signal, ...]:
    named = log_name(file)
    if dbc and named is not None:
        return _of_log(named, names, Path(dbc))
    path = Path(file)
    if path.suffix.lower() == ".mf4":
        return _of_mf4(path, names)
    rows = rows_of(path)
    return tuple(_of_csv(path, rows, name) for name in names)


def _of_csv(path: Path, rows: list[tuple[int, list[str]]], name: str, over: str = "time") -> Signal:
    header = rows[0][1] if rows else []
    if header.count(name) != 1 or header.count(over) != 1:
        raise CanrollError(
            f"{path}: line 1: the header must name the columns {over} and {name} once; it has "
            f"{', '.join(header) or 'none'}"
        )
    places = header.index(over), header.index(name)
    numbers: list[tuple[float, float]] = []
    for line, row in rows[1:]:
        try:
            at, value = (float(row[place]) for place in places)
        except (ValueError, IndexError) as error:
            raise CanrollError(
                f"{path}: line {line}: expected two numbers, {over} and {name}, got {row}"
            ) from error
        if not np.isfinite([at, value]).all():
            raise CanrollError(f"{path}: line {line}: not a finite number")
        if numbers and at <= numbers[-1][0]:
            raise CanrollError(f"{path}: line {line}: {over} must increase")
        numbers.append((at, value))
    if len(numbers) < 2:
        raise CanrollError(f"{path}: at least two rows of numbers are required")
    at_all, values = np.array(numbers).T
    return _checked(path, Signal(name, CSV_UNITS.get(name, ""), at_all, values))


def _of_mf4(path: Path, names: tuple[str, ...]) -> tuple[Signal, ...]:
    table = _measurement(path, names)
    return tuple(_of_channel(path, name, i, table) for i, name in enumerate(names))


def _measurement(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Return the names of all channels of an MF4, and what is in those of ``names``."""
    if find_spec("asammdf") is None:
        raise MissingExtraError("reading an .mf4", "asammdf")
    program = f"NAMES = {list(names)!r}\n{_MF4_TO_NPZ}"
    try:
        return documents.read_apart(program, path)
    except ValueError as error:
        raise CanrollError(f"{path}: not a readable measurement: {DAMAGED_MF4}") from error


def _of_channel(path: Path, name: str, i: int, table: dict[str, NDArray[Any]]) -> Signal:
    known, groups = table["known"].tolist(), table[f"groups{i}"].tolist()
    if not groups and any(channel.startswith("CAN_DataFrame") for channel in known):
        raise CanrollError(
            f"{path}: no channel '{name}', but frames of a bus: with --set dbc=FILE they are read"
        )
    if not groups:
        raise _unknown(f"channel of {path}", name, known)
    if len(groups) > 1:
        raise CanrollError(
            f"{path}: channel {name} is in the groups {', '.join(map(str, groups))}: name it with "
            f"its group, such as {groups[0]}.{name}"
        )
    times, values = table[f"times{i}"], table[f"values{i}"]
    kept = np.isfinite(values)
    remarks = () if kept.all() else (_left_out(path, name, kept, "samples", "are no number"),)
    unit = str(table[f"unit{i}"])
    return _checked(path, Signal(name, unit, times[kept], values[kept], remarks))


def _of_log(named: LogName, names: tuple[str, ...], dbc: Path) -> tuple[Signal, ...]:
    messages = [_message(dbc, name) for name in names]
    there = _having(named, messages)
    if len(there) != 1:
        wanted = " and ".join(dict.fromkeys(f"{m.name} (0x{m.frame_id:X})" for m in messages))
        if not there:
            raise CanrollError(f"{named.path}: no channel has frames of {wanted}")
        raise CanrollError(
            f"{named.path}: frames of {wanted} are on the channels "
            f"{', '.join(logged.channel for logged in there)}: choose one, such as "
            f"file={named.path}#{there[0].channel}"
        )
    return tuple(
        _of_frames(named.path, name, message, there[0])
        for name, message in zip(names, messages, strict=True)
    )


def _having(named: LogName, messages: Collection[Message]) -> list[Logged]:
    """Return the channels of a log that have frames of all messages."""
    logged = read_log(named.path)
    if named.channel is not None:
        select_channel(named.path, logged, named.channel)
        logged = {named.channel: logged[named.channel]}
    return [
        one for one in logged.values() if all(_rows_of(message, one).any() for message in messages)
    ]


def _message(dbc: Path, name: str) -> Message:
    """Return the message that has the signal ``name``."""
    description = network(dbc)
    signals = [(m, signal.name) for m in description.database.messages for signal in m.signals]
    having = [m for m, signal in signals if name in (signal, f"{m.name}.{signal}")]
    if len(having) == 1:
        return having[0]
    if having:
        raise CanrollError(
            f"{dbc}: the signal {name} is in {' and '.join(m.name for m in having)}: name it with "
            f"its message, such as {having[0].name}.{name}"
        )
    unread = description.unread(name.rpartition(".")[2])
    raise (
        CanrollError(unread)
        if unread
        else _unknown(f"signal of {dbc}", name, (signal for _, signal in signals))
    )


def _rows_of(message: Message, logged: Logged) -> NDArray[np.bool_]:
    """Return which frames of a log are those of a message."""
    kind = EXTENDED if message.is_extended_frame else 0
    same = (logged.flags & (EXTENDED | REMOTE)) == kind
    rows: NDArray[np.bool_] = same & (logged.ident == message.frame_id)
    return rows


def _of_frames(path: Path, name: str, message: Message, logged: Logged) -> Signal:
    signal = message.get_signal_by_name(name.removeprefix(f"{message.name}."))
    rows = np.flatnonzero(_rows_of(message, logged))
    values = np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        payload = logged.payload[row, : logged.length[row]].tobytes()
        try:
            decoded = message.decode(payload, allow_truncated=True)
        except (cantools.Error, ValueError, KeyError):
            continue
        assert isinstance(decoded, dict)
        value = decoded.get(signal.name)
        # what has a name, such as "Not available", is no measurement
        if isinstance(value, int | float):
            values[i] = value
    kept = np.isfinite(values)
    remarks = logged.remarks
    if not kept.all():
        remarks += (_left_out(path, name, kept, "frames", "have no number of it"),)
    times = 1e-9 * logged.received_ns[rows[kept]]
    # two frames of one microsecond: the later one counts
    last = np.append(np.diff(times) > 0.0, True)[: len(times)]
    return _checked(path, Signal(name, signal.unit or "", times[last], values[kept][last], remarks))


def _left_out(path: Path, name: str, kept: NDArray[np.bool_], what: str, why: str) -> str:
    return f"{path}: signal {name}: {np.sum(~kept)} of {len(kept)} {what} {why}: left out"


def _checked(where: Path, signal: Signal) -> Signal:
    """Return a signal that has values over increasing times, read-only."""
    if len(signal.values) < 2:
        raise CanrollError(
            f"{where}: signal {signal.name}: it has {len(signal.values)} numbers, it needs two"
        )
    if not np.isfinite(signal.times).all() or np.any(np.diff(signal.times) <= 0.0):
        raise CanrollError(f"{where}: signal {signal.name}: its times do not increase")
    for array in (signal.times, signal.values):
        array.flags.writeable = False
    return signal


def _unknown(what: str, name: str, choices: Iterable[str]) -> CanrollError:
    """Return the refusal of a name among many, of which only the nearest is named."""
    known = sorted(set(choices))
    part = name.casefold()
    near = get_close_matches(name, known, n=1) or [n for n in known if part in n.casefold()][:1]
    if near or len(known) <= 20:
        return UnknownNameError(what, name, known, near=near)
    return CanrollError(f"unknown {what} '{name}': none of its {len(known)} is called alike")
