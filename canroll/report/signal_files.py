"""The signals of a run as a file: CSV, MF4, Parquet, and the formats that extensions add.

All but CSV are written by packages of others, and carry what the run was (``about``) and the unit
of each signal; MF4 has the network description as an attachment.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.errors import CanrollError, MissingExtraError, optional, writing
from canroll.plant_sim.world.recording import unit
from canroll.plant_sim.world.spool import Table, pieces
from canroll.registry import Registry


@dataclass(frozen=True, slots=True)
class About:
    """What goes with the signals: texts by name, frames of the bus, the network's description."""

    texts: Mapping[str, str] = field(default_factory=dict)
    frames: Table | None = None
    dbc: tuple[Path, ...] = ()


class Format(NamedTuple):
    """A format: what writes it, the package that this takes, and the extra that brings that."""

    write: Callable[[Path, Mapping[str, NDArray[np.float64]], About], None]
    package: str = ""
    extra: str = ""


FORMATS: "Registry[Format]" = Registry(
    "signal file",
    "canroll.signal_files",
    {f".{name}": f"{__name__}:{name.upper()}" for name in ("csv", "mf4", "parquet")},
)
"""The formats by their suffix."""


def check_suffix(path: Path) -> Path:
    """Return ``path`` if its suffix is that of a supported format.

    Raises:
        CanrollError: another suffix, or the package for it is missing.
    """
    suffix = path.suffix.lower()
    if suffix not in list(FORMATS):  # nor a reference to code, which a registry takes
        raise CanrollError(
            f"{path}: the suffix of a signal file must be one of {', '.join(FORMATS)}"
        )
    known = FORMATS[suffix]
    if known.package and find_spec(known.package) is None:
        raise MissingExtraError(f"--signals FILE{suffix}", known.extra)
    return path


def write_signals(
    path: str | Path, signals: Mapping[str, NDArray[np.float64]], about: About | None = None
) -> Path:
    """Write the signals of a trace, a row per millisecond, SI units, "time" first; return the path.

    Numbers in CSV have nine digits. The same signals give the same bytes, but for MF4, which has
    the time of writing.

    Raises:
        CanrollError: a suffix of no supported format, or the file cannot be written.
    """
    path = check_suffix(Path(path))
    with writing(path):
        FORMATS[path.suffix.lower()].write(path, signals, about or About())
    return path


def _write_csv(path: Path, signals: Mapping[str, NDArray[np.float64]], _about: About) -> None:
    with path.open("w", encoding="latin-1") as file:
        file.write(",".join(signals) + "\n")
        for columns in pieces(signals, *signals):
            np.savetxt(file, np.column_stack(columns), fmt="%.9g", delimiter=",")


def _write_mf4(path: Path, signals: Mapping[str, NDArray[np.float64]], about: About) -> None:
    """Write ``signals`` as ASAM MDF 4 with their units; "time" is the common axis, s."""
    mdf = optional("asammdf", "an MF4 file", "asammdf")
    channels = [
        mdf.Signal(np.ascontiguousarray(values), signals["time"], name=name, unit=unit(name))
        for name, values in signals.items()
        if name != "time"
    ]
    with mdf.MDF(version="4.10") as file:
        file.append(channels, comment="canroll")
        file.header.comment = "\n".join(f"{key}: {text}" for key, text in about.texts.items())
        file.header.project = "canroll"
        file.header.subject = about.texts.get("vehicle", "")
        for described in about.dbc:
            data = described.read_bytes()
            file.attach(data, file_name=described.name, comment="bus", mime="text/plain")
        file.save(path, overwrite=True)


def _write_parquet(path: Path, signals: Mapping[str, NDArray[np.float64]], about: About) -> None:
    """Write ``signals`` as Parquet: units at the fields, ``about`` at the table."""
    pa = optional("pyarrow", "a Parquet file", "campaign")
    parquet = optional("pyarrow.parquet", "a Parquet file", "campaign")
    schema = pa.schema(
        [pa.field(name, pa.float64(), metadata={"unit": unit(name)}) for name in signals],
        metadata={f"canroll.{key}": text for key, text in about.texts.items()},
    )
    arrays = [pa.array(np.ascontiguousarray(values)) for values in signals.values()]
    parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), path, compression="zstd")


CSV = Format(_write_csv)
MF4 = Format(_write_mf4, "asammdf", "asammdf")
PARQUET = Format(_write_parquet, "pyarrow", "campaign")
