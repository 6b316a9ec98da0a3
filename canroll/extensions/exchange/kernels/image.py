"""Start values of a kernel's record, as bytes that the C unpacks: runs of equal bytes, and others.

Records are rebuilt with C's alignment, so that a copy of their bytes is the struct.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST_RUN = 8
ACROSS = 24


def aligned(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The same record as C compilers lay it out."""
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        return np.dtype((aligned(base), shape))
    if dtype.names is None:
        return dtype
    return np.dtype([(name, aligned(dtype[name])) for name in dtype.names], align=True)


def copied(record: np.void, dtype: np.dtype[Any]) -> NDArray[Any]:
    """An array of one record of ``dtype``: the same fields, arrays cut off where it has less."""
    result = np.zeros(1, dtype)
    _copy(record, result[0])
    return result


def _copy(source: Any, target: Any) -> None:  # noqa: ANN401
    for name in target.dtype.names:
        value = source[name]
        place = target[name]
        if isinstance(value, np.void):
            _copy(value, place)
        elif isinstance(value, np.ndarray) and value.dtype.names:
            for k in range(len(place)):
                _copy(value[k], place[k])
        elif isinstance(value, np.ndarray):
            place[...] = value[tuple(slice(size) for size in place.shape)]
        else:
            target[name] = value


def packed(data: bytes) -> bytes:
    """Pairs of a literal run and a run of one byte: lengths (2 bytes each), literals, the byte."""
    values = np.frombuffer(data, np.uint8)
    edges = np.flatnonzero(np.diff(values)) + 1
    starts = np.concatenate(([0], edges))
    ends = np.concatenate((edges, [len(values)]))
    long = (ends - starts) >= LEAST_RUN
    out, at = bytearray(), 0
    for start, end in zip(starts[long].tolist(), ends[long].tolist(), strict=True):
        _pair(out, data[at:start], data[start], end - start)
        at = end
    _pair(out, data[at:], 0, 0)
    return bytes(out)


def _pair(out: bytearray, literals: bytes, byte: int, count: int) -> None:
    most = 0xFFFF
    while len(literals) > most:
        out += most.to_bytes(2, "little") + bytes(2) + literals[:most] + b"\0"
        literals = literals[most:]
    first = min(count, most)
    out += len(literals).to_bytes(2, "little") + first.to_bytes(2, "little")
    out += literals + bytes([byte])
    while count > first:
        count -= first
        first = min(count, most)
        out += bytes(2) + first.to_bytes(2, "little") + bytes([byte])


def source(name: str, data: bytes) -> str:
    """C of a function ``name`` that fills the bytes given to it."""
    content = packed(data)
    rows = [
        "    " + " ".join(f"{byte}," for byte in content[at : at + ACROSS])
        for at in range(0, len(content), ACROSS)
    ]
    return "\n".join(
        [
            "#include <stdint.h>",
            "#include <string.h>",
            "",
            f"static const uint8_t content[{len(content)}] = {{",
            *rows,
            "};",
            "",
            "/* Literal bytes and a run of one byte in turn, their lengths before them. */",
            f"void {name}(void *record)",
            "{",
            "    uint8_t *to = record;",
            "    const uint8_t *from = content;",
            "    while (from < content + sizeof content) {",
            "        size_t literals = from[0] | (size_t)from[1] << 8;",
            "        size_t run = from[2] | (size_t)from[3] << 8;",
            "        memcpy(to, from + 4, literals);",
            "        memset(to + literals, from[4 + literals], run);",
            "        to += literals + run;",
            "        from += 5 + literals;",
            "    }",
            "}",
            "",
        ]
    )
