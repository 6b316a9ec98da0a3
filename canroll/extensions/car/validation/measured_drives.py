"""Measured drives from Python: a vehicle fitted to one, and judged by another."""

from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path

from canroll import vehicles
from canroll.arguments import checked
from canroll.errors import CanrollError
from canroll.extensions.car.identification import fit as identification
from canroll.extensions.car.identification.drive_log import Log, choice_of, read
from canroll.extensions.car.identification.fit import Fit, FitSettings
from canroll.extensions.car.identification.pieces import Window
from canroll.extensions.car.validation import validate as validation
from canroll.extensions.car.validation.measurement import NONE, zeroed
from canroll.extensions.car.validation.validate import Validation, ValidationSettings
from canroll.handling.vehicle_tests import NAMED
from canroll.typing import Progress


@checked
def fit(
    log: str | Path,
    vehicle: NAMED,
    *,
    signals: Mapping[str, str] | None = None,
    dbc: str | Path = "",
    map: str | Path = "",
    imu: str = "body",
    begin: float = -inf,
    end: float = inf,
    check: Sequence[float] | None = None,
    free: Sequence[str] = (),
    hold: Sequence[str] = (),
    starts: int = 3,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Fit:
    """Fit a vehicle to a measured drive, as ``canroll fit`` does.

    Args:
        log: CSV, MF4 or bus log with at least steering and speed, and a signal that they move.
        vehicle: where the fit starts: preset, file, table or vehicle.
        signals: name and unit ("NAME:UNIT") of quantities that the log's names do not tell.
        dbc: network description of a bus log.
        map: map of its signals to the ECU's fields.
        imu: axes of the inertial unit, "body" or "level".
        begin: of the part that is fitted, s.
        end: likewise, s.
        check: begin and end (s) of a part that is predicted only.
        free: keys to fit though their sources say that they are known.
        hold: keys to hold.
        starts: searches from the prior and from draws of it.
        jobs: processes.
        progress: called with the activity and the share done.

    Returns:
        The fit: ``vehicle`` has the numbers, ``table`` how sure they are, ``remarks`` what is
        strange.

    Raises:
        CanrollError: a log that cannot be used, or an unknown name.
    """
    settings = FitSettings(
        imu=imu,
        window=_window(begin, end),
        checked=None if check is None else _window(*check),
        free=free,
        held=hold,
        starts=starts,
        jobs=jobs,
    )
    measured = _read(log, signals, dbc, map)
    return identification.fit(measured, vehicles.load(vehicle), settings, progress or _quiet)


@checked
def validate(
    log: str | Path,
    vehicle: NAMED,
    *,
    signals: Mapping[str, str] | None = None,
    dbc: str | Path = "",
    map: str | Path = "",
    imu: str = "body",
    begin: float = -inf,
    end: float = inf,
    zero: Sequence[float] | None = None,
    manoeuvre: str = "",
) -> Validation:
    """Judge a vehicle by a measured drive, as ``canroll validate`` does.

    Args:
        log: as for :func:`fit`.
        vehicle: what is judged: preset, file, table or vehicle.
        signals: as for :func:`fit`.
        dbc: likewise.
        map: likewise.
        imu: likewise.
        begin: of the part that is judged, s.
        end: likewise, s.
        zero: begin and end (s) of driving straight ahead, from which sensor offsets are taken.
        manoeuvre: one of ``manoeuvre.MANOEUVRES``; "": recognised.

    Returns:
        The verdict, ``passed``, and ``table`` with a row for each signal.

    Raises:
        CanrollError: the log cannot be used, or is not the named manoeuvre.
        VerdictError: the simulated car rolls over.
    """
    settings = ValidationSettings(imu=imu, window=_window(begin, end), manoeuvre=manoeuvre)
    measured = _read(log, signals, dbc, map)
    measurement = NONE if zero is None else zeroed(measured, _window(*zero))
    return validation.validate(measured, vehicles.load(vehicle), settings, measurement)


def _read(
    log: str | Path, signals: Mapping[str, str] | None, dbc: str | Path, map_file: str | Path
) -> Log:
    named = (f"{name}={text}" for name, text in (signals or {}).items())
    return read(str(log), dict(map(choice_of, named)), dbc=str(dbc), map_file=str(map_file))


def _window(begin: float, end: float) -> Window:
    """Return a part of the log."""
    if not begin < end:
        raise CanrollError(f"from {begin:g} to {end:g} s: nothing is between them")
    return Window(begin, end)


def _quiet(stage: str, share: float) -> None:
    """Show no progress."""
