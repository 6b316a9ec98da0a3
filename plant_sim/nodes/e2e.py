"""End-to-end protection of the plant's frames: checksums, counters and their receiver.

It covers everything in :class:`codegen.frame.frame_protection.Protection`: AUTOSAR's E2E
profiles and manufacturers' schemes. The receiver's state machine is E2E_P01Check of the AUTOSAR E2E
protocol specification (PRS_E2EProtocol, profile 1), for counters of any number of values. A counter
beyond its last value, which no sender may use, is treated like a wrong checksum.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError
from codegen.frame.checksum import Bits, Checksum
from codegen.frame.frame_protection import Protection
from codegen.frame.own_protection import HELD_BITS
from codegen.frame.place import Place
from plant_sim.kernels.jit import njit
from plant_sim.nodes import own_sums

# Columns of a protection. TERMS, COUNTER, SUM, CARRIED: first row of the table of terms, and the
# one after the last, of what the checksum takes in, counter, checksum and further fields. MOST,
# KEPT and PART: all bits of the checksum, of its register but eight, and of a part of a unit.
# VALUES 0: no counter. FUNCTION: address of a function of the user's own.
(
    METHOD,
    WIDTH,
    MOST,
    REGISTER,
    KEPT,
    REFLECTED,
    TURNED,
    UNIT,
    PART,
    START,
    FINAL,
    CARRY,
    NEGATE,
    FUNCTION,
    DATA_ID,
    VALUES,
    TERMS,
    COUNTER,
    SUM,
    CARRIED,
    N_PROTECTION,
) = (*range(16), 16, 18, 20, 22, 24)
NO_CHECKSUM, CRC, SUM_OF, XOR, OWN = range(5)
_METHODS = {"crc": CRC, "sum": SUM_OF, "xor": XOR, "function": OWN}
# Columns of a term: bits of a unit, or of a place in the frame. AT is a byte's number, a constant,
# or the first of a list's rows; LAST: the unit ends. A place's VALUE is what a further field has.
SOURCE, AT, MASK, SHIFT, LEFT, LAST, VALUE, N_TERM = range(8)
BYTE, IDENTITY, CONSTANT, LISTED = range(4)
_SOURCES = {"byte": BYTE, "identity": IDENTITY, "constant": CONSTANT, "listed": LISTED}
HELD = (1 << HELD_BITS) - 1
MOST_TERMS = 96
"""Rows for the terms of one protection: a frame of 64 bytes, and half as many others."""

# Check results, in the order of the specification's status codes' severity.
OK, SOME_LOST, INITIAL, SYNC, REPEATED, WRONG_SEQUENCE, WRONG_CRC = range(7)
RECEIVER = np.dtype(
    [
        (name, "i8")
        for name in ("wait_for_first", "max_delta", "last_counter", "sync_left", "not_new", "lost")
    ]
)
"""State of a receiver."""

# Where the receiver's two counts end: profile 1's, whose counter has 15 values.
WINDOW_MAX = NOT_NEW_MAX = 14


class Supervision(NamedTuple):
    """Receiver configuration of one protected message (names of the AUTOSAR configuration)."""

    max_delta_counter_init: int = 3
    max_no_new_or_repeated_data: int = 14
    sync_counter_init: int = 1


def tables(rows: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Empty tables for ``rows`` unprotected messages: protections, terms, CRC tables."""
    return (
        np.zeros((rows, N_PROTECTION), np.int64),
        np.zeros((rows, MOST_TERMS, N_TERM), np.int64),
        np.zeros((rows, 256), np.int64),
    )


def put(
    row: NDArray[np.int64],
    terms: NDArray[np.int64],
    crc: NDArray[np.int64],
    scheme: Protection | None,
) -> None:
    """Write one protection into its rows of the tables.

    Raises:
        CanrollError: its checksum takes in more than the tables have room for.
    """
    if scheme is None:
        return
    row[DATA_ID] = scheme.identity
    rows: list[list[int]] = []
    if scheme.counter is not None:
        row[VALUES] = scheme.counter.values
        row[[COUNTER, COUNTER + 1]] = 0, len(scheme.counter.place.pieces)
        rows += _placed(scheme.counter.place)
    row[CARRIED] = len(rows)
    for field in scheme.carried:
        rows += _placed(field.place, field.of(scheme.identity))
    row[CARRIED + 1] = len(rows)
    if scheme.checksum is not None:
        row[SUM] = len(rows)
        rows += _placed(scheme.checksum.place)
        row[[SUM + 1, TERMS]] = len(rows)
        _put_checksum(row, crc, scheme.checksum)
        rows += _taken(scheme.checksum, len(rows))
        row[TERMS + 1] = len(rows) - sum(map(len, scheme.checksum.lists))
    if len(rows) > MOST_TERMS:
        raise CanrollError(
            f"a checksum takes in {len(rows)} bytes and constants: the plant has room for "
            f"{MOST_TERMS}"
        )
    terms[: len(rows)] = np.array(rows, np.int64).reshape(-1, N_TERM)


def _placed(place: Place, value: int = 0) -> Iterable[list[int]]:
    """Rows of a number in the frame, with a value that it always has."""
    for piece in place.pieces:
        mask = (1 << piece.width) - 1
        part = value >> piece.signal_bit & mask
        yield [BYTE, piece.byte, mask, piece.bit, piece.signal_bit, 0, part]


def _taken(method: Checksum, start: int) -> list[list[int]]:
    """Rows of what a checksum takes in, from row ``start`` on, and then those of its lists."""
    count = sum(len(unit) for unit in method.units)
    first = {}
    lists: list[list[int]] = []
    for values in method.lists:
        first[values] = start + count + len(lists)
        lists += [[CONSTANT, value, 0, 0, 0, 0, 0] for value in values]

    def row(bits: Bits, last: bool) -> list[int]:
        at = first[bits.at] if isinstance(bits.at, tuple) else bits.at
        return [_SOURCES[bits.source], at, bits.mask, bits.shift, bits.left, int(last), 0]

    rows = [row(bits, bits is unit[-1]) for unit in method.units for bits in unit]
    return rows + lists


def _put_checksum(row: NDArray[np.int64], crc: NDArray[np.int64], method: Checksum) -> None:
    row[[METHOD, WIDTH, UNIT]] = _METHODS[method.fold], method.width, method.unit
    row[[MOST, PART]] = _signed((1 << method.width) - 1), (1 << method.unit) - 1
    row[[START, FINAL]] = _signed(method.start), _signed(method.end)
    row[[CARRY, NEGATE]] = method.carry, method.negate
    if method.function is not None:
        row[FUNCTION] = own_sums.address(method.function)
    if method.fold == "crc":
        row[[REGISTER, REFLECTED]] = method.register, method.reflect_in
        row[KEPT] = (1 << method.register - 8) - 1
        row[TURNED] = method.reflect_in != method.reflect_out
        row[START] = _signed(method.first_register)
        crc[:] = [_signed(entry) for entry in method.table]


def _signed(value: int) -> int:
    """The number whose 64 bits are those of ``value``."""
    return value - (1 << 64) if value >> 63 else value


@njit
def _bits(term: NDArray[np.int64], payload: NDArray[np.uint8]) -> int:
    """The bits of a place in a frame, where they stand in its number."""
    return int(((int(payload[term[AT]]) >> term[SHIFT]) & term[MASK]) << term[LEFT])


@njit
def _number(terms: NDArray[np.int64], first: int, end: int, payload: NDArray[np.uint8]) -> int:
    """The number in a place of a frame."""
    value = 0
    for k in range(first, end):
        value |= _bits(terms[k], payload)
    return value


@njit
def _insert(terms: NDArray[np.int64], k: int, value: int, payload: NDArray[np.uint8]) -> None:
    """Put bits into the frame, where the term in row ``k`` has them."""
    mask = terms[k, MASK] << terms[k, SHIFT]
    kept = int(payload[terms[k, AT]]) & ~mask
    payload[terms[k, AT]] = kept | ((value << terms[k, SHIFT]) & mask)


@njit
def _source(
    row: NDArray[np.int64],
    terms: NDArray[np.int64],
    k: int,
    payload: NDArray[np.uint8],
    count: int,
) -> int:
    """The bits of a unit that the term in row ``k`` has."""
    source = terms[k, SOURCE]
    value: int = terms[k, AT]
    if source == BYTE:
        value = int(payload[terms[k, AT]])
    elif source == IDENTITY:
        value = row[DATA_ID]
    elif source == LISTED:
        value = terms[terms[k, AT] + count % 16, AT]
    return int(((value >> terms[k, SHIFT]) & terms[k, MASK]) << terms[k, LEFT])


@njit
def _step(row: NDArray[np.int64], crc: NDArray[np.int64], value: int, unit: int) -> int:
    """Take a unit into the register of a CRC, a sum or an XOR."""
    if row[METHOD] == CRC:
        # a 64-bit register is negative where its highest bit is set
        if row[REFLECTED] == 1:
            return int(crc[(value ^ unit) & 255] ^ ((value >> 8) & row[KEPT]))
        entry = crc[((value >> (row[REGISTER] - 8)) ^ unit) & 255]
        return int(entry ^ ((value & row[KEPT]) << 8))
    while unit > 0:
        part = unit & row[PART]
        value = value ^ part if row[METHOD] == XOR else value + part
        unit >>= row[UNIT]
    return value


@njit
def _turned(value: int, width: int) -> int:
    """The bits of a number in reverse."""
    result = 0
    for k in range(width):
        result = (result << 1) | ((value >> k) & 1)
    return result


@njit
def _end(row: NDArray[np.int64], value: int) -> int:
    """From a register to the checksum."""
    width, low = row[WIDTH], row[MOST]
    if row[METHOD] == CRC:
        if row[REFLECTED] == 0:
            value >>= row[REGISTER] - width
        if row[TURNED] == 1:
            value = _turned(value, width)
    elif row[METHOD] == SUM_OF:
        while row[CARRY] == 1 and value > low:
            value = (value & low) + (value >> width)
        if row[NEGATE] == 1:
            value = row[START] - value
    return int((value & low) ^ row[FINAL])


@njit
def checksum(
    row: NDArray[np.int64],
    terms: NDArray[np.int64],
    crc: NDArray[np.int64],
    payload: NDArray[np.uint8],
) -> int:
    """Checksum of a frame that has its counter; one of 64 bits as a number with a sign."""
    if row[METHOD] == OWN:
        own: int = own_sums.called(row[FUNCTION], payload, row[DATA_ID])
        return int(own & row[MOST])
    count = counter_of(row, terms, payload)
    value: int = 0 if row[NEGATE] == 1 else row[START]
    unit = 0
    for k in range(row[TERMS], row[TERMS + 1]):
        unit |= _source(row, terms, k, payload, count)
        if terms[k, LAST] == 1:
            value = _step(row, crc, value, unit)
            unit = 0
    return _end(row, value)


@njit
def counter_of(row: NDArray[np.int64], terms: NDArray[np.int64], payload: NDArray[np.uint8]) -> int:
    """Counter of a frame, as far as it is held; 0 if it has none."""
    value = _number(terms, row[COUNTER], row[COUNTER + 1], payload)
    return int(value & HELD)


@njit
def protect(
    row: NDArray[np.int64],
    terms: NDArray[np.int64],
    crc: NDArray[np.int64],
    count: int,
    payload: NDArray[np.uint8],
) -> None:
    """Write the counter of frame number ``count``, fixed fields and checksum into a payload."""
    if row[VALUES] > 0:
        for k in range(row[COUNTER], row[COUNTER + 1]):
            _insert(terms, k, (count % row[VALUES]) >> terms[k, LEFT], payload)
    for k in range(row[CARRIED], row[CARRIED + 1]):
        _insert(terms, k, terms[k, VALUE], payload)
    if row[METHOD] != NO_CHECKSUM:
        value = checksum(row, terms, crc, payload)
        for k in range(row[SUM], row[SUM + 1]):
            _insert(terms, k, value >> terms[k, LEFT], payload)


@njit
def intact(
    row: NDArray[np.int64],
    terms: NDArray[np.int64],
    crc: NDArray[np.int64],
    payload: NDArray[np.uint8],
) -> bool:
    """Whether a frame has its checksum, its fixed fields and a counter that a sender may use."""
    if row[VALUES] > 0 and counter_of(row, terms, payload) >= row[VALUES]:
        return False
    for k in range(row[CARRIED], row[CARRIED + 1]):
        carried = (int(payload[terms[k, AT]]) >> terms[k, SHIFT]) & terms[k, MASK]
        if carried != terms[k, VALUE]:
            return False
    if row[METHOD] == NO_CHECKSUM:
        return True
    carried = _number(terms, row[SUM], row[SUM + 1], payload)
    return bool(carried == checksum(row, terms, crc, payload))


@njit
def check(  # noqa: PLR0917
    state: Any,  # noqa: ANN401
    supervision: Supervision,
    row: NDArray[np.int64],
    terms: NDArray[np.int64],
    crc: NDArray[np.int64],
    payload: NDArray[np.uint8],
) -> int:
    """Judge a received payload and advance the receiver's ``state``; returns a status code.

    A frame without a counter is always in sequence.
    """
    values = row[VALUES]
    state.max_delta = min(state.max_delta + 1, WINDOW_MAX)
    if not intact(row, terms, crc, payload):
        return WRONG_CRC
    if values == 0:
        return OK
    counter = counter_of(row, terms, payload)
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
