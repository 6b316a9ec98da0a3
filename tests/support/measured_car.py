"""A measured car, a BMW M8 in a double lane change (examples/bmw_m8), for the 14-DOF plant."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll import vehicles
from canroll.documents import toml
from canroll.errors import CanrollError, reason
from canroll.extensions.car.identification import agreement as of_signals
from canroll.extensions.car.identification import drive_log
from canroll.extensions.car.identification.pieces import SAMPLE, Piece, Window, pieces
from canroll.extensions.car.identification.unknowns import LOG, Unknown
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from support import measured_fit
from support.measured_fit import Fit, steered

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "bmw_m8"
DRIVE = EXAMPLE / "double_lane_change.csv"
MANOEUVRE = Window(9.3, 15.6)
FIRST, SECOND = Window(9.3, 12.45), Window(12.45, 15.6)

UNITS = (("°/s", np.degrees(1.0)), ("m/s²", 1.0), ("°/s", np.degrees(1.0)), ("°", np.degrees(1.0)))


class Case(NamedTuple):
    """The car of the example, its drive, and how that was measured."""

    vehicle: Vehicle
    measured: Piece
    mounting: Mapping[str, float]


def case() -> Case:
    """Read the example.

    Raises:
        CanrollError: a file of it cannot be read.
    """
    path = EXAMPLE / "double_lane_change.toml"
    try:
        mounting = {f"{LOG}.{name}": value for name, value in toml(path)["mounting"].items()}
    except (OSError, ValueError, KeyError) as error:
        raise CanrollError(f"cannot read {path}: {reason(error)}") from error
    (measured,), _ = pieces(drive_log.read(str(DRIVE), {}), MANOEUVRE)
    return Case(vehicles.load("bmw_m8"), measured, mounting)


def inside(piece: Piece, window: Window) -> NDArray[np.bool_]:
    """Return which samples lie in ``window``, also of the run-in, and were not lost."""
    half = SAMPLE / 2
    there = (piece.time > window.begin - half) & (piece.time < window.end - half)
    return np.asarray(there & np.isfinite(piece.measured).all(axis=1))


def agreement(case: Case, window: Window) -> Vector:
    """Return the variance of each signal accounted for in ``window`` (4)."""
    piece, compared = case.measured, inside(case.measured, window)
    simulated = steered(*case)
    return np.array(
        [
            of_signals.agreement(name, measured, shown, piece.steering, compared).explained
            for name, measured, shown in zip(
                piece.names, np.nan_to_num(piece.measured).T, simulated.T, strict=True
            )
        ]
    )


def pitch_rate_share(path: Path, window: Window) -> tuple[float, float]:
    """What the unit's pitch rate has of yaw rate × roll, with its standard deviation.

    The change of the pitch angle is regressed on the integrals of the pitch rate and of that
    product: −1 if the rates are those about the body's axes, 0 if they are Euler rates.
    """
    columns = np.genfromtxt(path, delimiter=",", names=True)
    there = (columns["time_s"] > window.begin) & (columns["time_s"] < window.end)
    time, pitch, pitch_rate, yaw_rate, roll = (
        columns[name][there]
        for name in ("time_s", "pitch_rad", "pitch_rate_rad_s", "yaw_rate_rad_s", "roll_rad")
    )

    def integral(rate: NDArray[np.float64]) -> NDArray[np.float64]:
        means = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
        return np.concatenate(([0.0], np.cumsum(means)))

    one = np.ones_like(time)
    matrix = np.column_stack((integral(yaw_rate * roll), integral(pitch_rate), integral(one), one))
    solution, squares, *_ = np.linalg.lstsq(matrix, pitch, rcond=None)
    variance = measured_fit.CORRELATED * squares[0] / time.size
    return float(solution[0]), float(np.sqrt(variance * np.linalg.inv(matrix.T @ matrix)[0, 0]))


def fitted_with(further: Unknown, case: Case) -> Fit:
    """Fit the whole manoeuvre with a ``further`` unknown, the last of the result."""
    unknowns = (*measured_fit.UNKNOWNS, further)
    return measured_fit.fit(case.vehicle, case.measured, MANOEUVRE, unknowns)
