"""What an ECU did with the frames of a recorded drive: accepted, or why not.

A frame is accepted where the firmware says so in the next tick. Of one that it refuses the reason
is found apart from the firmware, by the frame's length, protection and counter.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.memory_image import dtype
from canroll.firmware.calibration import Calibration

FAILURES = {
    "length": "length",
    "not_authentic": "authentication",
    "checksum": "checksum",
    "counter": "counter",
}
"""Why a frame is refused: keys of JSON, and their words."""


@dataclass(frozen=True, slots=True)
class Reception:
    """Frames of one message of the ECU in the log.

    Attributes:
        message: its name in the DBC.
        frames: number of them.
        cycle_ms: cycle time by DBC or map, 0 if neither states one.
        longest_gap_ms: longest time between two, or None with fewer than two.
        late: gaps beyond the calibration's timeout.
        accepted: frames whose data the ECU used.
        replaced: frames that a newer one replaced before the tick.
        synchronising: frames in sequence, passed over as the receiver starts or resynchronises.
        length: frames that are too short.
        not_authentic: frames that the authentication refused.
        checksum: frames with a wrong checksum, data id or other constant of their protection.
        counter: frames with a right checksum whose counter stood still, jumped or is invalid.
        profile: E2E profile of the frame, "" without one.
    """

    message: str
    frames: int
    cycle_ms: float
    longest_gap_ms: float | None
    late: int = 0
    accepted: int = 0
    replaced: int = 0
    synchronising: int = 0
    length: int = 0
    not_authentic: int = 0
    checksum: int = 0
    counter: int = 0
    profile: str = ""

    @property
    def failures(self) -> dict[str, int]:
        """The reasons for which frames were refused, and how many."""
        counts = {word: getattr(self, key) for key, word in FAILURES.items()}
        return {word: count for word, count in counts.items() if count}

    @property
    def refusal(self) -> str:
        """The line on checksums of which none is right, as if the sender formed others; else ""."""
        if not self.profile or not self.checksum:
            return ""
        if self.accepted or self.synchronising or self.counter:
            return ""
        key = "constant" if self.profile == "own" else "data_id"
        return (
            f"{self.message}: {self.checksum} of {self.frames} frames fail their checksum "
            f"(profile {self.profile}): {key}?"
        )

    @property
    def remark(self) -> str:
        """What failed, in one line; "": nothing did."""
        if self.refusal:
            return self.refusal
        parts = [f"{count} by {word}" for word, count in self.failures.items()]
        refusals = f"{' and '.join(parts)} of {self.frames} frames refused" if parts else ""
        late = f"late {self.late} times" if self.late else ""
        return (
            f"{self.message}: {'; '.join(filter(None, (refusals, late)))}"
            if refusals or late
            else ""
        )


@dataclass
class Receiver:
    """Follows the frames into the firmware, and counts by identifier what became of them.

    Attributes:
        firmware: the firmware for the bus.
        calibration: of the ECU.
        counts: by identifier, the frames by fields of :class:`Reception`.
    """

    firmware: BusFirmware
    calibration: Calibration
    counts: dict[int, Counter[str]] = field(init=False)
    _waiting: dict[int, bytes] = field(init=False, default_factory=dict)
    _last: dict[int, int] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.counts = {ident: Counter() for ident in self.firmware.slots}
        self._signals = self.firmware.module("com.signals")
        self._state = dtype(self.firmware.record)

    def received(self, ident: int, payload: bytes, *, authentic: bool) -> None:
        """Count a frame that was given to the firmware."""
        if not authentic:
            self.counts[ident]["not_authentic"] += 1
            return
        padded = list(payload.ljust(self.firmware.room, b"\0"))
        slots = self.firmware.slots[ident]
        # of several mailboxes the first that takes it speaks for all; other pages are of none
        slot = next((slot for slot in slots if self._signals.wanted(slot, padded)), None)
        if slot is None:
            return
        if len(payload) < self._signals.RX_LENGTHS[slot]:
            self.counts[ident]["length"] += 1
            return
        self.counts[ident]["replaced"] += slot in self._waiting
        self._waiting[slot] = payload

    def ticked(self, image: bytes) -> None:
        """Count what the firmware did in a tick, by the state after it."""
        ages = np.frombuffer(image, self._state)["age"][0]
        for slot, payload in self._waiting.items():
            ident = self.firmware.bus.received[slot].ident
            # a message without a timeout is not read
            if self._timeout_ticks(slot):
                self.counts[ident][self._outcome(slot, payload, accepted=ages[slot] == 0)] += 1
        self._waiting.clear()

    def _timeout_ticks(self, slot: int) -> int:
        return int(self.calibration.timeout_ticks[self._signals.RX_MESSAGES[slot]])

    def _outcome(self, slot: int, payload: bytes, *, accepted: bool) -> str:
        protection = self.firmware.bus.received[slot].protection
        if protection is None or (not accepted and not protection.holds(payload)):
            return "accepted" if accepted else "checksum"
        if protection.counter is None:
            return "accepted"
        count, values = protection.counter.read(payload), protection.counter.values
        last = self._last.get(slot, (count - 1) % values)
        self._last[slot] = count
        if accepted:
            return "accepted"
        in_sequence = count < values and (count - last) % values == 1
        return "synchronising" if in_sequence else "counter"

    def receptions(self, times: Mapping[int, NDArray[np.int64]]) -> tuple[Reception, ...]:
        """Return the receptions, given the instants of the frames by identifier, ns."""
        receptions = []
        for ident, (slot, *_) in self.firmware.slots.items():
            box = self.firmware.bus.received[slot]
            gaps = np.diff(times[ident])
            timeout = 1000 * self.calibration.tick_us * self._timeout_ticks(slot)
            receptions.append(
                Reception(
                    box.name,
                    len(times[ident]),
                    box.cycle_ms,
                    1e-6 * float(gaps.max()) if len(gaps) else None,
                    late=int((gaps > timeout).sum()) if timeout else 0,
                    profile=box.protection.profile if box.protection else "",
                    **self.counts[ident],
                )
            )
        return tuple(receptions)
