"""The background of a bus profile."""

from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.can_bus.network.own_frames import own_messages
from canroll.plant_sim.can_bus.network.profiles import routed_messages
from canroll.plant_sim.can_bus.traffic.messages import BusMessage


def background_of(profile: BusProfile, segment: int) -> list[BusMessage]:
    """Return the messages that are sent on a segment and are none of ours."""
    routed = routed_messages(profile)[len(own_messages(profile=profile)) :]
    return [r.message for r in routed if r.home == segment]
