"""The bus profiles, and their names."""

from typing import TYPE_CHECKING

from canroll.registry import Registry

if TYPE_CHECKING:
    from plant_sim.buses.profile import BusProfile

BUSES: "Registry[BusProfile]" = Registry(
    "bus profile",
    "canroll.buses",
    {
        "500k": "plant_sim.buses.profile:QUICK",
        "125k_busy": "plant_sim.buses.profile:BUSY",
        "gateway_20ms": "plant_sim.buses.profile:NEAR_GATEWAY",
        "gateway_50ms": "plant_sim.buses.profile:FAR_GATEWAY",
    },
    accept="plant_sim.buses.profile:accept",
)


def load_profile(name: str) -> "BusProfile":
    """Return the bus profile ``name``.

    Raises:
        UnknownNameError: there is no such profile.
        CanrollError: an extension's profile that cannot be.
    """
    return BUSES[name]
