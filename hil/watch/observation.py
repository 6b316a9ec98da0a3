"""State of the roll controller observed on its bus: mode, roll, moments, delays, load, faults."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from cantools.database import DecodeError

from canroll import dbc
from canroll.hil.bus_link import Frame
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, REMOTE, length_of
from canroll.reaction.fault_codes import in_words

WINDOW = 2.0
"""Window of rates, delays and load, s."""
SILENT = 0.5
"""Time after which an unheard message counts as silent, s; every one is more frequent."""
IMU_LATE = 0.1
"""Time after the last Imu frame beyond which a command does not belong to it, s."""
COUNTS = 15
"""The counters of E2E profile 1 run from 0 to 14; 15 is invalid."""
IMU_TO_COMMAND, COMMAND_TO_ACKNOWLEDGEMENT = "imu_to_command", "command_to_acknowledgement"


@dataclass(slots=True)
class Observation:
    """State accumulated from all frames so far.

    Two delays can be determined from frames alone, both between instants of complete reception at
    the watching interface: ``imu_to_command`` from the latest Imu frame to a command frame,
    which may rest on an older sample, and ``command_to_acknowledgement`` from a command frame to
    the first ActuatorState frame that echoes its counter.

    Attributes:
        bitrate: bit rate of the bus, bit/s; an assumption for a virtual bus, which has none.
        frames: number of frames by message name, or by identifier outside the contract.
        values: last physical value of every signal, by message and signal.
        undecoded: frames of the contract that could not be decoded.
        missing: frames skipped by the counter, by message name.
        error_frames: number of error frames reported by the interface.
    """

    bitrate: int
    frames: Counter[str] = field(default_factory=Counter)
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    undecoded: int = 0
    missing: Counter[str] = field(default_factory=Counter)
    error_frames: int = 0
    _recent: deque[tuple[float, str, int]] = field(default_factory=deque)
    _delays: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)
    _last: dict[str, tuple[float, int]] = field(default_factory=dict)
    _pending: tuple[float, int] | None = None
    _first: float | None = None
    _now: float = 0.0

    def see(self, t: float, frame: Frame, flags: int = 0) -> None:
        """Process a frame received at ``t`` seconds.

        ``flags`` are those of :mod:`canroll.plant_sim.can_bus.wire.frame`.

        The contract has no 29-bit identifiers and no remote frames: those only load the bus.
        """
        ident, payload = frame
        name = f"0x{ident:08X}" if flags & EXTENDED else f"0x{ident:03X}"
        if not flags & (EXTENDED | REMOTE):
            try:
                message = dbc.load().get_message_by_frame_id(ident)
                name = message.name
                decoded = message.decode(payload)
                assert isinstance(decoded, dict)
                self.values.setdefault(name, {}).update(decoded)
                self._time(t, name, decoded)
                self._count(t, name, decoded)
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

    def _time(self, t: float, name: str, values: Mapping[str, Any]) -> None:
        """Keep the delays that end with a frame."""
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

    def _count(self, t: float, name: str, values: Mapping[str, Any]) -> None:
        """Count frames skipped by a counter as missing, except across a silence."""
        counter = _raw(values["Counter"])
        last = self._last.get(name)
        if counter >= COUNTS:
            return
        if last is not None and t - last[0] < SILENT:
            self.missing[name] += max(0, (counter - last[1]) % COUNTS - 1)
        self._last[name] = t, counter

    def pass_time(self, t: float) -> None:
        """Drop data outside the window that ends at ``t`` seconds."""
        self._now = max(self._now, t)
        while self._recent and self._recent[0][0] < self._now - WINDOW:
            self._recent.popleft()
        for delays in self._delays.values():
            while delays and delays[0][0] < self._now - WINDOW:
                delays.popleft()

    def delay_ms(self, name: str) -> dict[str, float] | None:
        """Return median and maximum of a delay in the window, ms, or None without any."""
        times = [1e3 * duration for _, duration in self._delays.get(name, ())]
        return {"median": median(times), "max": max(times)} if times else None

    @property
    def span(self) -> float:
        """Length of the filled part of the window, s."""
        return 0.0 if self._first is None else min(WINDOW, self._now - self._first)

    @property
    def load(self) -> float:
        """Bus load of the frames in the window, interframe spaces included."""
        bits = sum(bits for _, _, bits in self._recent)
        return bits / self.bitrate / self.span if self.span else 0.0

    def rate(self, name: str) -> float:
        """Frames of message ``name`` per second."""
        count = sum(1 for _, seen, _ in self._recent if seen == name)
        return count / self.span if self.span else 0.0

    @property
    def command(self) -> str | None:
        """The command message in use, None before the first."""
        seen = [name for name in self.frames if name.endswith("Command")]
        return max(seen, key=lambda name: self.frames[name]) if seen else None

    @property
    def trigger_rate(self) -> float | None:
        """Commands sent per Imu sample, None without either."""
        samples = self.rate("Imu")
        return self.rate(self.command) / samples if samples and self.command else None

    def signal(self, message: str, name: str) -> Any:  # noqa: ANN401
        """Return the last value of a signal, or None if not yet received."""
        return self.values.get(message, {}).get(name)

    @property
    def fault_codes(self) -> list[str]:
        """Active fault codes as text."""
        return in_words(self.signal("RollControlDiagnostics", "ActiveFaultCodes"))

    @property
    def latched_fault_codes(self) -> list[str]:
        """Fault codes that have occurred."""
        return in_words(self.signal("RollControlDiagnostics", "LatchedFaultCodes"))

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


def _raw(value: Any) -> int:  # noqa: ANN401
    """Return the number of a value that may be named."""
    return int(getattr(value, "value", value))


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return a named value as its name, a number as it is."""
    return value if value is None or isinstance(value, (int, float)) else str(value)
