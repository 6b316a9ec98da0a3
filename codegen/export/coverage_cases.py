"""Cases that take the exported C through every statement and branch, each with its result.

One calibration runs a part of the code only. The cases run many: random ones on hostile frames,
some that reach what chance does not, and one for every rule that refuses a calibration. A case is a
calibration, frames, ticks, and what the reference gave: the rule of ``init`` and all states. What
no case reaches is in :data:`UNREACHED`, with the reason.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from codegen.export.sessions.session import Session
from codegen.generated.bus_map import BusMap
from codegen.run import memory_image, native
from codegen.run.bus_firmware import BusFirmware
from codegen.run.ecu_traffic import EcuTraffic, finished, random_calibration, random_traffic
from firmware.calibration import (
    BARS,
    BYPASS,
    COEFFICIENT,
    COMPENSATOR,
    CONSTANT_GAIN,
    DAMPERS,
    ONE,
    OUTPUT_FEEDBACK,
    STATE_FEEDBACK,
    STATE_MAX,
    SUSPENSION,
    VALVES,
    Calibration,
)
from firmware.state import (
    N_TX,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_ROLL_REFERENCE,
    RX_SUSPENSION_RATE,
    RX_VEHICLE_MOTION,
)

SEEDS = (363, 542, 603, 604, 621, 625, 627)
"""Of the random cases; chosen by what each adds."""
TICKS = 80
NEVER = -1
FLIPPED = 8
"""Byte of the calibration, from its end, in which a bit flips."""
COUNTS = (
    *("apart_samples", "bound_samples", "delivery_samples"),
    *("rolling_ticks", "response_ticks", "heave_ticks"),
)
"""Samples in a row before a monitor accuses."""
LEAST = ("redundancy_min", "delivery_min", "rolling_min", "response_min", "heave_min")
"""What a monitor may find and not accuse; none of it switches the monitor off."""
FULL = 1 << 20
"""The most ticks that can pass between two."""

LAST = "the last of all there are: no other is asked for"
ONE_FRAME = "a message of one frame brings all its signals"
UNREACHED = {
    (
        "canroll_envelope.c",
        "if ((value < low) || (value > high)) {",
    ): "the allocation keeps within the same limits",
    ("canroll_event_trigger.c", "if (ecu->commands_sent < INT32_MAX) {"): "it takes 2^31 commands",
    (
        "canroll_mailbox.c",
        "if (canroll_signals_wanted(frame, payload) == 0) {",
    ): "only frames with pages have one that is not wanted",
    (
        "canroll_observer.c",
        "if (((int32_t)ecu->fresh[CANROLL_RX_IMU] & 1) == 0) {",
    ): ONE_FRAME,
    (
        "canroll_observer.c",
        "if ((ecu->speed == 0) || (((int32_t)ecu->fresh[CANROLL_RX_IMU] & 2) == 0)) {",
    ): ONE_FRAME,
    (
        "canroll_plausibility.c",
        "if (((int32_t)canroll_signals_rx_signals[message] & needed) != 0) {",
    ): "a message whose first frame carries nothing that is needed has several frames",
    (
        "canroll_plausibility.c",
        "if ((bad == 0) || (timeout == 0)) {",
    ): "a message that is not needed is not read, so it is never bad",
    ("canroll_signals.c", "} else if ((int32_t)ecu->diagnostics_page == 6) {"): LAST,
    ("canroll_signals.c", "} else if (number == CANROLL_RX_ROLL_REFERENCE) {"): LAST,
    ("canroll_signals.c", "} else if (message == CANROLL_TX_DIAGNOSTICS) {"): LAST,
}
"""Lines of the C, on the built-in frames, with a branch that no case takes, and why."""


@dataclass(frozen=True, slots=True)
class Case:
    """One calibration on some frames; in tick ``flipped`` a bit of the calibration flips."""

    name: str
    record: Calibration
    traffic: EcuTraffic
    flipped: int = NEVER


def cases(bus: BusMap) -> Iterator[Case]:
    """Yield the cases for the frames of a bus."""
    for seed in SEEDS:
        traffic = random_traffic(seed, TICKS, bus=bus)
        yield Case(f"random {seed}", random_calibration(seed), traffic)
    yield from _rare(bus)
    yield from _refused(bus)


def cases_of(record: Calibration, bus: BusMap) -> Iterator[Case]:
    """Yield cases of one calibration, for code that takes no other, and of what it refuses."""
    for seed in SEEDS:
        traffic = random_traffic(seed, TICKS, bus=bus)
        yield Case(f"random {seed}", record, traffic)
    longer = np.concatenate([traffic.elapsed, np.ones(1000, np.int32)])
    yield Case("a flipped bit", record, EcuTraffic(traffic.frames, longer), flipped=10)
    none = EcuTraffic(traffic.frames[:0], np.full(2100, FULL, np.int32))
    yield Case("the clock wraps", record, none)
    for name in ("law", "moment_max", "force_max"):
        other = Calibration()
        memory_image.fill(other, memory_image.image(record))
        value = getattr(other, name)
        setattr(other, name, [value[0] ^ 1, *value[1:]] if name == "force_max" else value ^ 1)
        yield Case(f"another {name}", other, EcuTraffic(none.frames, none.elapsed[:2]))


def _rare(bus: BusMap) -> Iterator[Case]:
    """What chance does not reach."""
    quiet = random_traffic(1, 240, hostile=0.0, rough=0.0, bus=bus)
    learns: dict[str, object] = {
        "identification": 1,
        "observer": CONSTANT_GAIN,
        "rls_decimation": 1,
    }
    learns |= {"law": STATE_FEEDBACK, "actuator": SUSPENSION, "compensator_outputs": 1}
    for gate, trace in ((0, 1 << 25), (1 << 26, 1)):
        changes = learns | {"rls_gate": gate, "rls_trace_max": trace, "init_ticks": 1}
        yield Case("identification", _changed(1, **changes), quiet)
    frames = random_traffic(2, TICKS, bus=bus)
    longer = np.concatenate([frames.elapsed, np.ones(1000, np.int32)])
    plain: dict[str, object] = {"law": STATE_FEEDBACK, "actuator": SUSPENSION}
    for starting in (1, 100_000):
        flipped = _changed(2, **plain, compensator_outputs=1, init_ticks=starting)
        yield Case("a flipped bit", flipped, EcuTraffic(frames.frames, longer), flipped=10)
    quiet = random_traffic(1, 40, hostile=0.0, rough=0.0, bus=bus)
    zeros: dict[str, object] = {
        "law": COMPENSATOR,
        "compensator_b": [[0] * 4] * 8,
        "compensator_d": [[0] * 4] * 2,
    }
    bad: dict[str, object] = {
        "acceleration_max": 0,
        "actuator": SUSPENSION,
        "compensator_outputs": 1,
    }
    bad |= {"observer": CONSTANT_GAIN, "init_ticks": 1}
    for name, changes in {
        "the law reads no lateral acceleration": zeros,
        "a compensator's states read it": zeros | {"compensator_b": [[0, 0, 1, 0]] * 8},
        "a compensator's output reads it": zeros | {"compensator_d": [[0, 0, 1, 0]] * 2},
        "output feedback of it": {"law": OUTPUT_FEEDBACK, "output_gain": [0, 1, 0]},
        "output feedback without it": {"law": OUTPUT_FEEDBACK, "output_gain": [1, 0, 0]},
        "nothing reads it": zeros | {"measurements": 1, "identification": 0},
        "identification reads it": zeros | {"measurements": 1, "identification": 1},
        "nothing else is measured": zeros | {"measurements": 2, "identification": 0},
        "identification reads the roll rate": zeros | {"measurements": 2, "identification": 1},
    }.items():
        yield Case(name, _changed(1, **{**bad, **changes}), quiet)
    optional: dict[str, object] = {
        "law": STATE_FEEDBACK,
        "actuator": SUSPENSION,
        "compensator_outputs": 1,
    }
    optional["timeout_ticks"] = [5, 5, 0, 0, 0]
    yield Case("inputs that are not needed", _changed(1, **optional), quiet)
    optional |= {"observer": BYPASS, "timeout_ticks": [0, 5, 0, 0, 5]}
    yield Case("bypass", _changed(1, **optional), quiet)
    outward = _follows_acceleration()
    for seed in (1, 2, 3):
        swaying = random_traffic(seed, 240, hostile=0.0, rough=1.0, bus=bus)
        pushes = (
            {"actuator": SUSPENSION, "slew_max": STATE_MAX, "envelope_ticks": 2},
            {"actuator": SUSPENSION, "slew_max": 1 << 14, "envelope_ticks": 2},
            {"actuator": VALVES, "law": COMPENSATOR, "compensator_outputs": 2, "envelope_ticks": 1},
        )
        for push in pushes:
            yield Case("outward", _changed(1, **{**outward, **push}), swaying)
    straight: dict[str, object] = {
        "law": STATE_FEEDBACK,
        "actuator": SUSPENSION,
        "compensator_outputs": 1,
        "roll_rate_max": STATE_MAX,
        "acceleration_max": STATE_MAX,
        "offset_learning": 1,
        "observer": CONSTANT_GAIN,
        "straight_steering": STATE_MAX,
        "straight_yaw_rate": STATE_MAX,
        "fade_low": 0,
    }
    for fast in (1, 200 << 20):
        yield Case("straight on", _changed(1, **straight | {"fade_high": fast}), quiet)
    stopped = _zeroed(quiet, bus, RX_VEHICLE_MOTION, "speed")
    yield Case("standing still", _changed(1, **straight | {"fade_high": 1}), stopped)
    yield from _accused(bus)
    none = EcuTraffic(frames.frames[:0], np.full(2100, FULL, np.int32))
    yield Case("the clock wraps", _changed(3), none)
    alien = frames.frames[:4].copy()
    alien["message"] = (-1, len(bus.received) + N_TX, 99, -(2**31))
    yield Case("no such message", _changed(4), EcuTraffic(alien, frames.elapsed[:8]))
    foreign = frames.frames[:N_TX].copy()
    foreign["message"] = len(bus.received) + np.arange(N_TX)
    foreign["tick"] = np.arange(N_TX)
    slow: dict[str, object] = {"clock_period": 20_000, "clock_limit": 25_000, "tick_us": 10_000}
    for window in (2, 10_000):
        clocked = {**slow, "clock_window": window, "timeout_ticks": [5, 5, 0, 5, 0]}
        yield Case("another clock", _changed(4, **clocked), quiet)
    own = _changed(4, recovery_ticks=3)
    yield Case("own identifiers", own, EcuTraffic(foreign, frames.elapsed[:8]))


def _accused(bus: BusMap) -> Iterator[Case]:
    """Monitors that are quick to accuse."""
    quick: dict[str, object] = {
        "law": STATE_FEEDBACK,
        "compensator_outputs": 1,
        "observer": CONSTANT_GAIN,
        "measurements": 3,
        "init_ticks": 1,
        "fade_low": 0,
        "fade_high": 1,
        "redundancy_min": 1,
        "redundancy_share": 0,
        "redundancy_limit": STATE_MAX,
        "opposite_min": 0,
        "slide_max": 0,
        "delivery_window": 3,
        "delivery_min": 1,
        "rolling_min": 1,
        "response_min": 1,
        "axles_min": 1,
        "axles_rest": STATE_MAX // 2,
        "heave_min": 1,
    }
    mirrored: dict[str, object] = {
        "actuator": SUSPENSION,
        "schedule_steering": [1 << 21] * 8,
        "mirror_min": 8 << 24,
        "redundancy_pass": [ONE >> shift for shift in (11, 7, 3, 4)],
    }
    frames = random_traffic(1, TICKS, bus=bus)
    none: dict[str, object] = {**dict.fromkeys(LEAST, 0), "clock_period": 0}
    yield Case("no monitors", _changed(1, **none), frames)
    for seed in (1, 2):
        swaying = random_traffic(seed, 240, hostile=0.0, rough=1.0, bus=bus)
        for samples in (1, 3):
            counts = dict.fromkeys(COUNTS, samples)
            for actuator in (SUSPENSION, BARS):
                for limits in ({"redundancy_limit": 1 << 20}, {"bias_max": 0}, {"axles_rest": 0}):
                    changes = {**quick, **counts, **limits, "actuator": actuator}
                    yield Case("accused", _changed(1, **changes), swaying)
    swaying = random_traffic(7, 240, hostile=0.0, rough=1.0, bus=bus)
    for limit in (0, STATE_MAX):
        changes = {**quick, **mirrored, "mirror_limit": limit}
        yield Case("mirrored", _changed(1, **changes), swaying)
    rigid: dict[str, object] = {
        "response_min": STATE_MAX // 2,
        "steady_min": 1 << 26,
        "response_stroke": [0, 0],
        "response_rough": [0, 0],
        "response_fast": [0, 0],
        "response_inertia": 0,
        "response_lateral": 1 << 21,
        "response_pass": ONE,
        "response_wash": [ONE // 2, 0, 0],
        "response_share": [0] * 6,
        "limit_share": [0] * 2,
        "lateral_share": [0] * 3,
        "steady_share": [1 << 10, 1 << 10, 0],
        "redundancy_min": 0,
    }
    calm = {**quick, **dict.fromkeys(COUNTS, 1), **rigid, "actuator": BARS}
    for seed in (18, 37):
        swaying = random_traffic(seed, 240, hostile=0.0, rough=1.0, bus=bus)
        moves = (swaying.frames["message"] != RX_VEHICLE_MOTION) | (swaying.frames["tick"] < 20)
        yield Case("calm", _changed(1, **calm), swaying)
        yield Case(
            "calm, then no motion",
            _changed(1, **calm),
            EcuTraffic(swaying.frames[moves], swaying.elapsed),
        )
    gentle = _changed(1, **calm | {"response_lateral": 1 << 20})
    for seed in (5, 430):
        swaying = random_traffic(seed, 240, hostile=0.0, rough=1.0, bus=bus)
        yield Case("calm, then no yaw rate", gentle, swaying)
    # the first leaves much of the lateral force over at once, the second little for long
    swaying = random_traffic(18, 300, hostile=0.0, rough=1.0, bus=bus)
    for response_pass in (ONE, 1 << 24):
        heavy = {**calm, "response_pass": response_pass}
        yield Case("the model is right, or not", _changed(1, **heavy), swaying)
    swaying = random_traffic(1, 240, hostile=0.0, rough=1.0, bus=bus)
    still = _zeroed(swaying, bus, RX_IMU, "lateral_acceleration")
    for samples in (1, 3):
        counts = dict.fromkeys(COUNTS, samples)
        yield Case("frozen", _changed(1, **quick, **counts, actuator=BARS), still)


def _zeroed(traffic: EcuTraffic, bus: BusMap, message: int, name: str) -> EcuTraffic:
    """Traffic in which a signal of a message stays zero."""
    box, frames = bus.received[message], traffic.frames.copy()
    for number in np.flatnonzero(frames["message"] == message):
        payload = frames["payload"][number].tolist()
        for signal in box.signals:
            if signal.place.text == name:
                for piece in signal.pieces:
                    payload[piece.byte] &= ~((1 << piece.width) - 1 << piece.bit)
        frames["payload"][number] = finished(box, payload, box.count(payload), len(payload))
    return EcuTraffic(frames, traffic.elapsed)


def _follows_acceleration() -> dict[str, object]:
    """A law that pushes the body outward in every curve, which the envelope soon ends."""
    return {
        "law": OUTPUT_FEEDBACK,
        "output_gain": [0, COEFFICIENT, 0],
        "output_gain_shift": 24,
        "observer": CONSTANT_GAIN,
        "compensator_outputs": 1,
        "init_ticks": 1,
        "moment_max": STATE_MAX,
        "schedule_gain": [ONE] * 8,
        "envelope_outward": 0,
        "envelope_lateral": 0,
    }


def _refused(bus: BusMap) -> Iterator[Case]:
    """A calibration for every rule of the check."""
    traffic = EcuTraffic(random_traffic(0, 1, bus=bus).frames[:0], np.ones(2, np.int32))
    plain: dict[str, object] = {
        "law": STATE_FEEDBACK,
        "actuator": SUSPENSION,
        "observer": CONSTANT_GAIN,
    }
    plain |= {"compensator_outputs": 1}
    wanting: dict[str, dict[str, object]] = {
        "a byte out of its range": {"law": 7},
        "a word out of its range": {"tick_us": 0},
        "speeds do not ascend": {"schedule_points": 8, "schedule_speed": [0] * 8},
        "the fade has no width": {"fade_low": 1 << 20, "fade_high": 1 << 20},
        "ratios exclude each other": {"rls_lo": [9, 9], "rls_hi": [1, 1]},
        "valves without compensator": {"actuator": VALVES},
        "two outputs without compensator": {"compensator_outputs": 2},
        "two outputs on dampers": {
            "law": COMPENSATOR,
            "compensator_outputs": 2,
            "actuator": DAMPERS,
        },
        "no Imu": {"timeout_ticks": _without(RX_IMU)},
        "bypass without reference": {
            "observer": BYPASS,
            "timeout_ticks": _without(RX_ROLL_REFERENCE),
        },
        "dampers without their speed": {
            "actuator": DAMPERS,
            "timeout_ticks": _without(RX_SUSPENSION_RATE),
        },
        "dampers without their moment": {
            "actuator": DAMPERS,
            "timeout_ticks": _without(RX_ACTUATOR_STATE),
        },
        "no speed": {"timeout_ticks": _without(RX_VEHICLE_MOTION)},
    }
    for name, changes in wanting.items():
        yield Case(name, _changed(0, **(plain | changes)), traffic)
    wrong = _changed(0, **plain)
    wrong.crc ^= 1
    yield Case("a wrong CRC", wrong, traffic)


def _without(message: int) -> list[int]:
    return [0 if k == message else 5 for k in range(5)]


@cache
def _base(seed: int) -> bytes:
    return memory_image.image(random_calibration(seed))


def _changed(seed: int, **changes: object) -> Calibration:
    record = Calibration()
    memory_image.fill(record, _base(seed))
    for name, value in changes.items():
        setattr(record, name, value)
    return memory_image.sealed(record)


def general(firmware: BusFirmware) -> str:
    """Return the cases of a firmware for all calibrations; see :func:`source`."""
    return _kept(firmware, "all calibrations", lambda: cases(firmware.bus))


def special(firmware: BusFirmware, record: Calibration) -> str:
    """Return those of :func:`cases_of` a calibration, as ``firmware``, the general one, answers."""
    one = memory_image.image(record).hex()
    return _kept(firmware, f"the calibration {one}", lambda: cases_of(record, firmware.bus))


def _kept(firmware: BusFirmware, of: str, chosen: Callable[[], Iterable[Case]]) -> str:
    """The cases as text: running them takes seconds, so it is kept on disk."""
    what = f"coverage cases of {of} on {firmware.bus!r}"
    return firmware.kept(what, lambda: {"text": source(firmware, list(chosen()))})["text"]


def source(firmware: BusFirmware, chosen: Sequence[Case]) -> str:
    """Return the cases as a session in C, each a part of it."""
    session = Session(native.NativeMachine(firmware), firmware, gains=False)
    cal = session.record(Calibration())
    ecu = session.record(firmware.record())
    for case in chosen:
        session.begin(case.name)
        cal.fill(memory_image.image(case.record))
        ecu.fill(bytes(len(ecu.image())))
        session.call("init", ecu, cal)
        session.digest(ecu)
        for tick, (elapsed, frames) in enumerate(case.traffic.by_tick()):
            if tick == case.flipped:
                cal.flip(len(cal.image()) - FLIPPED)
            session.tick(ecu, cal, elapsed, frames)
    return session.source(
        "Cases for every statement and branch: calibration, frames, all states.",
        f"{len(chosen)} cases, all states as the reference",
    )


def table() -> str:
    """What no case reaches, as Markdown."""
    rows = []
    for (file, line), why in UNREACHED.items():
        text = line.strip("{} ").replace("|", r"\|")
        rows.append(f"| `{file}` | `{text}` | {why} |")
    return "\n".join(["| file | branch not taken | why |", "| --- | --- | --- |", *rows])
