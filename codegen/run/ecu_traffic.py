"""Test traffic for the ECU: received frames per tick, as arrays replayed by every backend.

Recorded runs have the same form. Random traffic is adversarial: valid frames with plausible and
with full-scale values, wrong checksums, jumps and repetitions of the counter, wrong lengths,
reserved codes, silence, missed ticks.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.generated.mailbox import Mailbox
from canroll.codegen.generated.mailbox import room as _room
from canroll.codegen.run.bus_firmware import built_in
from canroll.codegen.run.memory_image import event, event_of, sealed
from canroll.errors import CanrollError
from canroll.firmware.calibration import N_RX, STATE_MAX, Calibration
from canroll.firmware.security.secoc_state import COUNTER_MAX, FRESHNESS_AT, MAC_AT, RESET_MAX
from canroll.firmware.state import RX_ACTUATOR_STATE, Ecu
from canroll.firmware.subset import fields, filled

EVENT = event_of(Ecu)
"""One frame on the built-in bus in the tick before which it arrives, or in which it is sent."""

Frame = tuple[int, bytes]
"""Identifier and payload."""
Payload = NDArray[np.uint8] | bytes
RESERVED_CODES = (0x7FFF, 0x7FFE, 0xFFFF, 0xFFFE)


@dataclass(frozen=True, slots=True)
class EcuTraffic:
    """``frames`` in order of their ticks; ``elapsed`` of each tick, mostly 1."""

    frames: NDArray[np.void]
    elapsed: NDArray[np.int32]

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.elapsed)

    def by_tick(self) -> Iterator[tuple[int, NDArray[np.void]]]:
        """Yield of each tick the elapsed ticks and the frames that arrive before it."""
        bounds = np.searchsorted(self.frames["tick"], np.arange(self.ticks + 1))
        for tick, elapsed in enumerate(self.elapsed.tolist()):
            yield elapsed, self.frames[bounds[tick] : bounds[tick + 1]]


def refused(rule: int) -> CanrollError:
    """The error for a calibration that the ECU's check refuses."""
    return CanrollError(f"the ECU refuses the calibration: rule {rule} of its check")


MONITORS = (
    *("redundancy_", "opposite_", "slide_", "apart_", "bound_"),
    *("mirror_", "clock_", "erratic_", "delivery_", "rolling_", "response_", "axles_", "heave_"),
)
LIMITS = ("envelope_", "steering_limit", "acceleration_change", "acceleration_noise", *MONITORS)
"""Fields that limit what a law takes and gives, by the beginning of their names."""
TIGHT = 3


def random_calibration(seed: int) -> Calibration:
    """A calibration that ``check`` accepts, its coefficients anywhere in their ranges.

    Limits behind the law would hide what it does: they are wide open but for one seed in
    :data:`TIGHT`.
    """
    rng, limits = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    # the ECU's check in Python, which only such a calibration needs
    from canroll.firmware import check  # noqa: PLC0415

    while True:
        record = Calibration()
        for field in fields(Calibration):
            lo, hi = field.f.lo, field.f.hi
            if not field.name.startswith(LIMITS):
                setattr(record, field.name, _random_field(rng, lo, hi, field.shape))
            elif seed % TIGHT:
                setattr(record, field.name, filled(field.shape, hi))
            else:
                setattr(record, field.name, _random_field(limits, lo, hi, field.shape))
        _plausible(record, rng)
        if check.check(record) == 0:
            return sealed(record)


def _random_field(
    rng: np.random.Generator, lo: int, hi: int, shape: tuple[int, ...]
) -> int | list[Any]:
    """Values spread over all magnitudes, including the ends of the range."""
    if hi - lo <= 16:
        return rng.integers(lo, hi + 1, shape).tolist()  # type: ignore[no-any-return]
    top = rng.uniform(0, np.log2(max(hi - lo, 1) + 1), shape)
    spread = np.minimum(2**top, hi - lo).astype(np.int64)
    sign = rng.random(shape) < 0.5
    low, high = max(lo, min(0, hi)), min(hi, max(0, lo))
    values = np.where(sign & (lo < 0), low - spread // 2, high + spread)
    return np.clip(values, lo, hi).tolist()  # type: ignore[no-any-return]


def _plausible(record: Calibration, rng: np.random.Generator) -> None:
    """Sort values that must ascend for ``check``, and keep the ECU active for part of the time."""
    record.tick_us = 10000
    record.e2e = int(rng.random() < 0.8)
    record.timeout_ticks = [5 if rng.random() < 0.8 else 20 for _ in range(N_RX)]
    record.init_ticks = int(rng.integers(1, 8))
    record.recovery_ticks = int(rng.integers(1, 8))
    record.ramp_ticks = int(rng.integers(1, 50))
    record.stuck_ticks = int(rng.integers(5, 60))
    record.roll_rate_max = record.acceleration_max = STATE_MAX
    record.schedule_speed = sorted(rng.choice(200 << 20, 8, replace=False).tolist())
    record.fade_low = int(rng.integers(0, 10 << 20))
    record.fade_high = record.fade_low + int(rng.integers(1, 20 << 20))
    for k in range(2):
        record.rls_lo[k], record.rls_hi[k] = sorted((record.rls_lo[k], record.rls_hi[k]))
    record.status_ticks = int(rng.integers(1, 12))
    record.heartbeat_ticks = int(rng.integers(1, 9))
    record.acknowledge_ticks = int(rng.integers(1, 6))
    for name in ("phi", "covariance_phi"):
        matrix = getattr(record, name)
        for i, row in enumerate(matrix):
            row[i] = max(row[i], 1 << 20)


def random_traffic(
    seed: int,
    ticks: int,
    *,
    hostile: float = 0.15,
    rough: float = 1.0,
    bus: BusMap | None = None,
) -> EcuTraffic:
    """Traffic of all messages over ``ticks``; ``hostile`` is the share of faulty frames.

    With ``rough`` 0 no signal jumps or is reserved, no frame is lost and no tick missed. ``bus``
    defines the frames, by default those of the built-in bus.
    """
    bus = bus or built_in().bus
    boxes = bus.received
    room = max(_room(bus.received), _room(bus.transmitted))
    rng = np.random.default_rng(seed)
    counters = np.zeros(len(boxes), np.int64)
    samples = np.zeros(len(boxes), np.int64)
    words = rng.integers(0, 1 << 48, len(boxes))
    rows = []
    for tick in range(ticks):
        for message in range(len(boxes)):
            if rng.random() < 0.1 * rough:
                continue
            counters[message] = (counters[message] + 1) % _values(boxes[message])
            samples[message] = (samples[message] + 1) % 16
            words[message] = _signals(rng, int(words[message]), rough)
            box = boxes[message]
            payload = _payload(message, int(words[message]), samples[message])
            payload += rng.integers(0, 256, max(box.length - 8, 0)).tolist()
            payload = finished(box, payload, int(counters[message]), room)
            length = box.length
            if rng.random() < hostile:
                payload, length = _spoiled(rng, payload, box)
            rows.append((tick, message, length, payload))
    elapsed = np.ones(ticks, np.int32)
    missed = rng.random(ticks) < 0.02 * rough
    elapsed[missed] = rng.integers(-1, 40, int(missed.sum()))
    return EcuTraffic(np.array(rows, event(room)), elapsed)


def disturbed(
    traffic: EcuTraffic,
    seed: int,
    *,
    quiet: float = 120.0,
    episode: float = 8.0,
    bus: BusMap | None = None,
) -> EcuTraffic:
    """Recorded traffic with hostile episodes: frames lost or corrupted, ticks missed.

    ``quiet`` and ``episode`` are the mean lengths in ticks of undisturbed and disturbed stretches;
    in between the loop recovers, so that all its modes occur. ``bus`` has the frames, by default
    those of the built-in bus.
    """
    boxes = (bus or built_in().bus).received
    rng = np.random.default_rng(seed)
    hurt = _episodes(rng, traffic.ticks, quiet, episode)
    rows = []
    for frame in traffic.frames:
        payload, length = frame["payload"].tolist(), int(frame["length"])
        if hurt[frame["tick"]]:
            if rng.random() < 0.2:
                continue
            if rng.random() < 0.3:
                payload, length = _spoiled(rng, payload, boxes[frame["message"]])
        rows.append((frame["tick"], frame["message"], length, payload))
    elapsed = traffic.elapsed.copy()
    missed = hurt & (rng.random(traffic.ticks) < 0.05)
    elapsed[missed] = rng.integers(-1, 40, int(missed.sum()))
    return EcuTraffic(np.array(rows, traffic.frames.dtype), elapsed)


def storm(
    traffic: EcuTraffic, seed: int, *, calm: float = 15.0, silence: float = 25.0
) -> EcuTraffic:
    """Recorded traffic in which whole ticks are silent and ticks are missed by the dozen.

    Silence and calm alternate, ``silence`` and ``calm`` ticks long on average: a tick's work is
    longest when frames return and everything missed meanwhile is made up.
    """
    rng = np.random.default_rng(seed)
    lost = _episodes(rng, traffic.ticks, calm, silence)
    elapsed = traffic.elapsed.copy()
    missed = rng.random(traffic.ticks) < 0.5
    elapsed[missed] = rng.integers(2, 40, int(missed.sum()))
    frames = traffic.frames[~lost[traffic.frames["tick"]]]
    return EcuTraffic(frames, elapsed)


def flooded(traffic: EcuTraffic, most: int, received: int) -> EcuTraffic:
    """Authenticated traffic to which forged frames are added, so that a tick has ``most``.

    ``received`` is the number of different frames that the ECU receives. Forged are those of
    ``traffic`` with the highest freshness value that a receiver takes: only the MAC tells.
    """
    genuine = traffic.frames[traffic.frames["message"] < received]
    if not len(genuine):
        return traffic
    missing = most - np.bincount(traffic.frames["tick"], minlength=traffic.ticks)
    ticks = np.repeat(np.arange(traffic.ticks), np.maximum(missing, 0))
    forged = genuine[np.arange(len(ticks)) % len(genuine)]
    forged["tick"] = ticks
    newest = ((RESET_MAX << 24) + COUNTER_MAX - 1).to_bytes(6, "big")
    forged["payload"][:, FRESHNESS_AT:MAC_AT] = np.frombuffer(newest, np.uint8)
    frames = np.concatenate([traffic.frames, forged])
    return EcuTraffic(frames[np.argsort(frames["tick"], kind="stable")], traffic.elapsed)


def _episodes(
    rng: np.random.Generator, ticks: int, quiet: float, episode: float
) -> NDArray[np.bool_]:
    """Which of ``ticks`` lie in episodes, from the mean lengths of both."""
    inside = np.zeros(ticks, bool)
    t = int(rng.exponential(quiet))
    while t < ticks:
        length = 1 + int(rng.exponential(episode))
        inside[t : t + length] = True
        t += length + 1 + int(rng.exponential(quiet))
    return inside


def _signals(rng: np.random.Generator, word: int, rough: float) -> int:
    """Random walk of each 16-bit part of the signals, with jumps, also to reserved codes."""
    parts = []
    for k in range(3):
        part = (word >> (16 * k)) & 0xFFFF
        chance = rng.random()
        if chance < 0.03 * rough:
            part = int(rng.integers(0, 1 << 16))
        elif chance < 0.04 * rough:
            part = int(rng.choice(RESERVED_CODES))
        else:
            part = (part + int(rng.integers(-300, 301))) & 0xFFFF
        parts.append(part)
    return parts[0] | parts[1] << 16 | parts[2] << 32


def _payload(message: int, word: int, sample: int) -> list[int]:
    bits = (int(sample) << 60) | (word << 12)
    if message == RX_ACTUATOR_STATE:
        bits = (bits & ~(0xF << 58)) | (int(sample) << 58)
    return list((bits & ((1 << 64) - 1)).to_bytes(8, "little"))


def _values(box: Mailbox) -> int:
    """Number of values of a frame's counter; 15 if it has none."""
    counter = box.protection.counter if box.protection else None
    return counter.values if counter else 15


def finished(box: Mailbox, payload: list[int], counter: int, room: int) -> list[int]:
    """The frame with its page and protection, padded to ``room`` bytes."""
    frame = bytearray(payload[: box.length])
    if box.selector is not None:
        for piece in box.selector.pieces:
            mask = ((1 << piece.width) - 1) << piece.bit
            part = (box.pages[0] >> piece.signal_bit) << piece.bit & mask
            frame[piece.byte] = frame[piece.byte] & ~mask | part
    if box.protection is not None:
        box.protection.apply(frame, counter)
    return [*frame, *bytes(room - box.length)]


def _spoiled(rng: np.random.Generator, payload: list[int], box: Mailbox) -> tuple[list[int], int]:
    kind = int(rng.integers(0, 5))
    payload = list(payload)
    room, used = len(payload), max(box.length, 8)
    if kind == 0:
        payload[int(rng.integers(0, used))] ^= 1 << int(rng.integers(0, 8))
    elif kind == 1:
        payload = finished(box, payload, int(rng.integers(0, 16)), room)
    elif kind == 2:
        return payload, int(rng.integers(-3, 300))
    elif kind == 3:
        payload = rng.integers(0, 256, room).tolist()
        payload = finished(box, payload, int(rng.integers(0, 15)), room)
    else:
        payload = rng.integers(0, 256, room).tolist()
    return payload, box.length
