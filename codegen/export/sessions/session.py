"""A golden session: calls of the firmware with what the reference gave, written as C.

A :class:`Session` is a machine of :mod:`canroll.codegen.run.machine`, so whatever drives the
firmware drives it. It passes all on to the reference's machine and keeps every call, every change
of a record and every comparison that is asked for. ``templates/test_session.c`` runs what it
writes.
"""

import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.c99 import record_name
from canroll.codegen.c99.text import filled
from canroll.codegen.run import memory_image
from canroll.codegen.run.bus_firmware import BusFirmware
from canroll.codegen.run.machine import Machine, MachineRecord, c_name
from canroll.firmware.calibration import Calibration
from canroll.firmware.subset import fields

WORD = 4
BYTES = tuple(f"{byte}," for byte in range(256))
OPERATIONS = 256
REST = 20
"""Ticks after the last frame to a service."""


@dataclass(frozen=True, slots=True)
class SessionOperation:
    """One kind of step.

    Attributes:
        name: for messages.
        c: the statement that runs it; ``n`` are its numbers, ``array`` its bytes, ``actual`` takes
            what is compared.
        numbers: how many it has.
        array: bytes that it has.
        expected: bytes that are compared.
    """

    name: str
    c: str
    numbers: int = 0
    array: int = 0
    expected: int = 0


@dataclass(frozen=True, slots=True)
class Step:
    """An operation with its numbers, its bytes, and the bytes that are expected."""

    operation: SessionOperation
    numbers: tuple[int, ...] = ()
    array: bytes = b""
    expected: bytes = b""


@dataclass(slots=True)
class Part:
    """A stretch of a session with a name."""

    name: str
    steps: list[Step] = field(default_factory=list)


class SessionRecord:
    """A record of a session: on the reference's machine, and a variable in C."""

    def __init__(self, name: str, value: Any, record: MachineRecord, session: "Session") -> None:  # noqa: ANN401
        self.name, self.kind, self.record = name, value.__class__, record
        self._session = session

    def __getitem__(self, field: str) -> Any:  # noqa: ANN401
        """Return the value of a field, which is no step of the session."""
        return self.record[field]

    def __setitem__(self, field: str, value: Any) -> None:  # noqa: ANN401
        """Clear a field: nothing but zeros can be set."""
        assert not any(value if isinstance(value, list) else [value])
        self.record[field] = value
        place = f"{self.name}.{field}"
        self._session.step(
            SessionOperation(f"clear {place}", f"memset(&{place}, 0, sizeof {place});")
        )

    def image(self) -> bytes:
        """The bytes of the record."""
        return self.record.image()

    def fill(self, data: bytes) -> None:
        """Set the record from its bytes."""
        self.record.fill(data)
        c = f"session_fill(&{self.name}, {self.name}_ends, array, sizeof {self.name});"
        clear = SessionOperation(
            f"clear {self.name}", f"memset(&{self.name}, 0, sizeof {self.name});"
        )
        given = SessionOperation(f"fill {self.name}", c, array=len(data))
        self._session.step(*((given, (), data) if any(data) else (clear,)))

    def flip(self, at: int, bit: int = 0) -> None:
        """Flip a bit of the byte ``at``."""
        data = bytearray(self.image())
        data[at] ^= 1 << bit
        self.record.fill(bytes(data))
        c = f"session_flip(&{self.name}, {self.name}_ends, n[0], n[1]);"
        self._session.step(SessionOperation(f"flip {self.name}", c, numbers=2), (at, 1 << bit))

    @property
    def value(self) -> Any:  # noqa: ANN401
        """The record as an object of Python."""
        return self.record.value


class Session:
    """A golden session of a firmware; a machine for whatever drives it.

    Attributes:
        parts: its steps.
        records: its records by their names in C.
    """

    def __init__(self, machine: Machine, firmware: BusFirmware, *, gains: bool = True) -> None:
        """Begin a session.

        Args:
            machine: of the reference.
            firmware: what runs on it.
            gains: whether the first calibration is that of ``canroll_gains.h``.
        """
        self._machine, self._firmware, self._gains = machine, firmware, gains
        self.parts: list[Part] = []
        self.records: dict[str, SessionRecord] = {}

    def begin(self, name: str) -> None:
        """Begin a part."""
        self.parts.append(Part(name))

    def step(
        self,
        operation: SessionOperation,
        numbers: Sequence[int] = (),
        array: bytes = b"",
        expected: bytes = b"",
    ) -> None:
        """Add a step."""
        self.parts[-1].steps.append(Step(operation, tuple(numbers), array, expected))

    def record(self, value: Any) -> SessionRecord:  # noqa: ANN401
        """Put a record on the reference's machine, and a variable into the session."""
        kind = value.__class__.__name__.lower()
        known = sum(record.kind is value.__class__ for record in self.records.values())
        name = f"{kind}_{known + 1}" if known else kind
        self.records[name] = SessionRecord(name, value, self._machine.record(value), self)
        return self.records[name]

    def call(self, function: str, *arguments: Any) -> int:  # noqa: ANN401
        """Call a function; see :meth:`canroll.codegen.run.machine.Machine.call`."""
        passed = [each.record if isinstance(each, SessionRecord) else each for each in arguments]
        words: list[str] = []
        numbers: list[int] = []
        array = b""
        for each in arguments:
            if isinstance(each, SessionRecord):
                words.append(f"&{each.name}")
            elif isinstance(each, bytes | bytearray):
                array = bytes(each)
                words.append("array" if isinstance(each, bytes) else "actual")
            else:
                words.append(f"n[{len(numbers)}]")
                numbers.append(int(each))
        result = self._machine.call(function, *passed)
        c, expected = f"{c_name(function)}({', '.join(words)});", b""
        if self._firmware.function(function).__annotations__["return"] is not None:
            c, expected = f"session_number(actual, {c[:-1]});", _word(result)
        for each in arguments:
            if isinstance(each, bytearray):
                c, expected = f"session_copy(actual, array, {len(each)}u); {c}", bytes(each)
        sizes = len(numbers), len(array), len(expected)
        self.step(SessionOperation(function, c, *sizes), numbers, array, expected)
        return result

    def read(
        self,
        record: SessionRecord,
        name: str,
        *indices: int,
        part: slice = slice(None),
        memory: bool = False,
    ) -> None:
        """Compare bytes of a record: of a field, of its element, or a part of that.

        With ``memory`` they are a word as a little-endian memory has it.
        """
        value = record[name]
        for index in indices:
            value = value[index]
        data = bytes([value]) if not hasattr(value, "__len__") else bytes(value)
        taken = data[part]
        place = "".join([f"{record.name}.{name}", *(f"[n[{k}]]" for k in range(len(indices)))])
        if hasattr(value, "__len__"):
            place += f"[{part.start or 0}]"
        c = f"{'session_memory' if memory else 'session_copy'}(actual, &{place}, {len(taken)}u);"
        operation = SessionOperation(f"{record.name}.{name}", c, len(indices), expected=len(taken))
        self.step(operation, indices, expected=taken)

    def digest(self, record: SessionRecord) -> None:
        """Compare a whole record."""
        c = f"session_digest(actual, &{record.name}, {record.name}_ends, sizeof {record.name});"
        operation = SessionOperation(f"state of {record.name}", c, expected=WORD)
        self.step(operation, expected=zlib.crc32(record.image()).to_bytes(WORD, "little"))

    def tick(
        self,
        ecu: SessionRecord,
        calibration: SessionRecord,
        elapsed: int,
        frames: NDArray[np.void],
    ) -> int:
        """Run one tick of the loop after the frames before it, and compare its state.

        Returns:
            Number of frames that it sends.
        """
        for frame in frames:
            message, length = int(frame["message"]), int(frame["length"])
            self.call("receive", ecu, message, frame["payload"].tobytes(), length)
        self.call("tick", ecu, calibration, elapsed)
        self.digest(ecu)
        sent = sum(map(int, ecu["tx_pending"]))
        ecu["tx_pending"] = [0] * len(ecu["tx_pending"])
        return sent

    def source(self, title: str, verdict: str) -> str:
        """Return the session in C.

        Args:
            title: its first line.
            verdict: what the runner prints where every byte is as expected.
        """
        steps = [step for part in self.parts for step in part.steps]
        operations = list(dict.fromkeys(step.operation for step in steps))
        assert len(operations) <= OPERATIONS
        names = _identifiers(operations)
        lines = [f"/* {title} */", '#include "session.h"', *self._gains_header(), ""]
        lines += self._variables(" ".join(operation.c for operation in operations))
        room = max(step.expected for step in operations)
        lines += [f"uint8_t session_actual[{max(room, 1)}];", ""]
        lines += ["enum {", *filled(f"{names[operation]}," for operation in operations), "};", ""]
        lines += [f"const session_operation session_operations[{len(operations)}] = {{"]
        for each in operations:
            lines.append(f'    {{ "{each.name}", {each.numbers}, {each.array}, {each.expected} }},')
        lines += ["};", ""]
        lines += [
            "void session_run(int32_t operation, const int32_t *n, const uint8_t *array)",
            "{",
        ]
        lines += ["    uint8_t *actual = session_actual;", "    (void)n;", "    (void)array;"]
        lines += ["    (void)actual;", "    switch (operation) {"]
        for each in operations:
            statements = re.split(r"(?<=;) ", each.c)
            lines += [f"    case {names[each]}:", *(f"        {text}" for text in statements)]
            lines += ["        break;"]
        lines += ["    default:", "        break;", "    }", "}", ""]
        for number, part in enumerate(self.parts):
            lines.append(f"static const uint8_t part_{number}[] = {{")
            for step in part.steps:
                lines += filled(_encoded(names[step.operation], step))
            lines += ["};", ""]
        lines.append(f"const session_part session_parts[{len(self.parts)}] = {{")
        for number, part in enumerate(self.parts):
            lines.append(f'    {{ "{part.name}", part_{number}, sizeof part_{number} }},')
        lines += ["};", f"const size_t session_count = {len(self.parts)}u;"]
        lines += [f'const char session_verdict[] = "{verdict}";', ""]
        return "\n".join(lines)

    def _gains_header(self) -> list[str]:
        used = self._gains and any(each.kind is Calibration for each in self.records.values())
        return ['#include "canroll_gains.h"'] if used else []

    def _variables(self, statements: str) -> Iterator[str]:
        """The records, and where those that are taken as bytes have words."""
        for name, record in self.records.items():
            kind = record_name(record.kind.__name__)
            if self._gains and name == "calibration":
                # in the flash of a bare target
                const = "" if re.search(rf"session_f\w+\(&{name},", statements) else "const "
                yield f"static {const}{kind} {name} = CANROLL_CALIBRATION_INITIALISER;"
            else:
                yield f"static {kind} {name};"
        for name, record in self.records.items():
            if f"{name}_ends" in statements:
                ends = ", ".join(f"{end}u" for end in _ends(record.kind))
                yield f"static const size_t {name}_ends[] = {{ {ends} }};"


def _word(value: int) -> bytes:
    return (value & 0xFFFFFFFF).to_bytes(WORD, "little")


def _leb128(value: int) -> bytes:
    """The 32 bits of a number, seven a byte, the lowest first."""
    rest, data = value & 0xFFFFFFFF, bytearray()
    while rest > 0x7F:
        data.append(rest & 0x7F | 0x80)
        rest >>= 7
    return bytes([*data, rest])


def _encoded(name: str, step: Step) -> Iterator[str]:
    """A step as initialisers of bytes."""
    yield f"{name},"
    for data in (*map(_leb128, step.numbers), step.array, step.expected):
        yield from map(BYTES.__getitem__, data)


def _identifiers(operations: Sequence[SessionOperation]) -> dict[SessionOperation, str]:
    """A name in C for each operation."""
    names: dict[SessionOperation, str] = {}
    for operation in operations:
        name = re.sub(r"\W+", "_", operation.name).upper()
        known = sum(re.sub(r"\W+", "_", each.name).upper() == name for each in names)
        names[operation] = f"{name}_{known + 1}" if known else name
    return names


def _ends(record: type) -> list[int]:
    """Where stretches of words and of bytes end, in turn, the first of words; padding is bytes."""
    kind = memory_image.dtype(record)
    offsets: Any = kind.fields
    ends = []
    words = True
    for element, stretch in groupby(fields(record), key=lambda each: each.kind):
        if (element == "i32") != words:
            ends.append(int(offsets[next(stretch).name][1]))
            words = not words
    return [*ends, kind.itemsize]
