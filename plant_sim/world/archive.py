"""NumPy archives (.npz) written and read in blocks, so that no array need fit into memory.

The bytes are those of ``np.savez_compressed`` and ``np.savez`` for the same arrays.
"""

import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from canroll.plant_sim.world.spool import Columns, Rows, blocks, row_count

READ_BYTES = 1 << 20
"""Bytes of an array that are read at a time."""

Entry = NDArray[Any] | Rows | Columns


def write(path: Path, entries: Mapping[str, Entry], *, compressed: bool) -> None:
    """Write arrays by name; signals are written as one array with a row per signal.

    Raises:
        OSError: the file cannot be written.
    """
    method = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", method, allowZip64=True) as archive:
        for name, entry in entries.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                _write_entry(file, entry)


def _write_entry(file: IO[bytes], entry: Entry) -> None:
    if isinstance(entry, np.ndarray):
        npy.write_array(file, entry, allow_pickle=False)
    elif isinstance(entry, Rows):
        _write_blocks(file, entry.dtype, (len(entry),), blocks(entry))
    else:
        shape = (len(entry), row_count(entry))
        parts = (part for name in entry for part in entry.parts(name))
        _write_blocks(file, np.dtype("f8"), shape, parts)


def _write_blocks(
    file: IO[bytes], dtype: np.dtype[Any], shape: tuple[int, ...], parts: Iterable[NDArray[Any]]
) -> None:
    header = {"descr": npy.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    npy.write_array_header_1_0(file, header)
    for part in parts:
        file.write(np.ascontiguousarray(part).tobytes())


class Archive:
    """An archive opened for reading; errors are those of :data:`canroll.errors.UNREADABLE`."""

    def __init__(self, path: Path) -> None:
        self._zip = zipfile.ZipFile(path)

    def __enter__(self) -> "Archive":
        """Return the archive."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._zip.close()

    def __contains__(self, name: str) -> bool:
        """Whether there is an array of that name."""
        return f"{name}.npy" in self._zip.namelist()

    def array(self, name: str) -> NDArray[Any]:
        """Return an array."""
        with self._zip.open(f"{name}.npy") as file:
            dtype, shape, order = self._header(name, file)
            count = int(np.prod(shape, dtype=np.int64))
            data = np.frombuffer(_exactly(file, count * dtype.itemsize), dtype, count)
        return data.reshape(shape, order=order)

    def rows(self, name: str) -> Rows:
        """Return a table, read in blocks."""
        with self._zip.open(f"{name}.npy") as file:
            dtype, (count,), _ = self._header(name, file)
            rows = Rows(dtype)
            at_a_time = max(1, READ_BYTES // max(1, dtype.itemsize))
            while count:
                size = min(count, at_a_time)
                rows.append(np.frombuffer(_exactly(file, size * dtype.itemsize), dtype))
                count -= size
        return rows

    def signals(self, name: str, names: Iterable[str]) -> Columns:
        """Return the signals ``names`` from an array with a row per signal."""
        with self._zip.open(f"{name}.npy") as file:
            dtype, (signals, count), order = self._header(name, file)
            columns = Columns(list(names))
            if dtype != np.dtype("f8") or order != "C" or signals != len(columns):
                raise ValueError(f"{name}: expected {len(columns)} rows of float64")
            columns.extend(
                count, (np.frombuffer(_exactly(file, 8 * count)) for _ in range(signals))
            )
        return columns

    def _header(self, name: str, file: IO[bytes]) -> tuple[np.dtype[Any], tuple[int, ...], Any]:
        """Type, shape and order of an array, whose bytes are as many as its header says."""
        if npy.read_magic(file) != (1, 0):
            raise ValueError(f"{name}: unknown version of the .npy format")
        shape, fortran, dtype = npy.read_array_header_1_0(file)
        if dtype.hasobject:
            raise ValueError(f"{name}: objects are not read")
        stored = self._zip.getinfo(f"{name}.npy").file_size - file.tell()
        count = 1
        for size in shape:
            count *= size
        if min(shape, default=0) < 0 or count * dtype.itemsize != stored:
            raise ValueError(f"{name}: {stored} bytes for {count} entries of {dtype.itemsize}")
        return dtype, shape, "F" if fortran else "C"


def _exactly(file: IO[bytes], count: int) -> bytes:
    content = file.read(count)
    if len(content) != count:
        raise ValueError(f"{count - len(content)} bytes are missing")
    return content
