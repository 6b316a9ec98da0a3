"""What a roll-control bus tells an onlooker: mode, roll, moments, trigger rate, load, troubles."""

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from cantools.database import DecodeError

import dbc
from firmware import plausibility
from hil.realtime.bus_link import Frame
from plant_sim.can_bus.wire.frame import length_of

WINDOW = 2.0
"""Rates and the load are those of the last so many seconds."""
TROUBLES = {
    number: name.removeprefix("TROUBLE_").replace("_", " ").lower()
    for name, number in vars(plausibility).items()
    if name.startswith("TROUBLE_") and isinstance(number, int)
}
"""Trouble codes in words."""


@dataclass(slots=True)
class Observation:
    """What has been seen up to now.

    Attributes:
        bitrate: of the bus, bit/s; a virtual one has none, so it is an assumption.
        frames: number of frames by message name; frames of others under their identifier.
        values: last physical value of every signal, by message and signal.
        undecoded: frames of the contract that it does not explain.
    """

    bitrate: int
    frames: Counter[str] = field(default_factory=Counter)
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    undecoded: int = 0
    _recent: deque[tuple[float, str, int]] = field(default_factory=deque)
    _first: float | None = None
    _now: float = 0.0

    def see(self, t: float, frame: Frame) -> None:
        """Take in a frame seen at ``t`` seconds."""
        ident, payload = frame
        name = f"0x{ident:03X}"
        try:
            message = dbc.load().get_message_by_frame_id(ident)
            name = message.name
            decoded = message.decode(payload)
            assert isinstance(decoded, dict)
            self.values.setdefault(name, {}).update(decoded)
        except DecodeError:
            self.undecoded += 1
        except KeyError:
            pass
        self.frames[name] += 1
        self._recent.append((t, name, sum(length_of(ident, payload))))
        if self._first is None:
            self._first = t
        self.pass_time(t)

    def pass_time(self, t: float) -> None:
        """Forget what lies outside the window that ends at ``t`` seconds."""
        self._now = max(self._now, t)
        while self._recent and self._recent[0][0] < self._now - WINDOW:
            self._recent.popleft()

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
    def troubles(self) -> list[str]:
        """Active trouble codes in words."""
        return _named(self.signal("RollControlDiagnostics", "ActiveTroubles"))

    @property
    def latched_troubles(self) -> list[str]:
        """Trouble codes that have occurred."""
        return _named(self.signal("RollControlDiagnostics", "LatchedTroubles"))

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
            "load": self.load,
            "troubles": self.troubles,
            "latched_troubles": self.latched_troubles,
            "frames": dict(sorted(self.frames.items())),
            "undecoded": self.undecoded,
        }


def _named(bits: Any) -> list[str]:  # noqa: ANN401
    if bits is None:
        return []
    return [TROUBLES.get(i, f"code {i}") for i in range(24) if int(bits) >> i & 1]


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return a named value as its name, a number as it is."""
    return value if value is None or isinstance(value, (int, float)) else str(value)
