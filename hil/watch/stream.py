"""An observation as a stream of JSON: increments, and the last minute for a new client.

A message has ``now`` (end of the time axis, s), ``whole`` (it replaces all earlier ones), ``rows``
of each track since the last message, ``events`` and ``state``. A row is the instant of a frame and
a few numbers, null where the frame had none.
"""

import json
import math
from collections import deque
from collections.abc import Iterable
from typing import Any

from canroll.reaction.fault_codes import FAULT_CODES
from hil.watch.observation import (
    COMMAND_TO_ACKNOWLEDGEMENT,
    CONTROLLER,
    IMU_TO_COMMAND,
    SILENT,
    VEHICLE,
    Observation,
    ObservedFrame,
)

KEPT = 60.0
"""Length of the kept history, s."""
AFTER = 1.0
"""Time for which the time axis continues after the last frame on a silent bus, s."""
EVENTS = 200
LOAD_WINDOW = 0.1
"""Length of the intervals of the load, s."""

TRACKS = {
    "status": ("RollControlStatus", ("RollAngleEstimate", "MomentCommand", "Mode")),
    "imu": ("Imu", ("RollRate", "LateralAcceleration")),
    "reference": ("RollReference", ("RollAngle",)),
    "delivered": ("ActuatorState", ("DeliveredMomentFront", "DeliveredMomentRear")),
    "motion": ("VehicleMotion", ("VehicleSpeed", "SteeringWheelAngle")),
    "faults": ("RollControlDiagnostics", ("ActiveFaultCodes",)),
}
"""Tracks that are signals of a message. Beside them: the two delays (ms) and "load" (share)."""

Row = list[float | None]


class LiveStream:
    """Converts an observation into messages for browsers.

    Args:
        seen: observation filled by an onlooker, whose frames are passed to :meth:`add`.
    """

    def __init__(self, seen: Observation) -> None:
        self._seen = seen
        names = (*TRACKS, IMU_TO_COMMAND, COMMAND_TO_ACKNOWLEDGEMENT, "load")
        self._kept: dict[str, deque[Row]] = {name: deque() for name in names}
        self._fresh: dict[str, list[Row]] = {}
        self._events: deque[tuple[float, str]] = deque(maxlen=EVENTS)
        self._fresh_events: list[tuple[float, str]] = []
        self._mode: str | None = None
        self._active = self._latched = 0
        self._told: int | None = None
        self._diagnosed = False
        self._silent: set[str] = set()
        self._heard: dict[str, float] = {}
        self._bin: int | None = None
        self._bits: dict[int, int] = {}
        self._now = 0.0
        self._last: float | None = None

    @property
    def _shown(self) -> float:
        """End of the time axis, s: shortly after the last frame, so that a run stays in view."""
        return self._now if self._last is None else min(self._now, self._last + AFTER)

    def add(self, seen: Iterable[ObservedFrame], now: float) -> None:
        """Add the frames seen up to ``now`` seconds."""
        for frame in seen:
            self._hear(frame)
            self._row_of(frame)
            self._changes(frame)
            place = math.floor(frame.t / LOAD_WINDOW)
            self._bits[place] = self._bits.get(place, 0) + frame.bits
            self._bin = place if self._bin is None else self._bin
            self._last = frame.t if self._last is None else max(self._last, frame.t)
        self._now = max(self._now, now)
        for side in self._heard:
            self._miss(side, self._now)
        self._loads()

    def news(self, *, lost: bool = False) -> str:
        """Return the message since the last call; ``lost``: the bus cannot be reached."""
        rows, self._fresh = self._fresh, {}
        events = sorted(self._fresh_events, key=lambda event: event[0])
        self._fresh_events = []
        for name, fresh in rows.items():
            kept = self._kept[name]
            kept.extend(fresh)
            while kept and (kept[0][0] or 0.0) < self._shown - KEPT:
                kept.popleft()
        self._events.extend(events)
        return self._message(rows, events, complete=False, lost=lost)

    def everything(self, *, lost: bool = False) -> str:
        """Return all data up to the last :meth:`news`, for a new client."""
        rows = {name: list(kept) for name, kept in self._kept.items()}
        return self._message(rows, list(self._events), complete=True, lost=lost)

    def _message(
        self,
        rows: dict[str, list[Row]],
        events: list[tuple[float, str]],
        *,
        complete: bool,
        lost: bool,
    ) -> str:
        seen = self._seen
        kind, headline, text = state(seen, lost=lost)
        message = {
            "now": round(self._shown, 4),
            "whole": complete,
            "rows": rows,
            "events": events,
            "state": {"kind": kind, "headline": headline, "text": text},
            "values": seen.summary(),
            "rates": {name: seen.rate(name) for name in seen.frames},
        }
        return json.dumps(message, separators=(",", ":"), allow_nan=False)

    def _put(self, name: str, t: float, *values: float | None) -> None:
        rounded = [None if value is None else round(value, 4) for value in values]
        self._fresh.setdefault(name, []).append([round(t, 4), *rounded])

    def _row_of(self, frame: ObservedFrame) -> None:
        for name, (message, signals) in TRACKS.items():
            if message == frame.message and signals[0] in frame.values:
                self._put(name, frame.t, *(_number(s, frame.values[s]) for s in signals))
        for name, delay in frame.delays.items():
            self._put(name, frame.t, 1e3 * delay)

    def _changes(self, frame: ObservedFrame) -> None:
        """Record changes of mode and of active fault codes."""
        if frame.message == "RollControlStatus" and "Mode" in frame.values:
            mode = str(frame.values["Mode"])
            if self._mode != mode:
                self._note(frame.t, mode if self._mode is None else f"{self._mode} → {mode}")
            self._mode = mode
        # a code of the latched page may still be active: the next active page decides
        if "LatchedFaultCodes" in frame.values:
            self._told = int(frame.values["LatchedFaultCodes"])
        if "ActiveFaultCodes" in frame.values:
            self._fault_changes(frame.t, int(frame.values["ActiveFaultCodes"]))

    def _fault_changes(self, t: float, active: int) -> None:
        latched = self._told or 0
        for bit, name in FAULT_CODES.items():
            before, now = self._active >> bit & 1, active >> bit & 1
            if now > before:
                what = "active"
            elif now < before:
                what = "no longer active"
            elif not now and (latched & ~self._latched) >> bit & 1:
                what = "came and went" if self._diagnosed else "has occurred before"
            else:
                continue
            self._note(t, f"fault code {bit} ({name}) {what}")
        self._active, self._latched = active, latched | active
        self._diagnosed = self._told is not None

    def _hear(self, frame: ObservedFrame) -> None:
        """Record sides heard for the first time, or again."""
        if frame.side is None:
            return
        last = self._heard.get(frame.side)
        if last is None:
            self._note(frame.t, f"{frame.side} heard")
        else:
            self._miss(frame.side, frame.t)
            if frame.side in self._silent:
                self._note(frame.t, f"{frame.side} heard again after {frame.t - last:.1f} s")
        self._silent.discard(frame.side)
        self._heard[frame.side] = frame.t

    def _miss(self, side: str, t: float) -> None:
        """Record sides that are silent at ``t``."""
        if side not in self._silent and t - self._heard[side] > SILENT:
            self._note(self._heard[side], f"{side} silent from now on")
            self._silent.add(side)

    def _loads(self) -> None:
        """Append the load of completed intervals, one interval late to count delayed frames."""
        over = math.floor(self._shown / LOAD_WINDOW) - 1
        if self._bin is None or over <= self._bin:
            return
        for place in range(self._bin, over):
            share = self._bits.pop(place, 0) / self._seen.bitrate / LOAD_WINDOW
            self._put("load", (place + 1) * LOAD_WINDOW, share)
        self._bin = over

    def _note(self, t: float, text: str) -> None:
        self._fresh_events.append((round(t, 4), text))


def state(seen: Observation, *, lost: bool = False) -> tuple[str, str, str]:
    """Return the state as mood ("good", "bad" or "none"), headline and text."""
    silence = {side: seen.silence(side) for side in (CONTROLLER, VEHICLE)}
    heard = [duration for duration in silence.values() if duration is not None]
    ago = f"Last frame {min(heard):.1f} s ago." if heard else "No frame has been seen yet."
    if lost:
        return "bad", "The bus is gone", f"{ago} Reconnecting twice a second."
    if not heard:
        return "none", "The bus is silent", ago
    if min(heard) > SILENT:
        return "bad", "The bus is silent", f"{ago} The figures are the last received."
    for side, duration in silence.items():
        if duration is None:
            return "bad", f"No {side} on the bus", "Only the other side has been heard."
        if duration > SILENT:
            return "bad", f"The {side} is silent", f"Its last frame came {duration:.1f} s ago."
    return "good", "Live", "Controller and vehicle are on the bus."


def _number(signal: str, value: Any) -> float | None:  # noqa: ANN401
    """Return a value as a number, a mode as its index, None for "not available" and errors."""
    if isinstance(value, (int, float)):
        return value
    return float(value.value) if signal == "Mode" else None
