"""Faults as text, ``WHERE=KIND[:VALUE][@START[:END[:RAMP]]][,every=S,for=S]``, and in TOML files.

Several faults that act together are joined by `` + ``. In a file each is a table ``[[fault]]``
with the keys ``where``, ``kind``, ``value``, ``start``, ``end``, ``ramp``, ``every`` and ``for``.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from canroll import documents
from canroll.errors import CanrollError, UnknownNameError, reason
from canroll.plant_sim.faults.kinds import PLACES, FaultKind, kinds_at
from canroll.plant_sim.kernels import schedule

FORM = "write WHERE=KIND, WHERE=KIND:VALUE@START:END or WHERE=KIND:VALUE@START:END:RAMP"
AND = " + "
KEYS = ("where", "kind", "value", "start", "end", "ramp", "every", "for")
TIMES = {"every": "every", "for": "lasting"}
"""Times that are given by name, and the attribute of each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault(schedule.ScheduledFault):
    """One fault by its place and kind.

    ``where`` is a name in ``kinds.PLACES``, such as "Imu.RollRate" or "front_left", ``kind`` one of
    ``kinds.KINDS``; times as in :class:`canroll.plant_sim.kernels.schedule.ScheduledFault`.
    """

    def __str__(self) -> str:
        """Return the text that :func:`parse` reads."""
        kind = kind_of(self)
        text = f"{self.where}={self.kind}"
        if kind.value:
            text += f":{self.value!r}"
        if self.start or self.end < math.inf or self.ramp:
            text += f"@{self.start!r}"
            if self.end < math.inf or self.ramp:
                text += ":" + ("" if self.end == math.inf else repr(self.end))
            if self.ramp:
                text += f":{self.ramp!r}"
        for name, attribute in TIMES.items():
            value = getattr(self, attribute)
            text += f",{name}={value!r}" if value else ""
        return text


def kind_of(fault: Fault, what: str = "") -> FaultKind:
    """Return the kind of a fault; ``what`` comes first in messages.

    Raises:
        UnknownNameError: no such place, or no such kind there; the nearest is suggested.
    """
    if fault.where not in PLACES:
        raise UnknownNameError(f"{what}place of a fault", fault.where, PLACES)
    known = {kind.name: kind for kind in kinds_at(fault.where)}
    if fault.kind not in known:
        raise UnknownNameError(f"{what}fault of {fault.where}", fault.kind, known)
    return known[fault.kind]


def parse(text: str) -> tuple[Fault, ...]:
    """Return the faults that ``text`` describes: one, or several joined by " + ".

    Raises:
        CanrollError: the text cannot be parsed, or a value or time is invalid.
        UnknownNameError: no such place or kind.
    """
    return tuple(_one(part.strip()) for part in text.split(AND))


def parse_all(texts: Iterable[str]) -> tuple[Fault, ...]:
    """Return the faults of several texts."""
    return tuple(fault for text in texts for fault in parse(text))


def _one(text: str) -> Fault:
    main, *named = text.split(",")
    where, equals, rest = main.partition("=")
    what, at, when = rest.partition("@")
    kind, colon, amount = what.partition(":")
    times = when.split(":")
    if not (where and equals and kind) or (at and not when) or (colon and not amount):
        raise CanrollError(f"fault '{text}': {FORM}")
    given: dict[str, Any] = {"where": where, "kind": kind}
    pairs = [("value", amount), *zip(("start", "end", "ramp"), times, strict=False)]
    if len(times) > 3:
        raise CanrollError(f"fault '{text}': {FORM}")
    for part in named:
        name, _, number = part.partition("=")
        if name not in TIMES:
            raise UnknownNameError(f"time of fault '{text}',", name, TIMES)
        pairs.append((name, number or "nothing"))
    for name, number in pairs:
        if number:
            try:
                given[name] = float(number)
            except ValueError as error:
                raise CanrollError(f"fault '{text}': {FORM}") from error
    return checked(given, f"fault '{text}'")


def checked(given: Mapping[str, Any], what: str, *, prefix: str = "") -> Fault:
    """Return the fault of keys and values as in a file.

    ``what`` names it in messages, ``prefix`` comes before names that are unknown.

    Raises:
        CanrollError: a key is missing, or a value or time is invalid.
        UnknownNameError: no such key, place or kind.
    """
    for key, value in given.items():
        if key not in KEYS:
            raise UnknownNameError(f"key of {what},", key, KEYS)
        named = key in {"where", "kind"}
        if isinstance(value, bool) or not isinstance(value, str if named else int | float):
            raise CanrollError(f"{what}: {key} must be a {'name' if named else 'number'}")
    for key in KEYS[:2]:
        if key not in given:
            raise CanrollError(f"{what}: {key} is missing")
    times = {name: float(given[name]) for name in ("start", "end", "ramp") if name in given}
    times |= {TIMES[name]: float(given[name]) for name in TIMES if name in given}
    fault = Fault(
        where=given["where"], kind=given["kind"], value=float(given.get("value", 0.0)), **times
    )
    kind = kind_of(fault, prefix)
    _check_value(kind, given, what)
    _check_times(kind, fault, what)
    if "value" not in given and kind.default is not None:
        return replace(fault, value=kind.default)
    return fault


def _check_value(kind: FaultKind, given: Mapping[str, Any], what: str) -> None:
    value = given.get("value")
    if value is None:
        if kind.value and kind.default is None:
            raise CanrollError(
                f"{what}: {kind.name} needs a value ({kind.value}), e.g. {kind.name}:"
                f"{0.1 if kind.low < 0.1 <= kind.high else kind.low:g}"
            )
        return
    if not kind.value:
        raise CanrollError(f"{what}: {kind.name} does not take a value")
    if not math.isfinite(value):
        raise CanrollError(f"{what}: the value must be finite")
    if not kind.low <= value <= kind.high:
        high = "or more" if kind.high == math.inf else f"to {kind.high:g}"
        raise CanrollError(f"{what}: the value ({kind.value}) must be {kind.low:g} {high}")


def _check_times(kind: FaultKind, fault: Fault, what: str) -> None:
    if not 0 <= fault.start < fault.end or not math.isfinite(fault.start):
        raise CanrollError(f"{what}: START must be 0 or later and before END")
    if fault.start and not kind.start:
        raise CanrollError(f"{what}: {kind.name} does not take a START: its value is its end")
    if fault.end < math.inf and not kind.end:
        raise CanrollError(f"{what}: {kind.name} does not take an END: its value says when")
    if fault.ramp and not kind.ramps:
        raise CanrollError(f"{what}: {kind.name} does not take a ramp")
    if not 0 <= fault.ramp < math.inf:
        raise CanrollError(f"{what}: RAMP must be 0 s or more")
    if (fault.every or fault.lasting) and not kind.repeats:
        raise CanrollError(f"{what}: {kind.name} cannot be intermittent")
    if kind.name == "spike":
        if fault.lasting:
            raise CanrollError(f"{what}: a spike lasts one sample: omit for")
        if not 0 <= fault.every < math.inf:
            raise CanrollError(f"{what}: every must be 0 s or more")
    elif (fault.every or fault.lasting) and not 0 < fault.lasting < fault.every < math.inf:
        raise CanrollError(
            f"{what}: an intermittent fault needs every and for, for above 0 and below every"
        )


def read_file(path: Path) -> tuple[Fault, ...]:
    """Return the faults of a TOML file, which act together.

    Raises:
        CanrollError: it cannot be read; the message names the file and the fault in it.
    """
    try:
        data = documents.toml(path)
    except (OSError, ValueError) as error:
        raise CanrollError(f"{path}: {reason(error)}") from error
    documents.refuse_unknown(data, ("fault",), f"{path}: key")
    tables = data.get("fault", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise CanrollError(f"{path}: write each fault as a table [[fault]]")
    if not tables:
        raise CanrollError(f"{path}: no fault; write each as a table [[fault]]")
    return tuple(
        checked(table, what, prefix=f"{what}: ")
        for what, table in ((f"{path}: fault {n}", table) for n, table in enumerate(tables, 1))
    )
