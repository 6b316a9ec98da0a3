"""Fit of the 14-DOF car to a measured drive by output error.

Least squares over the four signals of :mod:`tools.validation.measured_drive`, each weighted by the
RMS of its own residual in the pass before (maximum likelihood with unknown noise), and over the
priors: an unknown about which the drive says nothing stays at its prior mean.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import floor, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from canroll.typing import Vector
from tools.validation.measured_drive import Measured, Mounting, Window, replay
from vehicles import Vehicle

PASSES = 4
CORRELATED = 10.0
"""Samples per independent one: residuals are correlated over about 0.1 s."""

NOISE = (0.003, 0.15, 0.01, 0.0015)
"""Residual of each signal that the first pass assumes (rad/s, m/s², rad/s, rad)."""

DIFFERENCE = 1e-3
"""Step of the numerical derivatives, in standard deviations of the priors."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """A number to fit: prior mean and standard deviation, bounds, and where the prior comes from.

    ``key`` is that of the vehicle file, ``sensors.imu_position.0`` the first of a list, or
    ``mounting`` and a field of :class:`~tools.validation.measured_drive.Mounting`.
    """

    key: str
    mean: float
    deviation: float
    least: float
    most: float
    prior: str


TYRE, BODY = "30 per rad of the static load", "car of this class"
UNKNOWNS = (
    Unknown("tyre.cornering_stiffness_front", 320e3, 60e3, 100e3, 600e3, TYRE),
    Unknown("tyre.cornering_stiffness_rear", 290e3, 60e3, 100e3, 600e3, TYRE),
    Unknown("tyre.cornering_load_slope", 0.15, 0.10, 0.0, 0.49, "passenger-car tyres"),
    Unknown("tyre.friction", 1.10, 0.10, 0.8, 1.4, "dry asphalt"),
    Unknown("tyre.relaxation_length", 0.50, 0.20, 0.05, 1.5, "passenger-car tyres"),
    Unknown("mass.yaw_inertia", 3800.0, 200.0, 2500.0, 6000.0, "0.92 m l_f l_r"),
    Unknown("plant.roll_inertia", 950.0, 80.0, 500.0, 2000.0, "0.55 m of gyration about the CG"),
    Unknown("plant.roll_damping", 9000.0, 5000.0, 1000.0, 40e3, "30 % of critical"),
    Unknown("plant.roll_stiffness", 165e3, 40e3, 80e3, 400e3, "3 degrees per g"),
    Unknown("plant.cg_height_above_roll_axis", 0.46, 0.04, 0.30, 0.60, BODY),
    Unknown("geometry.roll_centre_height_front", 0.06, 0.04, -0.10, 0.25, BODY),
    Unknown("geometry.roll_centre_height_rear", 0.10, 0.04, -0.10, 0.25, BODY),
    Unknown("suspension.roll_stiffness_front_share", 0.55, 0.07, 0.3, 0.8, BODY),
    Unknown("suspension.roll_damping_front_share", 0.50, 0.10, 0.2, 0.8, BODY),
    Unknown("sensors.imu_position.0", 0.0, 0.50, -2.0, 2.0, "inside the car"),
    Unknown("sensors.imu_position.2", 0.0, 0.30, -0.5, 1.0, "inside the car"),
    Unknown("mounting.steering_offset", 0.0, 0.03, -0.2, 0.2, ""),
    Unknown("mounting.steering_delay", 0.0, 0.01, -0.05, 0.05, "one sample"),
    Unknown("mounting.roll_offset", 0.0, 0.01, -0.03, 0.03, ""),
)

GRAVITY_SHARE = Unknown("mounting.gravity", 0.5, 10.0, -50.0, 50.0, "")
CROSSFALL = Unknown("mounting.crossfall", 0.0, 0.01, -0.05, 0.05, "")
"""Further unknowns, to find out what the unit gives and what the road does."""


def _changed(record: Any, path: list[str], value: float) -> Any:  # noqa: ANN401
    """Return ``record``, dataclasses with tuples in them, with the number at ``path`` replaced."""
    name, *rest = path
    if isinstance(record, tuple):
        return tuple(value if i == int(name) else item for i, item in enumerate(record))
    inner = _changed(getattr(record, name), rest, value) if rest else value
    return replace(record, **{name: inner})


@dataclass(frozen=True, slots=True)
class Fit:
    """The fitted values, their standard deviations, and the car and mounting that they make."""

    unknowns: tuple[Unknown, ...]
    values: Vector
    deviations: Vector
    vehicle: Vehicle
    mounting: Mounting


def applied(
    vehicle: Vehicle, unknowns: tuple[Unknown, ...], values: Vector
) -> tuple[Vehicle, Mounting]:
    """Return ``vehicle`` with ``values`` for the ``unknowns``, and the mounting."""
    mounting = Mounting()
    for unknown, value in zip(unknowns, values.tolist(), strict=True):
        section, *path = unknown.key.split(".")
        if section == "mounting":
            mounting = mounting._replace(**{path[0]: value})
        else:
            vehicle = _changed(vehicle, [section, *path], value)
    return vehicle, mounting


def fit(
    vehicle: Vehicle,
    measured: Measured,
    window: Window,
    unknowns: tuple[Unknown, ...] = UNKNOWNS,
) -> Fit:
    """Fit ``unknowns`` to the part of ``measured`` in ``window``.

    What ``vehicle`` has for them does not matter: the search starts from the priors.
    """
    mean, deviation, least, most = (
        np.array([getattr(unknown, name) for unknown in unknowns])
        for name in ("mean", "deviation", "least", "most")
    )
    inside = measured.inside(window)

    def error(x: Vector) -> NDArray[np.float64]:
        changed, mounting = applied(vehicle, unknowns, mean + deviation * x)
        simulated = replay(changed, measured, mounting)
        return np.asarray(simulated[inside] - measured.signals[inside])

    noise, x = np.array(NOISE), np.zeros(mean.size)
    for _ in range(PASSES):
        scale = noise * np.sqrt(CORRELATED)

        def weighted(x: Vector, scale: Vector = scale) -> Vector:
            return np.concatenate(((error(x) / scale).ravel(), x))

        def slopes(x: Vector, of: Any = weighted) -> NDArray[np.float64]:  # noqa: ANN401
            here = of(x)
            steps = DIFFERENCE * np.eye(x.size)
            return np.column_stack([(of(x + step) - here) / DIFFERENCE for step in steps])

        bounds = (least - mean) / deviation, (most - mean) / deviation
        solved = least_squares(weighted, x, slopes, bounds, ftol=1e-7, xtol=1e-4)
        x = solved.x
        noise = np.sqrt(np.mean(error(x) ** 2, axis=0))
    covariance = np.linalg.inv(solved.jac.T @ solved.jac)
    values = mean + deviation * x
    return Fit(
        unknowns,
        values,
        deviation * np.sqrt(np.diag(covariance)),
        *applied(vehicle, unknowns, values),
    )


def table(fitted: Fit) -> Iterator[str]:
    """Lines of a table: value and standard deviation of each unknown, and its prior.

    Values are rounded to the second digit of their deviation, as in the vehicle file.
    Learnt: how much smaller the deviation is than the prior's, 0 if the drive says nothing.
    """
    yield "| number | fitted | ± | prior | learnt from the drive |"
    yield "| --- | ---: | ---: | --- | ---: |"
    for unknown, value, deviation in zip(
        fitted.unknowns, fitted.values, fitted.deviations, strict=True
    ):
        digits = 1 - floor(log10(deviation))
        fitted_value = f"{round(value, digits):g} | {round(deviation, digits):g}"
        prior = f"{unknown.mean:g} ± {unknown.deviation:g}"
        prior += f": {unknown.prior}" if unknown.prior else ""
        learnt = 1.0 - deviation / unknown.deviation
        yield f"| `{unknown.key}` | {fitted_value} | {prior} | {learnt:.0%} |"
