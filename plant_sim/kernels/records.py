"""One record for many arrays: a kernel takes a single pointer instead of dozens of arrays.

Numba passes every array of a tuple by its parts and counts its references at every call; a
record's nested arrays avoid that.
"""

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from numba import typeof
from numpy.typing import NDArray


def fields(kind: str, names: str, *shape: int) -> list[tuple[str, str, tuple[int, ...]]]:
    """Fields of one kind and shape of a record's dtype, from their names in a text."""
    return [(name, kind, shape) for name in names.split()]


def _fields(parts: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    return zip(parts._fields, parts, strict=True)


def _columns(parts: Any) -> tuple[Any, ...]:  # noqa: ANN401
    columns: list[Any] = []
    for name, value in _fields(parts):
        if isinstance(value, np.void):
            columns.append((name, value.dtype))
        elif isinstance(value, np.ndarray):
            columns.append((name, value.dtype, value.shape))
        elif isinstance(value, tuple):
            columns.append((name, _dtype(_columns(value))))
        else:
            columns.append((name, np.int64))
    return tuple(columns)


@cache
def _dtype(columns: tuple[Any, ...]) -> np.dtype[np.void]:
    return np.dtype(list(columns), align=True)


def _fill(record: Any, parts: Any) -> None:  # noqa: ANN401
    for name, value in _fields(parts):
        if isinstance(value, tuple):
            _fill(record[name], value)
        else:
            record[name] = value


def to_record(parts: Any) -> NDArray[Any]:  # noqa: ANN401
    """Copy a named tuple of arrays, records, integers and named tuples into an array of one record.

    The record's attributes are the tuple's, so that kernels accept either; its type is fixed by the
    shapes of all arrays in it.
    """
    result: NDArray[Any] = np.zeros(1, dtype=_dtype(_columns(parts)))
    _fill(result[0], parts)
    return result


def entry(kernel: Any, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401
    """Return the entry point of a kernel for these arguments and others of their layout.

    Called by its name, a kernel types its arguments again, which takes longer than a step.
    """
    return kernel.compile(tuple(map(type_of, arguments)))


_types: dict[Any, Any] = {}


def type_of(value: Any) -> Any:  # noqa: ANN401
    """Return Numba's type of arrays, integers and tuples of them, found once for each layout.

    Numba takes milliseconds for large records.
    """
    layout = _layout(value)
    if layout not in _types:
        _types[layout] = typeof(value)
    return _types[layout]


def _layout(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, np.ndarray):
        flags = value.flags
        return value.dtype, value.ndim, flags.c_contiguous, flags.writeable, flags.aligned
    if isinstance(value, tuple):
        return type(value), *map(_layout, value)
    return type(value)
