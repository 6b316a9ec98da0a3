"""The bus profiles, and their names."""

from typing import TYPE_CHECKING

from canroll.registry import Registry

if TYPE_CHECKING:
    from canroll.plant_sim.buses.profile import BusProfile

_LOG = "canroll.plant_sim.can_bus.network.recorded_profile:read_profile"
LOGS = (".asc", ".blf", ".log", ".mf4", ".csv", ".trc", ".db", ".pcap", ".pcapng")
"""Suffixes of bus logs; each may have that of gzip behind it."""
PACKED = ".gz"

_DATABASES = (".dbc", ".kcd", ".arxml", ".sym")

BUSES: "Registry[BusProfile]" = Registry(
    "bus profile",
    "canroll.buses",
    {
        "500k": "canroll.plant_sim.buses.profile:QUICK",
        "125k_busy": "canroll.plant_sim.buses.profile:BUSY",
        "gateway_20ms": "canroll.plant_sim.buses.profile:NEAR_GATEWAY",
        "gateway_50ms": "canroll.plant_sim.buses.profile:FAR_GATEWAY",
        "fd_2m": "canroll.plant_sim.buses.profile:FD",
        "secured_fd": "canroll.plant_sim.buses.profile:SECURED",
    },
    accept="canroll.plant_sim.buses.profile:accept",
    files={
        **dict.fromkeys((*LOGS, PACKED), _LOG),
        **dict.fromkeys(_DATABASES, "canroll.plant_sim.can_bus.network.network_file:read_traffic"),
        ".toml": "canroll.plant_sim.can_bus.network.network_file:read_profile",
    },
)


def load_profile(name: str) -> "BusProfile":
    """Return the bus profile ``name``, that of a network file, a database, or a log.

    One bus of several in a database, or one channel of several in a log, is ``file#name``; a
    log's bit rates may follow, ``file@500000``.

    Raises:
        UnknownNameError: there is no such profile.
        CanrollError: an extension's profile is invalid, or a log lacks information.
    """
    return BUSES[name]
