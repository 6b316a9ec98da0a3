"""Record of a run, as arrays, and records as NumPy archives: an entry for each field."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from canroll import documents
from canroll.codegen.run.memory_image import dtype
from canroll.errors import optional
from canroll.firmware import calibration as formats
from canroll.firmware import subset
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import GYRO_BIAS, LATERAL, LATERAL_RATE, ROLL, ROLL_RATE, Ecu
from canroll.gain_gen.calibration.record import fill
from canroll.plant_sim.world import archive
from canroll.plant_sim.world.recording import unit
from canroll.plant_sim.world.spool import Table, as_columns

if TYPE_CHECKING:
    import pandas
    import xarray

T = TypeVar("T")
Signals = Mapping[str, NDArray[np.float64]]
NAMES = "signal_names"
DEFAULTED = ("bus", "refused")
"""Fields that an archive may lack."""
TICK = np.dtype(
    [
        ("t", "f8"),
        ("mode", "u1"),
        ("triggered", "u1"),
        ("fault_codes", "u4"),
        ("moment", "f8"),
        ("outputs", "f8", (2,)),
        ("roll", "f8"),
        ("roll_rate", "f8"),
        ("lateral_acceleration", "f8"),
        ("lateral_rate", "f8"),
        ("gyro_bias", "f8"),
    ]
)
"""What is kept of every tick, SI units: ``triggered`` 0 nothing, 1 trigger, 2 heartbeat; ``moment``
the anti-roll moment before trigger and split, ``outputs`` those of a law with two; the estimate."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Record of one run.

    Attributes:
        signals: the vehicle every millisecond, one float64 array per signal, SI units; "time" in s.
            Of a long run each is read from a temporary file when it is looked up.
        frames: the bus log, one entry per frame and segment, times in ns; of a long run in blocks.
        ages: sample-to-force age of each newly applied command, ns.
        ticks: the ECU's state and outputs, one entry per tick (:data:`TICK`).
        duration: length of the run, s.
        complete: False if it was interrupted.
        refused: frames that the ECU and the actuators refused as not authentic; None: the frames of
            the bus are not authenticated.
    """

    signals: Signals
    frames: Table
    ages: NDArray[np.int64]
    ticks: Table
    duration: float
    complete: bool = True
    refused: tuple[int, int] | None = None

    def to_xarray(self) -> "xarray.Dataset":
        """Return the signals over "time" with their units, and the ECU's ticks over "tick".

        Raises:
            MissingExtraError: xarray is not installed.
        """
        xr = optional("xarray", "to_xarray()", "notebook")
        data = {
            name: ("time", values, {"units": unit(name)})
            for name, values in self.signals.items()
            if name != "time"
        }
        ticks = {
            f"ecu_{name}": ("tick", self.ticks[name])
            for name in self.ticks.dtype.names or ()
            if name != "t" and self.ticks[name].ndim == 1
        }
        times = {"time": ("time", self.signals["time"], {"units": "s"})}
        coordinates = {**times, "tick": ("tick", self.ticks["t"], {"units": "s"})}
        dataset: xarray.Dataset = xr.Dataset({**data, **ticks}, coords=coordinates)
        return dataset

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the signals as columns over "time", SI units in ``attrs["units"]``.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        pandas = optional("pandas", "to_pandas()", "notebook")
        names = [name for name in self.signals if name != "time"]
        index = pandas.Index(self.signals["time"], name="time")
        table = pandas.DataFrame({name: self.signals[name] for name in names}, index=index)
        table.attrs["units"] = {name: unit(name) for name in names}
        return table


def tick_rows(
    times: Sequence[float],
    images: Sequence[bytes],
    record: Any = Ecu,  # noqa: ANN401
) -> NDArray[np.void]:
    """Return rows of :data:`TICK` from the records after ticks at ``times`` (s).

    ``record`` is the class of the state record, which differs between buses.
    """
    states = np.frombuffer(b"".join(images), dtype(record))
    rows, state = np.zeros(len(states), TICK), states["x"].T
    rows["t"] = times
    rows["mode"] = states["mode"]
    rows["triggered"] = states["triggered"]
    rows["fault_codes"] = states["fault_active"]
    rows["moment"] = states["moment"] / 2**formats.Q_MOMENT
    rows["outputs"] = states["outputs"] / 2**formats.Q_MOMENT
    rows["roll"] = state[ROLL] / 2**formats.Q_ANGLE
    rows["roll_rate"] = state[ROLL_RATE] / 2**formats.Q_RATE
    rows["lateral_acceleration"] = state[LATERAL] / 2**formats.Q_ACCELERATION
    rows["lateral_rate"] = state[LATERAL_RATE] / 2**formats.Q_ACCELERATION
    rows["gyro_bias"] = state[GYRO_BIAS] / 2**formats.Q_RATE
    return rows


def entries(record: object, prefix: str = "") -> dict[str, archive.Entry]:
    """Return the entries of a record; what is None has none."""
    made: dict[str, archive.Entry] = {}
    for name, hint in get_type_hints(type(record)).items():
        value = getattr(record, name)
        if hint == Signals:
            made[prefix + NAMES] = np.array(list(value))
            value = as_columns(value)
        elif isinstance(value, Calibration):
            integers = {
                field.name: getattr(value, field.name) for field in subset.fields(Calibration)
            }
            value = np.array(json.dumps(integers))
        elif isinstance(value, Mapping):
            value = np.array(json.dumps(dict(value)))
        if value is not None:
            made[prefix + name] = value if hint in (Signals, Table) else np.asarray(value)
    return made


def restored(kind: type[T], stored: archive.Archive, prefix: str = "") -> T:
    """Return the record of a dataclass; a field without an entry has its default.

    Raises:
        canroll.errors.UNREADABLE: an entry is missing, or of another type.
    """
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        entry = prefix + name
        if hint == Signals:
            values[name] = stored.signals(entry, map(str, stored.array(prefix + NAMES)))
        elif hint == Table:
            values[name] = stored.rows(entry)
        elif entry in stored or name not in DEFAULTED:
            values[name] = _value(stored.array(entry), hint)
    return kind(**values)


def _value(array: NDArray[Any], hint: Any) -> Any:  # noqa: ANN401
    if get_origin(hint) is np.ndarray:
        return array
    if hint is Calibration:
        return fill(documents.parse_json(str(array)))
    if get_origin(hint) is Mapping:
        return documents.parse_json(str(array))
    return hint(array) if isinstance(hint, type) else tuple(array.tolist())
