"""A bus log as a bus profile, for ``--bus recording.blf@500000``, or ``recording.blf#1@500000``."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from canroll.errors import CanrollError
from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.can_bus.kernel.layout import Network
from canroll.plant_sim.can_bus.traffic.added_messages import missing_from
from canroll.plant_sim.can_bus.traffic.inference import InferredBus, infer_buses
from canroll.plant_sim.can_bus.traffic.log_name import log_name
from canroll.plant_sim.can_bus.traffic.looped import LoopedFrames, LoopedTraffic, loop_of
from canroll.plant_sim.can_bus.traffic.messages import BusMessage


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedProfile(BusProfile):
    """A recorded bus: bounds use its inferred messages, simulations its frames."""

    bus: InferredBus = field(compare=False)

    @property
    def recorded(self) -> bool:
        """Whether its background is frames of a log."""
        return True

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was left out of the log."""
        return tuple(f"{self.name}: {text}" for text in self.bus.recording.remarks)

    def background(self, own: Sequence[BusMessage]) -> tuple[BusMessage, ...]:
        """Return the recorded messages other than ``own``.

        Raises:
            CanrollError: another recorded message has the identifier of one of them.
        """
        known = {m.message.arbitration_key: m for m in self.bus.messages}
        for message in missing_from(self.bus, own):
            if message.arbitration_key in known:
                inferred = known[message.arbitration_key].message
                raise CanrollError(
                    f"{self.name}: identifier 0x{message.ident:X} is on that bus already"
                    f" ({inferred.length} bytes every {inferred.period_ns * 1e-6:.4g} ms):"
                    f" {message.name} cannot have it"
                )
        taken = {m.arbitration_key for m in own}
        recorded = (m.message for m in self.bus.messages)
        return tuple(m for m in recorded if m.arbitration_key not in taken)

    def loop(self, own: Sequence[BusMessage]) -> LoopedFrames:
        """Return the recorded frames other than those of ``own``, to be repeated."""
        return loop_of(self.bus, {m.arbitration_key for m in own})

    def sent_by(
        self, network: Network, node: int, own: Sequence[BusMessage], *, seed: int
    ) -> LoopedTraffic:
        """Return what sends that loop from a node of a network at time 0."""
        return LoopedTraffic(network, node, self.loop(own), seed=seed)


def read_profile(name: str) -> RecordedProfile:
    """Return the profile of a log, or of one channel of it, with its bit rates.

    ``log.blf@500000``, ``log.blf#channel@500000/2000000``.

    Raises:
        CanrollError: it cannot be read, has no such channel or several, or its name has no bit
            rate.
    """
    log = log_name(name)
    if log is None:
        raise CanrollError(f"{name}: no bus log")
    bus, *others = infer_buses(**log._asdict())
    if others:
        names = ", ".join(f"{log.path}#{known.channel}" for known in (bus, *others))
        raise CanrollError(f"{log.path}: choose a channel of it: {names}")
    return RecordedProfile(
        name=name, bitrate=bus.bitrate, data_bitrate=bus.data_bitrate, load=bus.load, bus=bus
    )
