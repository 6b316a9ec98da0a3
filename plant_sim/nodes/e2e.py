"""End-to-end protection of the plant's frames: checksums, counters and their receiver.

It covers everything in :class:`canroll.codegen.frame.frame_protection.Protection`: AUTOSAR's E2E
profiles and manufacturers' schemes. The receiver's state machine is E2E_P01Check of the AUTOSAR E2E
protocol specification (PRS_E2EProtocol, profile 1), for counters of any number of values. A counter
beyond its last value, which no sender may use, is treated like a wrong checksum.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.frame.checksum import Bits, Checksum
from canroll.codegen.frame.frame_protection import Protection
from canroll.codegen.frame.own_protection import HELD_BITS
from canroll.codegen.frame.place import Place
from canroll.errors import CanrollError
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes import own_sums

NO_CHECKSUM, CRC, SUM_OF, XOR, OWN = range(5)
_METHODS = {"crc": CRC, "sum": SUM_OF, "xor": XOR, "function": OWN}
BYTE, IDENTITY, CONSTANT, LISTED = range(4)
_SOURCES = {"byte": BYTE, "identity": IDENTITY, "constant": CONSTANT, "listed": LISTED}
HELD = (1 << HELD_BITS) - 1
Payload: TypeAlias = NDArray[np.uint8]
Scheme: TypeAlias = Any
"""A :data:`PROTECTION` in a kernel."""
MOST_TERMS = 96
"""Rows for the terms of one protection: a frame of 64 bytes, and half as many others."""

TERM = np.dtype(fields("i8", "source at mask shift left last value"))
"""Bits of a unit, or of a place in the frame.

``at`` is a byte's number, a constant, or the first of a list's rows; ``last``: the unit ends. A
place's ``value`` is what a further field has.
"""
PROTECTION = np.dtype(
    [
        *fields("i8", "method width most register_width kept reflected turned unit part"),
        *fields("i8", "start final carry negate function data_id values"),
        *fields("i8", "terms counter sum carried", 2),
        ("term", TERM, (MOST_TERMS,)),
        *fields("i8", "crc", 256),
    ]
)
"""A protection.

``most``, ``kept`` and ``part``: all bits of the checksum, of its register but eight, and of a part
of a unit. ``values`` 0: no counter. ``function``: address of a function of the user's own.
``terms`` to ``carried``: first row of ``term``, and the one after the last, of what the checksum
takes in, counter, checksum and further fields.
"""

# Check results, in the order of the specification's status codes' severity.
OK, SOME_LOST, INITIAL, SYNC, REPEATED, WRONG_SEQUENCE, WRONG_CRC = range(7)
RECEIVER = np.dtype(fields("i8", "wait_for_first max_delta last_counter sync_left not_new lost"))
"""State of a receiver."""

# Where the receiver's two counts end: profile 1's, whose counter has 15 values.
WINDOW_MAX = NOT_NEW_MAX = 14


class Supervision(NamedTuple):
    """Receiver configuration of one protected message (names of the AUTOSAR configuration)."""

    max_delta_counter_init: int = 3
    max_no_new_or_repeated_data: int = 14
    sync_counter_init: int = 1


def put(row: Any, scheme: Protection | None) -> None:  # noqa: ANN401
    """Write one protection into its :data:`PROTECTION`.

    Raises:
        CanrollError: its checksum takes in more than the tables have room for.
    """
    if scheme is None:
        return
    row["data_id"] = scheme.identity
    rows: list[tuple[int, ...]] = []
    if scheme.counter is not None:
        row["values"] = scheme.counter.values
        row["counter"] = 0, len(scheme.counter.place.pieces)
        rows += _placed(scheme.counter.place)
    row["carried"][0] = len(rows)
    for field in scheme.carried:
        rows += _placed(field.place, field.of(scheme.identity))
    row["carried"][1] = len(rows)
    if scheme.checksum is not None:
        row["sum"][0] = len(rows)
        rows += _placed(scheme.checksum.place)
        row["sum"][1] = row["terms"][0] = len(rows)
        _put_checksum(row, scheme.checksum)
        rows += _taken(scheme.checksum, len(rows))
        row["terms"][1] = len(rows) - sum(map(len, scheme.checksum.lists))
    if len(rows) > MOST_TERMS:
        raise CanrollError(
            f"a checksum takes in {len(rows)} bytes and constants: the plant has room for "
            f"{MOST_TERMS}"
        )
    row["term"][: len(rows)] = np.array(rows, TERM)


def _placed(place: Place, value: int = 0) -> Iterable[tuple[int, ...]]:
    """Rows of a number in the frame, with a value that it always has."""
    for piece in place.pieces:
        mask = (1 << piece.width) - 1
        part = value >> piece.signal_bit & mask
        yield BYTE, piece.byte, mask, piece.bit, piece.signal_bit, 0, part


def _taken(method: Checksum, start: int) -> list[tuple[int, ...]]:
    """Rows of what a checksum takes in, from row ``start`` on, and then those of its lists."""
    count = sum(len(unit) for unit in method.units)
    first = {}
    lists: list[tuple[int, ...]] = []
    for values in method.lists:
        first[values] = start + count + len(lists)
        lists += [(CONSTANT, value, 0, 0, 0, 0, 0) for value in values]

    def row(bits: Bits, last: bool) -> tuple[int, ...]:
        at = first[bits.at] if isinstance(bits.at, tuple) else bits.at
        return _SOURCES[bits.source], at, bits.mask, bits.shift, bits.left, int(last), 0

    rows = [row(bits, bits is unit[-1]) for unit in method.units for bits in unit]
    return rows + lists


def _put_checksum(row: Any, method: Checksum) -> None:  # noqa: ANN401
    row["method"], row["width"], row["unit"] = _METHODS[method.fold], method.width, method.unit
    row["most"], row["part"] = _signed((1 << method.width) - 1), (1 << method.unit) - 1
    row["start"], row["final"] = _signed(method.start), _signed(method.end)
    row["carry"], row["negate"] = method.carry, method.negate
    if method.function is not None:
        row["function"] = own_sums.address(method.function)
    if method.fold == "crc":
        row["register_width"], row["reflected"] = method.register, method.reflect_in
        row["kept"] = (1 << method.register - 8) - 1
        row["turned"] = method.reflect_in != method.reflect_out
        row["start"] = _signed(method.first_register)
        row["crc"] = [_signed(entry) for entry in method.table]


def _signed(value: int) -> int:
    """The number whose 64 bits are those of ``value``."""
    return value - (1 << 64) if value >> 63 else value


@njit
def _bits(term: Any, payload: Payload) -> int:  # noqa: ANN401
    """The bits of a place in a frame, where they stand in its number."""
    return int(((int(payload[term.at]) >> term.shift) & term.mask) << term.left)


@njit
def _number(row: Scheme, place: NDArray[np.int64], payload: Payload) -> int:
    """The number in a place of a frame: its first row of terms, and the one after the last."""
    value = 0
    for k in range(place[0], place[1]):
        value |= _bits(row.term[k], payload)
    return value


@njit
def _insert(term: Any, value: int, payload: Payload) -> None:  # noqa: ANN401
    """Put bits into the frame, where the term has them."""
    mask = term.mask << term.shift
    kept = int(payload[term.at]) & ~mask
    payload[term.at] = kept | ((value << term.shift) & mask)


@njit
def _source(row: Scheme, term: Any, payload: Payload, count: int) -> int:  # noqa: ANN401
    """The bits of a unit that the term has."""
    value: int = term.at
    if term.source == BYTE:
        value = int(payload[term.at])
    elif term.source == IDENTITY:
        value = row.data_id
    elif term.source == LISTED:
        value = row.term[term.at + count % 16].at
    return int(((value >> term.shift) & term.mask) << term.left)


@njit
def _step(row: Scheme, value: int, unit: int) -> int:
    """Take a unit into the register of a CRC, a sum or an XOR."""
    if row.method == CRC:
        # a 64-bit register is negative where its highest bit is set
        if row.reflected == 1:
            return int(row.crc[(value ^ unit) & 255] ^ ((value >> 8) & row.kept))
        entry = row.crc[((value >> (row.register_width - 8)) ^ unit) & 255]
        return int(entry ^ ((value & row.kept) << 8))
    while unit > 0:
        part = unit & row.part
        value = value ^ part if row.method == XOR else value + part
        unit >>= row.unit
    return value


@njit
def _turned(value: int, width: int) -> int:
    """The bits of a number in reverse."""
    result = 0
    for k in range(width):
        result = (result << 1) | ((value >> k) & 1)
    return result


@njit
def _end(row: Scheme, value: int) -> int:
    """From a register to the checksum."""
    width, low = row.width, row.most
    if row.method == CRC:
        if row.reflected == 0:
            value >>= row.register_width - width
        if row.turned == 1:
            value = _turned(value, width)
    elif row.method == SUM_OF:
        while row.carry == 1 and value > low:
            value = (value & low) + (value >> width)
        if row.negate == 1:
            value = row.start - value
    return int((value & low) ^ row.final)


@njit
def checksum(row: Scheme, payload: Payload) -> int:
    """Checksum of a frame that has its counter; one of 64 bits as a number with a sign."""
    if row.method == OWN:
        own: int = own_sums.called(row.function, payload, row.data_id)
        return int(own & row.most)
    count = counter_of(row, payload)
    value: int = 0 if row.negate == 1 else row.start
    unit = 0
    for k in range(row.terms[0], row.terms[1]):
        unit |= _source(row, row.term[k], payload, count)
        if row.term[k].last == 1:
            value = _step(row, value, unit)
            unit = 0
    return _end(row, value)


@njit
def counter_of(row: Scheme, payload: Payload) -> int:
    """Counter of a frame, as far as it is held; 0 if it has none."""
    return int(_number(row, row.counter, payload) & HELD)


@njit
def protect(row: Scheme, count: int, payload: Payload) -> None:
    """Write the counter of frame number ``count``, fixed fields and checksum into a payload."""
    if row.values > 0:
        for k in range(row.counter[0], row.counter[1]):
            _insert(row.term[k], (count % row.values) >> row.term[k].left, payload)
    for k in range(row.carried[0], row.carried[1]):
        _insert(row.term[k], row.term[k].value, payload)
    if row.method != NO_CHECKSUM:
        value = checksum(row, payload)
        for k in range(row.sum[0], row.sum[1]):
            _insert(row.term[k], value >> row.term[k].left, payload)


@njit
def intact(row: Scheme, payload: Payload) -> bool:
    """Whether a frame has its checksum, its fixed fields and a counter that a sender may use."""
    if row.values > 0 and counter_of(row, payload) >= row.values:
        return False
    for k in range(row.carried[0], row.carried[1]):
        carried = (int(payload[row.term[k].at]) >> row.term[k].shift) & row.term[k].mask
        if carried != row.term[k].value:
            return False
    if row.method == NO_CHECKSUM:
        return True
    carried = _number(row, row.sum, payload)
    return bool(carried == checksum(row, payload))


@njit
def check(state: Any, supervision: Supervision, row: Scheme, payload: Payload) -> int:  # noqa: ANN401
    """Judge a received payload and advance the receiver's ``state``; returns a status code.

    A frame without a counter is always in sequence.
    """
    values = row.values
    state.max_delta = min(state.max_delta + 1, WINDOW_MAX)
    if not intact(row, payload):
        return WRONG_CRC
    if values == 0:
        return OK
    counter = counter_of(row, payload)
    if state.wait_for_first:
        state.wait_for_first = 0
        state.max_delta = supervision.max_delta_counter_init
        state.last_counter = counter
        return INITIAL
    delta = (counter - state.last_counter) % values
    if delta == 0:
        state.not_new = min(state.not_new + 1, NOT_NEW_MAX)
        return REPEATED
    if delta > state.max_delta:
        state.not_new = 0
        state.sync_left = supervision.sync_counter_init
        if supervision.sync_counter_init > 0:
            state.max_delta = supervision.max_delta_counter_init
            state.last_counter = counter
        return WRONG_SEQUENCE
    state.max_delta = supervision.max_delta_counter_init
    state.last_counter = counter
    state.lost = delta - 1
    if state.not_new > supervision.max_no_new_or_repeated_data:
        state.not_new = 0
        state.sync_left = supervision.sync_counter_init
        return SYNC
    state.not_new = 0
    if state.sync_left > 0:
        state.sync_left -= 1
        return SYNC
    return OK if delta == 1 else SOME_LOST


def receiver_state(supervision: Supervision) -> Any:  # noqa: ANN401
    """A :data:`RECEIVER` that has seen nothing yet (E2E_P01CheckInit)."""
    state = np.zeros(1, RECEIVER)[0]
    state["wait_for_first"] = 1
    state["max_delta"] = supervision.max_delta_counter_init
    return state
