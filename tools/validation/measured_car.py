"""The 14-DOF car against a measured one: a BMW M8 in a double lane change.

``python -m tools.validation.measured_car`` and

    fit             the numbers of the vehicle file: fitted on the manoeuvre
    fit first       the same on the first half of it
    frames          in which axes the inertial unit measures
    remains         what a crossfall of the road would explain
    picture FILE    measured and simulated signals over time, as a PNG

``scripts/validation-tables measured`` prints how well the car agrees. Data: examples/bmw_m8.
"""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import vehicles
from canroll.documents import toml
from canroll.errors import CanrollError, reason
from canroll.extensions.car.identification import agreement as of_signals
from canroll.extensions.car.identification import drive_log
from canroll.extensions.car.identification.drive_log import QUANTITIES
from canroll.extensions.car.identification.pieces import SAMPLE, Piece, Window, pieces
from canroll.extensions.car.identification.unknowns import LOG
from canroll.extensions.car.validation.rating import rate
from canroll.typing import Vector
from tools.validation import measured_fit
from tools.validation.measured_fit import Fit, Unknown, steered
from vehicles import Vehicle

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "bmw_m8"
DRIVE = EXAMPLE / "double_lane_change.csv"
MANOEUVRE = Window(9.3, 15.6)
FIRST, SECOND = Window(9.3, 12.45), Window(12.45, 15.6)
STRAIGHT = Window(8.5, 9.3)
"""Before the manoeuvre: what moves the car here is the road."""

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


def fitted_on(window: Window, case: Case) -> Case:
    """Return the case with the numbers that fit the part of its drive in ``window``."""
    fit = measured_fit.fit(case.vehicle, case.measured, window)
    return case._replace(vehicle=fit.vehicle, mounting=fit.mounting)


def table() -> Iterator[str]:
    """Lines of the table of how well the car agrees."""
    example = case()
    ours = agreement(example, MANOEUVRE)
    ahead = agreement(fitted_on(FIRST, example), SECOND)
    signals, simulated = example.measured.measured, steered(*example)
    fitted, straight = (inside(example.measured, part) for part in (MANOEUVRE, STRAIGHT))
    left, road = (np.std((signals - simulated)[part], axis=0) for part in (fitted, straight))
    yield (
        "| signal | VAF (%) | VAF of the second half, fitted on the first (%) | ISO/TS 18571 "
        "| standard deviation of the difference | on the straight before |"
    )
    yield "| --- | ---: | ---: | ---: | ---: | ---: |"
    for i, (name, (unit, factor)) in enumerate(zip(example.measured.names, UNITS, strict=True)):
        rated = rate(signals[fitted, i], simulated[fitted, i]).overall
        yield (
            f"| {QUANTITIES[name].label} | {100 * ours[i]:.2f} | {100 * ahead[i]:.2f} "
            f"| {rated:.3f} | {factor * left[i]:.2g} {unit} | {factor * road[i]:.2g} {unit} |"
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


def frames() -> Iterator[str]:
    """Lines of the table of what the inertial unit gives."""
    example = case()
    share, deviation = pitch_rate_share(DRIVE, MANOEUVRE)
    fit = fitted_with(measured_fit.OF_GRAVITY, example)
    yield "| what | along and about the body's axes | horizontal | measured |"
    yield "| --- | ---: | ---: | ---: |"
    yield f"| yaw rate × roll in the pitch rate | −1 | 0 | {share:.2f} ± {deviation:.2f} |"
    gravity, deviation = fit.values[-1], fit.deviations[-1]
    yield f"| g sin(roll) in the lateral acceleration | 1 | 0 | {gravity:.2f} ± {deviation:.2f} |"


def remains() -> Iterator[str]:
    """Lines of the table of what a crossfall of the road would explain."""
    example = case()
    fit = fitted_with(measured_fit.OF_CROSSFALL, example)
    cases = (example, example._replace(vehicle=fit.vehicle, mounting=fit.mounting))
    flat, crowned = (agreement(one, MANOEUVRE)[3] for one in cases)
    slope, deviation = np.degrees(fit.values[-1]), np.degrees(fit.deviations[-1])
    yield "| road | change of bank per metre to the left | VAF of the roll (%) |"
    yield "| --- | ---: | ---: |"
    yield f"| even | 0 | {100 * flat:.2f} |"
    yield f"| crossfall fitted | {slope:.3f}° ± {deviation:.3f}° | {100 * crowned:.2f} |"


def picture(path: Path) -> None:
    """Draw the four signals over time, measured and simulated, as a PNG.

    Raises:
        CanrollError: the file cannot be written.
    """
    import matplotlib as mpl  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    example = case()
    simulated = steered(*example)
    there, time = inside(example.measured, MANOEUVRE), example.measured.time
    names = example.measured.names
    with mpl.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = Figure(figsize=(8, 8), layout="constrained")
        axes: Any = figure.subplots(len(names), 1, sharex=True)
        for i, (name, (unit, factor)) in enumerate(zip(names, UNITS, strict=True)):
            shown = {"measured": example.measured.measured, "simulated": simulated}
            styles = ({"color": "#4d4d4d", "lw": 1.8}, {"color": "#d55e00", "lw": 1.0})
            for (label, signals), style in zip(shown.items(), styles, strict=True):
                axes[i].plot(time[there], factor * signals[there, i], label=label, **style)
            axes[i].set_ylabel(f"{QUANTITIES[name].label} ({unit})")
        axes[0].legend(loc="upper left")
        axes[-1].set_xlabel("time (s)")
        try:
            # without metadata the same numbers give the same bytes
            figure.savefig(path, dpi=110, metadata={"Software": None})
        except OSError as error:
            raise CanrollError(f"cannot write {path}: {reason(error)}") from error


def main(arguments: list[str]) -> int:
    """Run the command; return the exit code."""
    try:
        match arguments:
            case ["fit"] | ["fit", "first"]:
                example = case()
                window = FIRST if arguments[1:] else MANOEUVRE
                fit = measured_fit.fit(example.vehicle, example.measured, window)
                print("\n".join(measured_fit.table(fit)))
            case ["frames"]:
                print("\n".join(frames()))
            case ["remains"]:
                print("\n".join(remains()))
            case ["picture", file]:
                picture(Path(file))
            case _:
                print(__doc__, file=sys.stderr)
                return 2
    except CanrollError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
