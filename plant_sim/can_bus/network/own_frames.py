"""The frames that carry our signals on a bus: those of the contract, or of a user's DBC and map."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

from cantools.database import Signal

from canroll import dbc
from canroll.codegen.generated.bus_map import BusMap, frame_ident, load
from canroll.codegen.generated.mailbox import EXTENDED as EXTENDED_IDENT
from canroll.codegen.generated.mailbox import Mailbox
from canroll.dbc.reader import Files, file_names, network
from canroll.errors import CanrollError, UnknownNameError
from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.can_bus.traffic.messages import BusMessage
from canroll.plant_sim.can_bus.wire.frame import (
    BIT_RATE_SWITCH,
    EXTENDED,
    FD,
    best_case_bits,
    transmission_ns,
)
from canroll.plant_sim.kernels.instants import MS

DEFAULT_COMMAND: Final = "SuspensionForceCommand"
CONTRACT_MAP: Final = dbc.PATH.with_suffix(".toml")
NEEDED: Final = ("imu",)
"""Messages without which no law can run."""
FURTHER_FRAMES: Final = 16
"""Frames behind the first of a message that a simulated car sends at most."""


def flags_of(box: Mailbox) -> int:
    """Return the wire flags of a mailbox's frame."""
    switched = BIT_RATE_SWITCH if box.bit_rate_switch else 0
    extended = EXTENDED if box.ident & EXTENDED_IDENT else 0
    return extended | (FD if box.fd else 0) | switched


def most_received(profile: BusProfile, bus: BusMap, span_ns: int) -> int:
    """Return the most frames for the ECU, from any sender, that can end within a time span.

    The ECU's segment is full of the shortest of them, without a stuff bit.
    """
    shortest = min(
        transmission_ns(
            best_case_bits(box.sent_length, flags_of(box)),
            bitrate=profile.bitrate,
            data_bitrate=profile.data_bitrate or None,
        )
        for box in bus.received
        if box.name
    )
    return -(-span_ns // shortest)


@dataclass(frozen=True, slots=True)
class ContractNames:
    """Names in the bus contract: of a mailbox's message, and of its signals by field."""

    message: str
    signals: Mapping[str, str]


@cache
def contract_names(slot: str) -> ContractNames:
    """Return the names of a firmware mailbox in the bus contract."""
    box = next(box for box in load(dbc.PATH, CONTRACT_MAP).frames if box.slot == slot)
    return ContractNames(box.name, {signal.place.text: signal.name for signal in box.signals})


def bus_map(profile: BusProfile) -> BusMap | None:
    """Return the map of a profile with user-defined frames; None for those of the contract.

    Raises:
        CanrollError: DBC or map cannot be used; a frame that the loop needs is missing, or has no
            cycle time.
    """
    if profile.dbc is None or profile.map_file is None:
        return None
    return _checked(profile.dbc, profile.map_file, profile.map_file.stat().st_mtime_ns)


def secured(profile: BusProfile) -> bool:
    """Return whether a profile's frames are authenticated."""
    bus = bus_map(profile)
    return bus is not None and bus.secured


def frame_signals(profile: BusProfile) -> dict[int, dict[str, Signal]]:
    """Return the always-present signals of a profile's own frames, by name, by identifier."""
    bus = bus_map(profile)
    if bus is None or profile.dbc is None:
        return {}
    database, _ = dbc.read(profile.dbc)
    return {
        box.ident: {
            signal.name: signal
            for signal in database.get_message_by_name(box.name).signals
            if not (signal.multiplexer_ids or signal.is_multiplexer or signal.is_float)
        }
        for box in bus.frames
    }


@cache
def _checked(files: Files, map_file: Path, changed: int) -> BusMap:
    """The map, read once for each state ``changed`` of its file."""
    bus = load(files, map_file)
    filled = {box.slot for box in bus.frames}
    for slot in NEEDED:
        if slot not in filled:
            raise CanrollError(f"{map_file}: [receive.{slot}] is missing: the loop needs it")
    pages: dict[int, tuple[int, ...]] = {}
    for box in bus.frames:
        if pages.setdefault(box.ident, box.pages) != box.pages:
            raise CanrollError(
                f"{map_file}: {box.name} is mapped on several pages: a simulated car sends one"
            )
    further = sum(box.further > 0 for box in bus.received)
    if further > FURTHER_FRAMES:
        raise CanrollError(
            f"{map_file}: {further} frames behind the first of a message: a simulated car has "
            f"{FURTHER_FRAMES}"
        )
    for box in bus.received:
        if box.name and box.cycle_ms <= 0:
            own = file_names(network(files).described_in(box.name))
            raise CanrollError(
                f"{map_file} [receive.{box.slot}]: {box.name} has no cycle time: set "
                f"GenMsgCycleTime in {own}, or period_ms in the map"
            )
    return bus


def messages_of(profile: BusProfile) -> tuple[BusMessage, ...]:
    """Return all messages that a profile's frames carry, whichever command is in use."""
    commands = [m.name for m in dbc.load().messages if m.name.endswith("Command")]
    bus = bus_map(profile)
    if bus is not None:
        placed = {contract_names(box.slot).message for box in bus.frames}
        commands = [name for name in commands if name in placed]
    messages = {m.ident: m for name in commands for m in own_messages(name, profile)}
    return tuple(messages.values())


def own_messages(
    command: str = DEFAULT_COMMAND, profile: BusProfile | None = None
) -> tuple[BusMessage, ...]:
    """Return our messages that are in use with actuator command ``command``.

    They have the contract's names whichever frames of ``profile`` carry them; messages that share a
    frame are represented by the first of them.
    """
    commands = {m.name for m in dbc.load().messages if m.name.endswith("Command")}
    if command not in commands:
        raise UnknownNameError("command message", command, commands)
    jitter = {} if profile is None else profile.network.jitter
    contract = tuple(
        replace(message, jitter_ns=jitter[message.sender].high_ns)
        if message.sender in jitter
        else message
        for message in _contract()
        if message.name not in commands - {command}
    )
    bus = None if profile is None else bus_map(profile)
    return contract if bus is None else _placed(contract, command, bus)


@cache
def _contract() -> tuple[BusMessage, ...]:
    """The contract's messages with all commands; its file is slow to ask."""
    return tuple(
        BusMessage(
            message.name,
            message.frame_id,
            message.length,
            (message.cycle_time or 100) * MS,
            message.senders[0],
            tuple(sorted(message.receivers)),
        )
        for message in dbc.load().messages
    )


def measurement_messages(profile: BusProfile, taken: Collection[int]) -> list[BusMessage]:
    """Return the frames of measurements by XCP, each as a separate message.

    On the bus they have one identifier and follow each other; here they have free ones from it on,
    which gives all others the same bounds. ``taken`` are identifiers in use.

    Raises:
        CanrollError: the map has no XCP, or there are not enough identifiers.
    """
    count, period_ms = profile.measured
    if count == 0:
        return []
    bus = load(profile.dbc or dbc.PATH, profile.map_file or CONTRACT_MAP)
    if bus.xcp is None:
        raise CanrollError(f"{profile.map_file}: has no table [xcp]: add it, or omit --xcp")
    first = frame_ident(bus.xcp.slave)
    wide = bool(first & EXTENDED_IDENT)
    last = (1 << 29 if wide else 1 << 11) - 1
    free = [i for i in range(first & (EXTENDED_IDENT - 1), last + 1) if i not in taken]
    if len(free) < count:
        raise CanrollError(
            f"--xcp: only {len(free)} identifiers are free from 0x{first:X} on: fewer frames, or a "
            "lower one in [xcp]"
        )
    flags = EXTENDED if wide else 0
    return [
        BusMessage(f"XcpMeasurement{k + 1}", ident, 8, period_ms * MS, "RollControl", flags=flags)
        for k, ident in enumerate(free[:count])
    ]


def frame_names(profile: BusProfile) -> dict[str, str]:
    """Return the frame names of a profile by the contract's message names."""
    bus = bus_map(profile)
    if bus is None:
        return {message.name: message.name for message in dbc.load().messages}
    return {_own_name(box): box.name for box in bus.frames}


def _own_name(box: Mailbox) -> str:
    """The contract's name of a message for its first frame, with the frame's own for others."""
    message = contract_names(box.slot).message
    return f"{message}.{box.name}" if box.further else message


def _placed(contract: tuple[BusMessage, ...], command: str, bus: BusMap) -> tuple[BusMessage, ...]:
    """The contract's messages in the frames of ``bus``."""
    known = {message.name: message for message in contract}
    placed: dict[int, BusMessage] = {}
    for box in bus.frames:
        plain = known.get(contract_names(box.slot).message)
        if plain is None or box.ident in placed:
            continue
        placed[box.ident] = BusMessage(
            _own_name(box),
            box.ident & (EXTENDED_IDENT - 1),
            box.sent_length,
            box.cycle_ms * MS if box.cycle_ms > 0 else plain.period_ns,
            plain.sender,
            plain.receivers,
            jitter_ns=plain.jitter_ns,
            flags=flags_of(box),
        )
    messages = tuple(placed.values())
    if command not in {message.name for message in messages}:
        raise CanrollError(
            f"the map places no {command}, which commands these actuators: add its table under "
            "[transmit]"
        )
    return messages
