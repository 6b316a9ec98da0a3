"""Tables that grow with a run: the first of each in memory, the rest in a temporary file.

The file has no name, so that nothing remains of a process that is killed. It lies where Python's
``tempfile`` puts it: ``TMPDIR`` chooses another folder.
"""

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, reason

IN_MEMORY = 1 << 20
"""Bytes of a table that are kept in memory."""
PIECE = 1 << 16
"""Rows of a piece of signals: one, in whichever blocks they were recorded, for a minute."""


class Spool:
    """Arrays of one type, numbered in the order in which they were appended."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self.dtype = dtype
        self.sizes: list[int] = []
        self._kept: list[NDArray[Any]] = []
        self._places: list[int] = []
        self._end = 0
        self.bytes_in_memory = 0
        self._file: IO[bytes] | None = None

    def append(self, values: NDArray[Any]) -> None:
        """Append a copy of ``values``.

        Raises:
            CanrollError: the temporary file cannot be written.
        """
        self.extend(values.size, [values.reshape(-1)])

    def keep(self, values: NDArray[Any]) -> None:
        """Append ``values`` without a copy; the caller must not change them afterwards.

        Raises:
            CanrollError: the temporary file cannot be written.
        """
        if self._fits(values.nbytes):
            self._kept.append(values.reshape(-1))
            self.bytes_in_memory += values.nbytes
            self.sizes.append(values.size)
        else:
            self.append(values)

    def _fits(self, size: int) -> bool:
        return self._file is None and self.bytes_in_memory + size <= IN_MEMORY

    def extend(self, count: int, parts: Iterable[NDArray[Any]]) -> None:
        """Append one array of ``count`` entries that comes in parts.

        Raises:
            CanrollError: the temporary file cannot be written.
        """
        size = count * self.dtype.itemsize
        if self._fits(size):
            self._kept.append(np.concatenate([np.zeros(0, self.dtype), *parts]))
            self.bytes_in_memory += size
        else:
            for part in parts:
                self._write(np.ascontiguousarray(part, self.dtype))
            self._places.append(self._end - size)
        self.sizes.append(count)

    def _write(self, part: NDArray[Any]) -> None:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(  # noqa: SIM115 - as long as the spool
                    prefix="canroll-", buffering=0
                )
            self._file.seek(self._end)
            rest = part.view(np.uint8).data
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            raise CanrollError(
                f"cannot record the run in {tempfile.gettempdir()}: {reason(error)}: "
                "set TMPDIR to a folder with more space"
            ) from error
        self._end += part.nbytes

    def read(self, number: int, first: int = 0, count: int | None = None) -> NDArray[Any]:
        """Return ``count`` entries of array ``number`` from ``first`` on, by default all."""
        count = self.sizes[number] - first if count is None else count
        if number < len(self._kept):
            return self._kept[number][first : first + count]
        assert self._file is not None
        rows = np.empty(count, self.dtype)
        self._file.seek(self._places[number - len(self._kept)] + first * self.dtype.itemsize)
        self._file.readinto(rows.view(np.uint8))  # type: ignore[attr-defined]
        return rows


class Rows:
    """Rows of one NumPy type, read by block, by field, or as the array they make up."""

    def __init__(self, dtype: np.dtype[Any], blocks: Sequence[NDArray[Any]] = ()) -> None:
        self._spool = Spool(dtype)
        for block in blocks:
            self.append(block)

    @classmethod
    def of(cls, values: NDArray[Any]) -> "Rows":
        """Return the rows of an array."""
        return cls(values.dtype, [values])

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of a row."""
        return self._spool.dtype

    def append(self, rows: NDArray[Any]) -> None:
        """Append rows."""
        if len(rows):
            self._spool.append(rows)

    def blocks(self) -> Iterator[NDArray[Any]]:
        """Yield the rows in order, a block at a time."""
        for number in range(len(self._spool.sizes)):
            yield self._spool.read(number)

    def __len__(self) -> int:
        """Return the number of rows."""
        return sum(self._spool.sizes)

    def __getitem__(self, key: Any) -> Any:  # noqa: ANN401 - as an array
        """Return a field of all rows, or what indexing the array gives."""
        if not isinstance(key, str):
            return np.asarray(self)[key]
        return np.concatenate(
            [np.zeros(0, self.dtype)[key], *(np.array(block[key]) for block in self.blocks())]
        )

    def __array__(
        self, dtype: np.dtype[Any] | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return all rows as one array."""
        rows = np.concatenate([np.zeros(0, self.dtype), *self.blocks()])
        return rows if dtype is None else rows.astype(dtype)

    def tobytes(self) -> bytes:
        """Return the bytes of all rows."""
        return np.asarray(self).tobytes()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the rows, wherever they are kept."""
        return Rows, (self.dtype, list(self.blocks()))


class Columns(Mapping[str, NDArray[np.float64]]):
    """Signals by name, each an array with one value per row; they are read one at a time."""

    def __init__(self, names: Sequence[str]) -> None:
        self._places = {name: place for place, name in enumerate(names)}
        self._spool = Spool(np.dtype("f8"))
        self._others: dict[str, Columns] = {}

    def append(self, values: NDArray[np.float64]) -> None:
        """Append a block without a copy, one row per signal; it must not change afterwards."""
        if values.shape[1]:
            self._spool.keep(values)

    def extend(self, count: int, rows: Iterable[NDArray[np.float64]]) -> None:
        """Append a block of ``count`` values of each signal, one signal after the other."""
        if count:
            self._spool.extend(count * len(self._places), rows)

    def parts(self, name: str) -> Iterator[NDArray[np.float64]]:
        """Yield the values of a signal in the parts in which they are kept.

        Raises:
            KeyError: there is no such signal.
        """
        if name in self._others:
            yield from self._others[name].parts(name)
            return
        place = self._places[name]
        for number, size in enumerate(self._spool.sizes):
            rows = size // len(self._places)
            for first in range(0, rows, PIECE):
                yield self._spool.read(number, place * rows + first, min(PIECE, rows - first))

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return all values of a signal."""
        holder, first = self._others.get(name, self), 0
        if name not in holder._places:
            raise KeyError(name)
        values = np.empty(sum(holder._spool.sizes) // len(holder._places))
        for part in self.parts(name):
            values[first : first + len(part)] = part
            first += len(part)
        return values

    def last(self) -> dict[str, float]:
        """Return the last value of each signal; empty where there is none yet."""
        sizes, several = self._spool.sizes, len(self._places)
        if not sizes:
            return {}
        number, rows = len(sizes) - 1, sizes[-1] // several
        return {
            name: float(self._spool.read(number, (place + 1) * rows - 1, 1)[0])
            for name, place in self._places.items()
        }

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        yield from self._places
        yield from (name for name in self._others if name not in self._places)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the signals, wherever they are kept."""
        return as_columns, (dict(self.items()),)

    def __len__(self) -> int:
        """Return the number of signals."""
        return len(self._places.keys() | self._others.keys())


def as_columns(signals: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return the same signals as :class:`Columns`."""
    if isinstance(signals, Columns):
        return signals
    columns = Columns(list(signals))
    columns.append(np.vstack(list(signals.values())))
    return columns


Table = Rows | NDArray[Any]
"""Rows of one type, in blocks or as one array."""


def blocks(table: Table) -> Iterator[NDArray[Any]]:
    """Yield the rows of a table in blocks that fit into memory."""
    if isinstance(table, Rows):
        yield from table.blocks()
    else:
        yield table


def with_signal(
    signals: Mapping[str, NDArray[np.float64]], name: str, parts: Iterable[NDArray[np.float64]]
) -> Mapping[str, NDArray[np.float64]]:
    """Return the same signals with ``name`` replaced or added; its values come in ``parts``."""
    if not isinstance(signals, Columns):
        return {**signals, name: np.concatenate([np.zeros(0), *parts])}
    other = Columns([name])
    for part in parts:
        other.append(part[np.newaxis])
    # not copy(), which would read all of them
    columns = Columns(())
    columns._places, columns._spool = signals._places, signals._spool
    columns._others = {**signals._others, name: other}
    return columns


def pieces(
    signals: Mapping[str, NDArray[np.float64]], *names: str
) -> Iterator[tuple[NDArray[np.float64], ...]]:
    """Yield the signals ``names`` together, :data:`PIECE` rows at a time; the last has the rest.

    What is summed piece by piece does so not depend on the blocks in which it was recorded.
    """
    yield from zip(*(_even(signals, name) for name in names), strict=True)


def row_count(signals: Mapping[str, NDArray[np.float64]]) -> int:
    """Return how many values each of the signals has."""
    return sum(len(piece) for (piece,) in pieces(signals, next(iter(signals))))


def _even(signals: Mapping[str, NDArray[np.float64]], name: str) -> Iterator[NDArray[np.float64]]:
    """Yield the values of a signal, :data:`PIECE` at a time."""
    parts = signals.parts(name) if isinstance(signals, Columns) else iter([signals[name]])
    held: list[NDArray[np.float64]] = []
    room = PIECE
    for part in parts:
        rest = part
        while len(rest) >= room:
            yield np.concatenate([*held, rest[:room]])
            held, rest, room = [], rest[room:], PIECE
        held.append(rest)
        room -= len(rest)
    if room < PIECE:
        yield held[0] if len(held) == 1 else np.concatenate(held)
