"""Cases that take the exported C through every statement and branch, each with its result.

One calibration runs a part of the code only. The cases run many: random ones on hostile frames,
and those of ``coverage_cases.toml``, some that reach what chance does not, and one for every rule
that refuses a calibration. A case is a calibration, frames, ticks, and what the reference gave: the
rule of ``init`` and all states. What no case reaches is in :data:`UNREACHED`, with the reason.
"""

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.export.sessions.session import Session
from canroll.codegen.generated.bus_map import BusMap
from canroll.codegen.run import memory_image, native
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.ecu_traffic import EcuTraffic, finished, random_calibration, random_traffic
from canroll.firmware import calibration as constants
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import N_TX, RX_VEHICLE_MOTION

SEEDS = (363, 542, 603, 604, 621, 625, 627)
"""Of the random cases; chosen by what each adds."""
TICKS = 80
NEVER = -1
FLIPPED = 8
"""Byte of the calibration, from its end, in which a bit flips."""
FULL = 1 << 20
"""The most ticks that can pass between two."""
TABLES = {"calibration", "traffic"}
DOCUMENT = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
UNREACHED: dict[tuple[str, str], str] = {
    (file, line): why
    for file, lines in DOCUMENT["unreached"].items()
    for line, why in lines.items()
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
    for table in DOCUMENT["case"]:
        for choice in product(*table.get("axes", [])):
            yield _case(reduce(_merged, choice, table), bus)


def cases_of(record: Calibration, bus: BusMap) -> Iterator[Case]:
    """Yield cases of one calibration, for code that takes no other, and of what it refuses."""
    for seed in SEEDS:
        traffic = random_traffic(seed, TICKS, bus=bus)
        yield Case(f"random {seed}", record, traffic)
    longer = _traffic({"seed": SEEDS[-1], "silence": 1000}, bus)
    yield Case("a flipped bit", record, longer, flipped=10)
    none = EcuTraffic(traffic.frames[:0], np.full(2100, FULL, np.int32))
    yield Case("the clock wraps", record, none)
    for name in ("law", "moment_max", "force_max"):
        other = Calibration()
        memory_image.fill(other, memory_image.image(record))
        value = getattr(other, name)
        setattr(other, name, [value[0] ^ 1, *value[1:]] if name == "force_max" else value ^ 1)
        yield Case(f"another {name}", other, EcuTraffic(none.frames, none.elapsed[:2]))


def _merged(table: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """A table with what another has, tables in it likewise."""
    both = {key: _merged(table[key], other[key]) for key in table.keys() & other.keys() & TABLES}
    return {**table, **other, **both}


def _case(table: Mapping[str, Any], bus: BusMap) -> Case:
    record = Calibration()
    memory_image.fill(record, _base(table.get("seed", 1)))
    like = (DOCUMENT["sets"][name] for name in table.get("like", []))
    for changes in (*like, table.get("calibration", {})):
        for name, value in changes.items():
            setattr(record, name, _number(value))
    memory_image.sealed(record)
    record.crc ^= table.get("crc_flip", 0)
    traffic = _traffic(table.get("traffic", {}), bus)
    return Case(table["name"], record, traffic, table.get("flipped", NEVER))


def _number(value: object) -> object:
    """A value of the document, constants of the calibration for their names."""
    if isinstance(value, list):
        return [_number(each) for each in value]
    return getattr(constants, value) if isinstance(value, str) else value


def _traffic(table: Mapping[str, Any], bus: BusMap) -> EcuTraffic:
    table = _merged(DOCUMENT["traffic"].get(table.get("like"), {}), table)
    options = {key: table[key] for key in ("hostile", "rough") if key in table}
    made = random_traffic(table.get("seed", 1), table.get("ticks", TICKS), bus=bus, **options)
    frames, elapsed = made.frames, made.elapsed
    if "frames" in table:
        frames, elapsed = SPECIAL[table["frames"]](frames, bus), elapsed[:8]
    if "elapsed" in table:
        each, ticks = table["elapsed"]
        elapsed = np.full(ticks, each, np.int32)
    if "no_motion_from" in table:
        early = frames["tick"] < table["no_motion_from"]
        frames = frames[(frames["message"] != RX_VEHICLE_MOTION) | early]
    if "zero" in table:
        frames = _zeroed(frames, bus, table["zero"])
    return EcuTraffic(frames, np.append(elapsed, np.ones(table.get("silence", 0), np.int32)))


Frames = NDArray[np.void]


def _none(frames: Frames, bus: BusMap) -> Frames:
    return frames[:0]


def _alien(frames: Frames, bus: BusMap) -> Frames:
    """Frames with numbers that no message has."""
    frames = frames[:4].copy()
    frames["message"] = (-1, len(bus.received) + N_TX, 99, -(2**31))
    return frames


def _own(frames: Frames, bus: BusMap) -> Frames:
    """Somebody else's frames with the identifiers of those that the ECU sends."""
    frames = frames[:N_TX].copy()
    frames["tick"] = np.arange(N_TX)
    frames["message"] = len(bus.received) + frames["tick"]
    return frames


SPECIAL: dict[str, Callable[[Frames, BusMap], Frames]] = {
    "none": _none,
    "alien": _alien,
    "own": _own,
}


def _zeroed(frames: Frames, bus: BusMap, name: str) -> Frames:
    """The frames with a signal of theirs zero."""
    frames = frames.copy()
    for message, box in enumerate(bus.received):
        pieces = [part for at in box.signals if at.place.text == name for part in at.pieces]
        for number in np.flatnonzero(frames["message"] == message) if pieces else ():
            payload = frames["payload"][number].tolist()
            for piece in pieces:
                payload[piece.byte] &= ~((1 << piece.width) - 1 << piece.bit)
            frames["payload"][number] = finished(box, payload, box.count(payload), len(payload))
    return frames


@cache
def _base(seed: int) -> bytes:
    return memory_image.image(random_calibration(seed))


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
