"""Traffic sets: periodic messages from a database's cycle times or from a TOML file.

A DBC, KCD, ARXML or SYM file is read by cantools; of a file with several buses one is chosen with
``file#bus``.

A TOML file has ``bitrate`` and tables ``[[message]]`` with ``name``, ``id``, ``bytes`` (or
``bits``, the frame length with interframe space) and ``period_ms``; optional ``jitter_ms``,
``offset_ms``, ``node``, ``extended``, ``fd``, ``bit_rate_switch``, ``fifo`` and ``deadline_ms``
(default: the period); with ``bitrate`` optionally ``data_bitrate``.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from cantools.database import Database, Message
from cantools.database.can import Bus

from canroll import documents
from canroll.dbc import FD_LENGTHS, attribute, padded, read, switches_bit_rate
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.plant_sim.buses import LOGS
from canroll.plant_sim.can_bus.kernel.network import check_frame, check_rates
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD
from canroll.plant_sim.kernels.instants import MS

DEFAULT_BITRATE: Final = 500_000
CLASSIC: Final = 8
"""Most bytes of a classic frame."""
_NAMED: Final = 8
_EVENTS: Final = ("spontaneous", "event", "change", "write", "trigger")
"""Words in a GenMsgSendType of messages that are sent on events."""
DATABASES: Final = (".dbc", ".kcd", ".arxml", ".sym")
"""Suffixes of the descriptions that cantools reads."""
_TABLE: Final = ("bitrate", "data_bitrate", "message")
_REQUIRED: Final = ("name", "id", "period_ms")
_OPTIONAL: Final = (
    "bytes",
    "bits",
    "jitter_ms",
    "offset_ms",
    "node",
    "extended",
    "fd",
    "bit_rate_switch",
    "fifo",
    "deadline_ms",
)


@dataclass(frozen=True, slots=True)
class Traffic:
    """Periodic messages of one bus.

    ``left_out`` names messages without a cycle time; ``rate_assumed``: nothing says the bit rate;
    ``warnings`` list what the file lacks or has wrong.
    """

    bitrate: int
    data_bitrate: int
    messages: tuple[BusMessage, ...]
    left_out: tuple[str, ...] = ()
    rate_assumed: bool = False
    warnings: tuple[str, ...] = ()


def load_traffic(
    path: Path,
    *,
    bitrate: int | None = None,
    data_bitrate: int | None = None,
    period_ms: float | None = None,
) -> Traffic:
    """Read a traffic set from ``path``, a ``.toml`` file or one of :data:`DATABASES`.

    Args:
        path: the file, with ``#bus`` behind it to choose one of several buses.
        bitrate: overrides the file's own; for a database without one: 500 kbit/s.
        data_bitrate: of FD frames with bit-rate switch, overrides the file's own.
        period_ms: of the messages of a database that have no cycle time; None leaves them out.

    Raises:
        CanrollError: the file cannot be read or has an invalid value.
    """
    name, _, bus = str(path).partition("#")
    file = Path(name)
    suffix = file.suffix.lower()
    if suffix not in {*DATABASES, ".toml"} or (bus and suffix == ".toml"):
        raise CanrollError(
            f"{path}: a traffic set must be a .toml, {', '.join(DATABASES[:-1])} or {DATABASES[-1]}"
            f" file; a bus log ends in {', '.join(LOGS)}, or these and .gz"
        )
    if not file.is_file():
        raise CanrollError(f"{file}: no such file")
    traffic = _from_toml(file) if suffix == ".toml" else _from_database(file, bus, period_ms)
    if not traffic.messages and traffic.left_out:
        raise CanrollError(
            f"{path}: no message has a cycle time (GenMsgCycleTime is missing for "
            f"{len(traffic.left_out)}): 'canroll bus' takes --period MS for them, or a log of the "
            "bus instead of the file"
        )
    if not traffic.messages:
        raise CanrollError(f"{path}: contains no periodic message")
    for name, count in Counter(message.name for message in traffic.messages).items():
        if count > 1:
            raise CanrollError(f"{path}: two messages are named '{name}'")
    if bitrate is not None:
        traffic = replace(traffic, bitrate=bitrate, rate_assumed=False)
    if data_bitrate is not None:
        traffic = replace(traffic, data_bitrate=data_bitrate)
    try:
        check_rates(traffic.bitrate, traffic.data_bitrate)
    except CanrollError as error:
        raise CanrollError(f"{path}: {error}") from error
    return traffic


def _from_database(path: Path, chosen: str, period_ms: float | None) -> Traffic:
    database, warnings = read(path)
    bus = _bus(path, database, chosen)
    messages, left_out = [], []
    long, split, events = [], [], []
    for message in database.messages:
        if bus is not None and message.bus_name not in (None, bus.name):
            continue
        least = attribute(message, "GenMsgDelayTime") if _on_events(message) else 0
        period = least or message.cycle_time or period_ms
        if message.length > FD_LENGTHS[-1]:
            split.append(message.name)
        elif period:
            messages.append(_message(message, period))
            if message.length > CLASSIC and not message.is_fd:
                long.append(message.name)
            if _on_events(message) and not least:
                events.append(f"{message.name} {period:g} ms")
        else:
            left_out.append(message.name)
    bitrate = (bus and bus.baudrate) or attribute(database, "Baudrate")
    switched = any(m.flags & BIT_RATE_SWITCH for m in messages)
    data_bitrate = (bus and bus.fd_baudrate) or attribute(database, "BaudrateCANFD")
    try:
        for listed in messages:
            check_frame(listed.ident, listed.length, listed.flags)
    except CanrollError as error:
        raise CanrollError(f"{path}: {error}") from error
    for text, names in (
        (f"taken as CAN FD, as longer than {CLASSIC} bytes", long),
        (f"left out, as longer than {FD_LENGTHS[-1]} bytes (of a transport protocol)", split),
        ("sent on events without a least distance (GenMsgDelayTime), assumed", events),
    ):
        if names:
            more = " …" if len(names) > _NAMED else ""
            warnings = (*warnings, f"{path}: {text}: {', '.join(names[:_NAMED])}{more}")
    return Traffic(
        bitrate or DEFAULT_BITRATE,
        data_bitrate if switched else 0,
        tuple(messages),
        tuple(left_out),
        rate_assumed=not bitrate,
        warnings=warnings,
    )


def _bus(path: Path, database: Database, chosen: str) -> Bus | None:
    """The chosen bus of a database, or the only one with messages."""
    used = {message.bus_name for message in database.messages}
    buses = {bus.name: bus for bus in database.buses if bus.name in used}
    if chosen and chosen not in buses:
        raise UnknownNameError(f"bus of {path}", chosen, buses)
    if len(buses) > 1 and not chosen:
        names = ", ".join(f"{path}#{name}" for name in buses)
        raise CanrollError(f"{path}: choose a bus of it: {names}")
    return buses[chosen] if chosen else next(iter(buses.values()), None)


def _on_events(message: Message) -> bool:
    """Whether a message is sent on events, alone or besides its cycle."""
    send_type = (message.send_type or "").lower()
    return any(word in send_type for word in _EVENTS)


def _message(message: Message, period_ms: float) -> BusMessage:
    fd = message.is_fd or CLASSIC < message.length <= FD_LENGTHS[-1]
    flags = (EXTENDED if message.is_extended_frame else 0) | (FD if fd else 0)
    if switches_bit_rate(message):
        flags |= BIT_RATE_SWITCH
    return BusMessage(
        name=message.name,
        ident=message.frame_id,
        length=padded(message.length) if fd else message.length,
        period_ns=round(period_ms * MS),
        sender=message.senders[0] if message.senders else "Node",
        receivers=tuple(sorted(name for name in message.receivers if name)),
        offset_ns=attribute(message, "GenMsgStartDelayTime") * MS,
        flags=flags,
    )


def _from_toml(path: Path) -> Traffic:
    try:
        table = documents.toml(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"{path}: {reason(error)}") from error
    documents.refuse_unknown(table, _TABLE, f"key in {path}")
    bitrate = table.get("bitrate", DEFAULT_BITRATE)
    data_bitrate = table.get("data_bitrate", 0)
    for key, value in (("bitrate", bitrate), ("data_bitrate", data_bitrate)):
        if type(value) is not int or value < (key == "bitrate"):
            raise CanrollError(f"{path}: {key} = {value!r}: must be an integer above 0")
    rows = table.get("message", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise CanrollError(f"{path}: messages are tables [[message]]")
    messages = [_toml_message(path, i, row) for i, row in enumerate(rows, 1)]
    return Traffic(bitrate, data_bitrate, tuple(messages))


def _toml_message(path: Path, place: int, row: dict[str, Any]) -> BusMessage:
    where = f"{path}: message {row.get('name', place)}"
    documents.refuse_unknown(row, _REQUIRED + _OPTIONAL, f"key in {where}")
    for key in _REQUIRED:
        if key not in row:
            raise CanrollError(f"{where}: '{key}' is missing")
    if "bytes" in row and "bits" in row:
        raise CanrollError(f"{where}: give 'bytes' or 'bits', not both")

    def number(key: str, least: float, default: float = 0.0) -> float:
        value = row.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not value >= least:
            raise CanrollError(
                f"{where}: {key} = {value!r}: must be a number of at least {least:g}"
            )
        return float(value)

    def integer_of(key: str, default: int = 0) -> int:
        value = row.get(key, default)
        if type(value) is not int or value < 0:
            raise CanrollError(f"{where}: {key} = {value!r}: must be an integer of at least 0")
        return value

    flags = (
        (EXTENDED if row.get("extended") else 0)
        | (FD if row.get("fd") else 0)
        | (BIT_RATE_SWITCH if row.get("fd") and row.get("bit_rate_switch", True) else 0)
    )
    message = BusMessage(
        name=str(row["name"]),
        ident=integer_of("id"),
        length=integer_of("bytes"),
        period_ns=number("period_ms", 1e-3) * MS,
        sender=str(row.get("node", "Node")),
        jitter_ns=round(number("jitter_ms", 0.0) * MS),
        offset_ns=round(number("offset_ms", 0.0) * MS),
        flags=flags,
        bits=integer_of("bits"),
        fifo=bool(row.get("fifo", False)),
        deadline_ns=round(number("deadline_ms", 0.0) * MS),
    )
    try:
        check_frame(message.ident, message.length, flags)
    except CanrollError as error:
        raise CanrollError(f"{where}: {error}") from error
    return message
