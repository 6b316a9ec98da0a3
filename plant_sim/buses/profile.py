"""Parameters of a bus, and the built-in profiles."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from canroll import dbc
from canroll.dbc.reader import Files
from canroll.errors import CanrollError
from canroll.plant_sim.buses.topology import (
    NODES,
    BusGateway,
    BusSegment,
    TimeSpread,
    Topology,
    check_segment,
    check_times,
)
from canroll.plant_sim.kernels.instants import MS


@dataclass(frozen=True, slots=True)
class BusProfile:
    """Parameters of a bus.

    ``load`` is the total, own messages at their cycle times included; background traffic fills
    the rest, ``above`` of it with identifiers of higher priority than all own messages.
    ``gateway_ms`` (least and greatest latency each way): the ECU has a separate segment,
    joined to the vehicle's by a gateway. ``data_bitrate``: of FD frames with bit-rate switch, 0:
    as ``bitrate``. ``dbc`` (a file or several) and ``map_file``: the frames that carry our
    signals, both None for those of the contract.
    ``traffic``: a traffic set that is the background, whatever ``load`` says.
    ``measured``: frames that the ECU's XCP slave sends every so many ms, besides the ``load``.
    ``topology``: segments and gateways of any number; the keys of one bus above are then those of
    the ECU's segment.
    """

    name: str
    bitrate: int
    load: float
    above: float = 0.5
    gateway_ms: tuple[float, float] | None = None
    data_bitrate: int = 0
    bit_error_rate: float = 0.0
    dbc: Files | None = None
    map_file: Path | None = None
    traffic: Path | None = None
    topology: Topology | None = None
    measured: tuple[int, float] = (0, 10.0)

    @property
    def recorded(self) -> bool:
        """Whether its background is frames of a log."""
        return False

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the file of the bus leaves open."""
        return ()

    @property
    def network(self) -> Topology:
        """Segments, gateways and nodes of the network."""
        if self.topology is not None:
            return self.topology
        one = BusSegment(
            "bus",
            self.bitrate,
            self.load,
            self.above,
            self.data_bitrate,
            self.bit_error_rate,
            self.traffic,
        )
        if self.gateway_ms is None:
            return Topology((one,))
        low, high = (int(latency * MS) for latency in self.gateway_ms)
        return Topology(
            (replace(one, name="ecu"), replace(one, name="vehicle")),
            (BusGateway("gateway", (0, 1), TimeSpread(low, high)),),
            {name: int(name != "RollControl") for name in NODES},
        )

    @property
    def segments(self) -> int:
        """Number of bus segments."""
        return len(self.network.segments)


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

SECURED: Final = BusProfile(
    "secured_fd",
    500_000,
    0.50,
    data_bitrate=2_000_000,
    dbc=dbc.SECURED_PATH,
    map_file=dbc.SECURED_MAP,
)
"""CAN FD, 500 kbit/s and 2 Mbit/s, half loaded: the contract's frames, authenticated."""


def accept(what: str, profile: object) -> BusProfile:
    """Return an extension's profile.

    Raises:
        CanrollError: it is not a profile, or a number is invalid.
    """
    if not isinstance(profile, BusProfile):
        raise CanrollError(f"{what}: a {type(profile).__name__}, it must be a BusProfile")
    if profile.gateway_ms is not None:
        if len(profile.gateway_ms) != 2:
            raise CanrollError(f"{what}: gateway_ms {profile.gateway_ms}: two times in order")
        check_times(f"{what}: gateway_ms", *profile.gateway_ms)
    for segment in profile.network.segments:
        check_segment(what, segment)
    return profile
