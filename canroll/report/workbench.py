"""Everything recorded of the runs on a page, so that any signal or field can be chosen there.

The scripts ``recorded.js`` and ``workbench.js`` read it. Of each run: the vehicle's signals, the
ECU's ticks, the frames of the bus, which the page decodes by the description of the messages.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from cantools.database.can import Message, Signal
from numpy.typing import NDArray

from canroll import dbc
from canroll.dbc.reader import network
from canroll.plant_sim.can_bus.kernel.layout import DELIVERED, OUTCOMES
from canroll.plant_sim.can_bus.wire.frame import EXTENDED
from canroll.plant_sim.world.recording import unit
from canroll.plant_sim.world.spool import Table, blocks, pieces, row_count
from canroll.reaction.fault_codes import FAULT_CODES
from canroll.reaction.reaction import mode_changes
from canroll.report.columns import column, every, instants, packed_bytes, payloads
from canroll.report.curves import MOMENT, CurveQuantity, Shown, derived, transfer
from canroll.runs.metrics import has_wheel_loads
from canroll.runs.result import Result, Run
from canroll.runs.trace import TICK, Trace
from canroll.vehicles.actuators import ACTUATORS

VERSION = 1
"""Of the data, so that a page refuses those of a page with others."""
INSTANTS_MAX = 30_000
"""The most instants of a signal: of a longer run every second, third… millisecond."""
FRAMES_MAX = 300_000
"""The most frames of a run, the first ones; the page says from when on there are none."""
EVENTS_MAX = 1000
"""The most changes of modes and fault codes, the first ones."""
CHOSEN = ("roll", "moment", "ay")
"""What is shown before anything is chosen."""
BAD = ("DEGRADED", "SAFE")
"""Modes that are marked as bad news."""
DEGREES = float(np.degrees(1))
TICK_UNITS = {
    "moment": "N·m",
    "roll": "rad",
    "roll_rate": "rad/s",
    "lateral_acceleration": "m/s²",
    "lateral_rate": "m/s³",
    "gyro_bias": "rad/s",
}
"""Units of :data:`canroll.runs.trace.TICK`; the others are numbers of modes, bits or flags."""


def workbench(result: Result, runs: Sequence[Shown], title: str, start: float) -> dict[str, Any]:
    """Return the data of the workbench.

    Args:
        result: the run, which says which messages there are.
        runs: the runs shown.
        title: name of this page where its runs are shown on another.
        start: instant of the first cursor before one is placed, s.
    """
    messages = {
        _key(message.frame_id, extended=message.is_extended_frame): _message(message)
        for message in network(result.settings.profile.dbc or dbc.PATH).database.messages
    }
    return {
        "version": VERSION,
        "title": title,
        "start": start,
        "chosen": list(CHOSEN),
        "runs": [_run(run, messages, result.settings) for run in runs],
        "messages": messages,
        "outcomes": list(OUTCOMES),
        "events": [event for run in runs if run.controlled for event in events(run.trace.ticks)],
        "sent": [
            {"colour": colour, "time": instants(ticks["t"][ticks["triggered"] == kind])}
            for ticks in (run.trace.ticks for run in runs if run.controlled)
            for kind, colour in ((1, 1), (2, 5))
        ],
    }


def _run(run: Shown, described: Collection[str], settings: Run) -> dict[str, Any]:
    return {
        "name": run.name,
        "colour": run.colour,
        "dash": run.dash,
        "signals": _signals(run.trace, settings),
        "ticks": _ticks(run.trace.ticks),
        **_frames(run.trace.frames, described),
    }


def _signals(trace: Trace, settings: Run) -> dict[str, Any]:
    """Return time and all signals, with a few quantities derived from them."""
    stride = -(-row_count(trace.signals) // INSTANTS_MAX)
    commanded = unit_of_command(settings.actuator, settings.command)
    made = {"moment": (MOMENT, "N·m"), **derived(settings.vehicle)}
    if has_wheel_loads(trace):
        made |= {f"load_transfer_{axle}": (transfer(axle), "") for axle in ("front", "rear")}
    plain = {
        name: (
            CurveQuantity((name,), lambda values: values),
            commanded if name.startswith("demand_") else unit(name),
        )
        for name in trace.signals
        if name != "time"
    }
    times = every((time for (time,) in pieces(trace.signals, "time")), stride)
    curves = {}
    for name, (quantity, si) in {**plain, **made}.items():
        parts = (quantity.of(*piece) for piece in pieces(trace.signals, *quantity.signals))
        curves[name] = _curve(name, every(parts, stride), si)
    return {"time": instants(times), "every": stride, "curves": curves}


def unit_of_command(actuator: str, message: str) -> str:
    """Return the unit of what a message commands an actuator: that of its signals."""
    first = next(each.first for each in ACTUATORS[actuator].commands if each.message == message)
    given = dbc.load().get_message_by_name(message).get_signal_by_name(first).unit or ""
    return given.replace("Nm", "N·m")


def _curve(name: str, values: NDArray[np.float64], si: str) -> dict[str, Any]:
    """Return a column with its unit, angles in degrees but for wheels that turn on and on."""
    angle = si.startswith("rad") and not name.startswith("wheel_speed")
    shown = si.replace("rad", "deg") if angle else si
    return {"unit": shown, **column(values * DEGREES if angle else values)}


def _ticks(ticks: Table) -> dict[str, Any]:
    stride = -(-len(ticks) // INSTANTS_MAX) or 1
    names = [name for name in TICK.names or () if name != "t" and not TICK[name].shape]
    curves = {
        name: _curve(
            name, every([np.asarray(ticks[name], float)], stride), TICK_UNITS.get(name, "")
        )
        for name in names
    }
    return {"time": instants(ticks["t"][::stride]), "every": stride, "curves": curves}


def events(ticks: Table) -> list[dict[str, Any]]:
    """Return when the ECU changed its mode and when fault codes came and went: t, text, bad."""
    times, codes = ticks["t"], ticks["fault_codes"].astype(np.uint32)
    entries: list[dict[str, Any]] = [
        {"t": change.t, "text": change.mode, "bad": change.mode in BAD}
        for change in mode_changes(ticks)
    ]
    for i in np.flatnonzero(np.diff(codes, prepend=np.uint32(0))):
        before = int(codes[i - 1]) if i else 0
        for bit in range(32):
            now = int(codes[i]) >> bit & 1
            if now != before >> bit & 1:
                name = FAULT_CODES.get(bit, f"code {bit}")
                text = name if now else f"{name} over"
                entries.append({"t": float(times[i]), "text": text, "bad": bool(now)})
    entries.sort(key=lambda event: event["t"])
    if len(entries) > EVENTS_MAX:
        more = f"{len(entries) - EVENTS_MAX} further changes left out"
        entries[EVENTS_MAX:] = [{"t": entries[EVENTS_MAX]["t"], "text": more, "bad": True}]
    return entries


def _frames(frames: Table, described: Collection[str]) -> dict[str, Any]:
    """Return the frames by message and segment, and from when on there are none, s, or None."""
    parts, end, room = [np.zeros(0, frames.dtype)], None, FRAMES_MAX
    for block in blocks(frames):
        parts.append(block[:room])
        if len(block) > room:
            end = float(block["t_received"][room]) * 1e-9
            break
        room -= len(block)
    kept = np.concatenate(parts)
    kept = kept[np.argsort(kept["t_received"], kind="stable")]
    extended = (kept["flags"] & EXTENDED != 0).astype(np.int64)
    marks = kept["segment"].astype(np.int64) << 40 | extended << 32 | kept["ident"]
    streams = [_stream(kept[marks == mark], described) for mark in np.unique(marks)]
    return {"frames": streams, "frames_until": end}


def _stream(frames: NDArray[np.void], described: Collection[str]) -> dict[str, Any]:
    """Return the frames of one message on one segment, the payload if it can be decoded."""
    key = _key(int(frames["ident"][0]), extended=bool(frames["flags"][0] & EXTENDED))
    width = int(frames["length"].max(initial=0)) if key in described else 0
    stream = {
        "key": key,
        "segment": int(frames["segment"][0]),
        "width": width,
        "time": instants(frames["t_received"] * 1e-9),
        "payload": payloads(frames["payload"][:, :width]),
    }
    if np.any(frames["outcome"] != DELIVERED):
        stream["outcome"] = packed_bytes(frames["outcome"])
    if width and np.any(frames["length"] != width):
        stream["length"] = packed_bytes(frames["length"])
    return stream


def _key(ident: int, *, extended: bool) -> str:
    """Return the identifier as written in logs: hexadecimal, with x for an extended one."""
    return f"{ident:X}x" if extended else f"{ident:X}"


def _message(message: Message) -> dict[str, Any]:
    return {"name": message.name, "fields": [_field(signal) for signal in message.signals]}


def _field(signal: Signal) -> dict[str, Any]:
    """Return how a field is read: its bits, the most significant first, scale, names, switch."""
    choices: Mapping[int, object] = signal.choices or {}
    return {
        "name": signal.name,
        "unit": signal.unit or "",
        "bits": list(_bits(signal)),
        "signed": signal.is_signed,
        "float": signal.is_float,
        "scale": float(signal.scale),
        "offset": float(signal.offset),
        "names": {str(value): str(name) for value, name in choices.items()},
        "switch": signal.multiplexer_signal,
        "pages": signal.multiplexer_ids or [],
    }


def _bits(signal: Signal) -> Iterable[int]:
    """Yield byte · 8 + bit of each bit of a field, the most significant first."""
    if signal.byte_order == "little_endian":
        yield from range(signal.start + signal.length - 1, signal.start - 1, -1)
        return
    place = signal.start
    for _ in range(signal.length):
        yield place
        place = place - 1 if place % 8 else place + 15
