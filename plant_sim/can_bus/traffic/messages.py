"""Periodic messages, for traffic sets, analysis and simulation."""

from dataclasses import dataclass

from canroll.plant_sim.can_bus.kernel.network import Source
from canroll.plant_sim.can_bus.wire.frame import (
    RECEPTION_BITS_BEFORE_END,
    arbitration_key,
    best_case_bits,
    transmission_ns,
    worst_case_ns,
)
from canroll.plant_sim.kernels.jit import interpreted

_arbitration_key = interpreted(arbitration_key)


@dataclass(frozen=True, slots=True)
class BusMessage:
    """A periodic message: identifier, payload bytes, period and who sends and receives it.

    ``jitter_ns``: greatest time from the nominal release to queueing. ``bits``: if above 0, the
    frame length, interframe space included, instead of that from identifier and payload. ``fifo``:
    it waits in a first-in first-out queue. Only the analysis uses ``distance_ns``, the minimum
    distance of two frames (0: any), and ``deadline_ns`` (0: the period).
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
    distance_ns: int = 0
    deadline_ns: int = 0

    @property
    def arbitration_key(self) -> int:
        """Arbitration key: the lower one wins."""
        return _arbitration_key(self.ident, self.flags)

    def worst_ns(self, bitrate: int, data_bitrate: int = 0) -> int:
        """Return the longest transmission time of its frame, interframe space included, ns."""
        if self.bits:
            return transmission_ns((self.bits, 0), bitrate=bitrate)
        return worst_case_ns(self.length, self.flags, bitrate=bitrate, data_bitrate=data_bitrate)

    def best_ns(self, bitrate: int, data_bitrate: int = 0) -> int:
        """Return the shortest transmission time of its frame, interframe space included, ns."""
        return transmission_ns(self._best_bits, bitrate=bitrate, data_bitrate=data_bitrate)

    def least_delivery_ns(self, bitrate: int, data_bitrate: int = 0) -> int:
        """Return the shortest time from queueing to reception, ns."""
        nominal, data = self._best_bits
        taken = nominal - RECEPTION_BITS_BEFORE_END, data
        return transmission_ns(taken, bitrate=bitrate, data_bitrate=data_bitrate)

    @property
    def _best_bits(self) -> tuple[int, int]:
        return (self.bits, 0) if self.bits else best_case_bits(self.length, self.flags)

    def source(self) -> Source:
        """Return the source of the message for a simulation."""
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
