"""State of the roll controller observed on its bus: mode, roll, moments, delays, load, faults."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Any, NamedTuple

from cantools.database import DecodeError

import dbc
from firmware import plausibility
from firmware.signals import RX_IDS
from hil.realtime.bus_link import Frame
from plant_sim.can_bus.wire.frame import EXTENDED, REMOTE, length_of

WINDOW = 2.0
"""Rates, delays and the load are those of the last so many seconds."""
SILENT = 0.5
"""A side of which nothing is heard for as long is silent, s; every message comes more often."""
IMU_LATE = 0.1
"""A command that comes so long after the last Imu frame does not answer it, s."""
COUNTS = 15
"""The counters of E2E profile 1 run from 0 to 14; 15 is invalid."""
CONTROLLER, VEHICLE = "controller", "vehicle"
IMU_TO_COMMAND, COMMAND_TO_ACKNOWLEDGEMENT = "imu_to_command", "command_to_acknowledgement"
FAULT_CODES = {
    **{
        place: f"{dbc.load().get_message_by_frame_id(ident).name} late"
        for place, ident in enumerate(RX_IDS)
    },
    **{
        number: name.removeprefix("FAULT_").replace("_", " ").lower()
        for name, number in vars(plausibility).items()
        if name.startswith("FAULT_") and isinstance(number, int)
    },
}
"""Fault codes in words."""


class Seen(NamedTuple):
    """What one frame told: instant (s), message, sender's side, values, delays (s), length.

    ``side`` is None for what is not of the contract; a delay is one that the frame ended.
    """

    t: float
    message: str
    side: str | None
    values: Mapping[str, Any]
    delays: Mapping[str, float]
    bits: int


@dataclass(slots=True)
class Observation:
    """What has been seen up to now.

    Two delays can be told from frames alone, both between instants at which the watching
    interface had them whole: ``imu_to_command`` from the latest Imu frame to a command frame,
    which may rest on an older sample, and ``command_to_acknowledgement`` from a command frame to
    the first ActuatorState frame that echoes its counter.

    Attributes:
        bitrate: of the bus, bit/s; a virtual one has none, so it is an assumption.
        frames: number of frames by message name; frames of others under their identifier.
        values: last physical value of every signal, by message and signal.
        heard: when the controller and the vehicle were last heard, s.
        undecoded: frames of the contract that it does not explain.
        missing: frames that the counter in the message skipped, by message name.
        error_frames: those that the interface reports.
    """

    bitrate: int
    frames: Counter[str] = field(default_factory=Counter)
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    heard: dict[str, float] = field(default_factory=dict)
    undecoded: int = 0
    missing: Counter[str] = field(default_factory=Counter)
    error_frames: int = 0
    _recent: deque[tuple[float, str, int]] = field(default_factory=deque)
    _delays: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)
    _last: dict[str, tuple[float, int]] = field(default_factory=dict)
    _pending: tuple[float, int] | None = None
    _first: float | None = None
    _now: float = 0.0

    def see(self, t: float, frame: Frame, flags: int = 0) -> Seen:
        """Take in a frame seen at ``t`` seconds.

        ``flags`` are those of :mod:`plant_sim.can_bus.wire.frame`.

        The contract has no frames with 29 bits and no remote ones: those only load the bus.
        """
        ident, payload = frame
        name = f"0x{ident:08X}" if flags & EXTENDED else f"0x{ident:03X}"
        values: dict[str, Any] = {}
        delays: dict[str, float] = {}
        side = None
        if not flags & (EXTENDED | REMOTE):
            try:
                message = dbc.load().get_message_by_frame_id(ident)
                name = message.name
                decoded = message.decode(payload)
                assert isinstance(decoded, dict)
                values = decoded
                self.values.setdefault(name, {}).update(values)
                side = CONTROLLER if "RollControl" in message.senders else VEHICLE
                self.heard[side] = t
                delays = self._time(t, name, values)
                self._count(t, name, values)
            except DecodeError:
                self.undecoded += 1
            except KeyError:
                pass
        self.frames[name] += 1
        bits = sum(length_of(ident, payload, flags))
        self._recent.append((t, name, bits))
        if self._first is None:
            self._first = t
        self.pass_time(t)
        return Seen(t, name, side, values, delays, bits)

    def _time(self, t: float, name: str, values: Mapping[str, Any]) -> dict[str, float]:
        """Return the delays that a frame ends, by name, s."""
        ended: dict[str, float] = {}
        if name.endswith("Command"):
            self._pending = t, _raw(values["Counter"])
            imu = self._last.get("Imu")
            if imu is not None and t - imu[0] < IMU_LATE:
                ended[IMU_TO_COMMAND] = t - imu[0]
        elif name == "ActuatorState" and self._pending is not None:
            sent, counter = self._pending
            if _raw(values["AcceptedCounter"]) == counter:
                ended[COMMAND_TO_ACKNOWLEDGEMENT] = t - sent
                self._pending = None
        for delay, duration in ended.items():
            self._delays.setdefault(delay, deque()).append((t, duration))
        return ended

    def _count(self, t: float, name: str, values: Mapping[str, Any]) -> None:
        """Take the frames that a counter skips as missing, except across a silence."""
        counter = _raw(values["Counter"])
        last = self._last.get(name)
        if counter >= COUNTS:
            return
        if last is not None and t - last[0] < SILENT:
            self.missing[name] += max(0, (counter - last[1]) % COUNTS - 1)
        self._last[name] = t, counter

    def pass_time(self, t: float) -> None:
        """Forget what lies outside the window that ends at ``t`` seconds."""
        self._now = max(self._now, t)
        while self._recent and self._recent[0][0] < self._now - WINDOW:
            self._recent.popleft()
        for delays in self._delays.values():
            while delays and delays[0][0] < self._now - WINDOW:
                delays.popleft()

    def silence(self, side: str) -> float | None:
        """Return for how long a side has not been heard, s, None where it never was."""
        return self._now - self.heard[side] if side in self.heard else None

    def delay_ms(self, name: str) -> dict[str, float] | None:
        """Return median and maximum of a delay in the window, ms, None where there is none."""
        times = [1e3 * duration for _, duration in self._delays.get(name, ())]
        return {"median": median(times), "max": max(times)} if times else None

    @property
    def span(self) -> float:
        """Length of the window that is filled, s."""
        return 0.0 if self._first is None else min(WINDOW, self._now - self._first)

    @property
    def load(self) -> float:
        """Share of the bus that the frames seen take, interframe spaces included."""
        bits = sum(bits for _, _, bits in self._recent)
        return bits / self.bitrate / self.span if self.span else 0.0

    def rate(self, name: str) -> float:
        """Frames of message ``name`` a second."""
        count = sum(1 for _, seen, _ in self._recent if seen == name)
        return count / self.span if self.span else 0.0

    @property
    def command(self) -> str | None:
        """The command message in use, None before the first."""
        seen = [name for name in self.frames if name.endswith("Command")]
        return max(seen, key=lambda name: self.frames[name]) if seen else None

    @property
    def trigger_rate(self) -> float | None:
        """Commands sent for every Imu sample, None without either."""
        samples = self.rate("Imu")
        return self.rate(self.command) / samples if samples and self.command else None

    def signal(self, message: str, name: str) -> Any:  # noqa: ANN401
        """Return the last value of a signal, None where it has not been seen."""
        return self.values.get(message, {}).get(name)

    @property
    def fault_codes(self) -> list[str]:
        """Active fault codes as text."""
        return _named(self.signal("RollControlDiagnostics", "ActiveFaultCodes"))

    @property
    def latched_fault_codes(self) -> list[str]:
        """Fault codes that have occurred."""
        return _named(self.signal("RollControlDiagnostics", "LatchedFaultCodes"))

    def summary(self) -> dict[str, Any]:
        """Return the observation as plain data, angles in degrees and moments in N·m."""
        front = self.signal("ActuatorState", "DeliveredMomentFront")
        rear = self.signal("ActuatorState", "DeliveredMomentRear")
        return {
            "mode": _plain(self.signal("RollControlStatus", "Mode")),
            "roll_estimate_deg": _plain(self.signal("RollControlStatus", "RollAngleEstimate")),
            "moment_command_nm": _plain(self.signal("RollControlStatus", "MomentCommand")),
            "moment_delivered_nm": [_plain(front), _plain(rear)],
            "roll_rate_deg_s": _plain(self.signal("Imu", "RollRate")),
            "lateral_acceleration_m_s2": _plain(self.signal("Imu", "LateralAcceleration")),
            "speed_km_h": _plain(self.signal("VehicleMotion", "VehicleSpeed")),
            "command": self.command,
            "commands_per_sample": self.trigger_rate,
            "imu_to_command_ms": self.delay_ms(IMU_TO_COMMAND),
            "command_to_acknowledgement_ms": self.delay_ms(COMMAND_TO_ACKNOWLEDGEMENT),
            "load": self.load,
            "fault_codes": self.fault_codes,
            "latched_fault_codes": self.latched_fault_codes,
            "frames": dict(sorted(self.frames.items())),
            "missing": dict(sorted(self.missing.items())),
            "undecoded": self.undecoded,
            "error_frames": self.error_frames,
        }


def _named(bits: Any) -> list[str]:  # noqa: ANN401
    if bits is None:
        return []
    return [FAULT_CODES.get(i, f"code {i}") for i in range(24) if int(bits) >> i & 1]


def _raw(value: Any) -> int:  # noqa: ANN401
    """Return the number of a value that may have a name."""
    return int(getattr(value, "value", value))


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return a named value as its name, a number as it is."""
    return value if value is None or isinstance(value, (int, float)) else str(value)
