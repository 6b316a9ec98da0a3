"""Parameters of a bus, and the built-in profiles."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Final

import dbc
from canroll.errors import CanrollError

BITRATES: Final = (10_000, 1_000_000)
"""Least and greatest rate of classic CAN, bit/s."""
DATA_BITRATE_MAX: Final = 8_000_000
GATEWAY_MS_MAX: Final = 1000.0


@dataclass(frozen=True, slots=True)
class BusProfile:
    """Parameters of a bus.

    ``load`` is the total, own messages at their cycle times included; background traffic fills
    the rest, ``above`` of it with identifiers of higher priority than all own messages.
    ``gateway_ms`` (least and greatest latency each way): the ECU has a segment of its own,
    joined to the vehicle's by a gateway. ``data_bitrate``: of FD frames with bit-rate switch, 0:
    as ``bitrate``. ``dbc`` and ``map_file``: the frames that carry our signals, both None for those
    of the contract. ``traffic``: a traffic set that is the background, whatever ``load`` says.
    """

    name: str
    bitrate: int
    load: float
    above: float = 0.5
    gateway_ms: tuple[float, float] | None = None
    data_bitrate: int = 0
    bit_error_rate: float = 0.0
    dbc: Path | None = None
    map_file: Path | None = None
    traffic: Path | None = None

    @property
    def segments(self) -> int:
        """Number of bus segments."""
        return 1 if self.gateway_ms is None else 2


QUICK: Final = BusProfile("500k", 500_000, 0.50)
"""500 kbit/s, half loaded, all nodes on one segment."""
BUSY: Final = BusProfile("125k_busy", 125_000, 0.85)
"""125 kbit/s, 85 % loaded, all nodes on one segment."""
NEAR_GATEWAY: Final = BusProfile("gateway_20ms", 500_000, 0.50, gateway_ms=(5.0, 10.0))
"""500 kbit/s, the ECU behind a gateway of 5 to 10 ms each way."""
FAR_GATEWAY: Final = BusProfile("gateway_50ms", 500_000, 0.50, gateway_ms=(50.0, 50.0))
"""500 kbit/s, the ECU behind a gateway of 50 ms each way."""
FD: Final = BusProfile(
    "fd_2m", 500_000, 0.50, data_bitrate=2_000_000, dbc=dbc.FD_PATH, map_file=dbc.FD_MAP
)
"""CAN FD, 500 kbit/s and 2 Mbit/s, half loaded: one sensor frame of 32 bytes instead of four."""


def accept(what: str, profile: object) -> BusProfile:
    """Return an extension's profile.

    Raises:
        CanrollError: it is no profile, or a figure cannot be.
    """
    if not isinstance(profile, BusProfile):
        raise CanrollError(f"{what}: a {type(profile).__name__}, it must be a BusProfile")
    low, high = BITRATES
    gateway = (0.0, 0.0) if profile.gateway_ms is None else profile.gateway_ms
    rules = {
        f"bitrate {profile.bitrate}: it must be {low} to {high} bit/s": isinstance(
            profile.bitrate, int
        )
        and low <= profile.bitrate <= high,
        f"load {profile.load}: it must be above 0 and below 1": 0.0 < profile.load < 1.0,
        f"above {profile.above}: it must be 0 to 1": 0.0 <= profile.above <= 1.0,
        f"data_bitrate {profile.data_bitrate}: it must be 0, or bitrate to "
        f"{DATA_BITRATE_MAX} bit/s": isinstance(profile.data_bitrate, int)
        and (
            not profile.data_bitrate or profile.bitrate <= profile.data_bitrate <= DATA_BITRATE_MAX
        ),
        f"bit_error_rate {profile.bit_error_rate}: it must be 0 to below 1": 0.0
        <= profile.bit_error_rate
        < 1.0,
        f"gateway_ms {gateway}: two times in order, 0 to {GATEWAY_MS_MAX:g} ms": len(gateway) == 2
        and all(map(isfinite, gateway))
        and 0.0 <= gateway[0] <= gateway[1] <= GATEWAY_MS_MAX,
    }
    for rule, holds in rules.items():
        if not holds:
            raise CanrollError(f"{what}: {rule}")
    return profile
