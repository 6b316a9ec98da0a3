"""The key of authenticated frames."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from canroll.errors import CanrollError
from dbc.keys import DEVELOPMENT_KEY, read_key
from plant_sim.can_bus import BusProfile
from plant_sim.can_bus.network.own_frames import secured


def refuse_useless_key(choices: Mapping[str, Any], profile: BusProfile) -> None:
    """Raise CanrollError for a key that cannot be read, or on a bus that uses none."""
    key = choices.get("key")
    if key is None:
        return
    if not secured(profile):
        raise CanrollError(
            f"--key: the frames of bus {profile.name} are not authenticated: omit it, or choose "
            "--bus secured_fd"
        )
    read_key(Path(key))


def secret_of(choices: Mapping[str, Any]) -> bytes:
    """Return the key of authenticated frames for ``choices``.

    Raises:
        CanrollError: the file cannot be read, or holds no key.
    """
    key = choices.get("key")
    return DEVELOPMENT_KEY if key is None else read_key(Path(key))


def refuse_authenticated(profile: BusProfile, command: str) -> None:
    """Raise CanrollError where ``command`` cannot authenticate frames and a bus demands it."""
    if secured(profile):
        raise CanrollError(
            f"{command} cannot authenticate the frames of bus {profile.name}: choose another --bus"
        )
