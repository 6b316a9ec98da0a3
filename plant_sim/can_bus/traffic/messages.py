"""A periodic message as traffic sets, analysis and simulation all describe it."""

from dataclasses import dataclass

from plant_sim.can_bus.kernel.network import Source
from plant_sim.can_bus.wire.frame import best_case_bits, transmission_ns, worst_case_bits


@dataclass(frozen=True, slots=True)
class BusMessage:
    """A periodic message: identifier, payload bytes, period and who sends and receives it.

    ``jitter_ns`` is the greatest time from the nominal release to the queueing; ``bits`` above 0
    gives the frame length, interframe space included, instead of identifier and payload; ``fifo``:
    it waits in a first-in first-out queue.
    """

    name: str
    ident: int
    length: int
    period_ns: float
    sender: str = "Background"
    receivers: tuple[str, ...] = ()
    jitter_ns: int = 0
    offset_ns: int = 0
    flags: int = 0
    bits: int = 0
    fifo: bool = False

    def worst_ns(self, bitrate: int, data_bitrate: int = 0) -> int:
        """Return the longest time its frame can take, interframe space included."""
        bits = (self.bits, 0) if self.bits else worst_case_bits(self.length, self.flags)
        return transmission_ns(bits, bitrate=bitrate, data_bitrate=data_bitrate)

    def best_ns(self, bitrate: int, data_bitrate: int = 0) -> int:
        """Return the shortest time its frame can take, interframe space included."""
        bits = (self.bits, 0) if self.bits else best_case_bits(self.length, self.flags)
        return transmission_ns(bits, bitrate=bitrate, data_bitrate=data_bitrate)

    def source(self) -> Source:
        """Return the source that sends it in a simulation."""
        return Source(
            node=self.sender,
            ident=self.ident,
            length=self.length,
            period_ns=self.period_ns,
            offset_ns=self.offset_ns,
            jitter_ns=self.jitter_ns,
            flags=self.flags,
            bits=self.bits,
        )
