"""What the ECU's recursive least squares make of a drive, beside the numbers fitted offline."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from canroll.firmware.calibration import Calibration
from canroll.firmware.identification import RATIO_ONE
from canroll.report.page import PageTable
from canroll.vehicles import GRAVITY, Vehicle

SURE = 1.96
"""Standard deviations on either side of 95 % of a normal distribution."""
NEAR = 0.005
"""Distance from a bound, relative, within which a number stands at it."""


@dataclass(frozen=True, slots=True)
class RecursiveEstimate:
    """A number that the ECU identifies while driving.

    Attributes:
        label: its name.
        unit: of all values.
        start: of the calibration, where the ECU starts.
        recursive: after the drive.
        bounded: whether that is a bound of the calibration, which the ECU does not go beyond.
        fitted: of the offline fit, or None without one.
        half_width: of the fit's 95 % interval, or None.
    """

    label: str
    unit: str
    start: float
    recursive: float
    bounded: bool
    fitted: float | None = None
    half_width: float | None = None


def estimates(
    ratios: Sequence[float],
    record: Calibration,
    calibrated: Vehicle,
    fitted: Vehicle | None,
) -> tuple[RecursiveEstimate, ...]:
    """Return roll stiffness less gravity, K − m g h, and roll damping, as the ECU identified them.

    Args:
        ratios: of both to those of the calibration, after the drive.
        record: the calibration, for the bounds of the ratios.
        calibrated: vehicle of the calibration.
        fitted: vehicle fitted offline, or None.
    """
    start = calibrated.design
    body = start if fitted is None else fitted.plant
    numbers = (
        (
            "roll stiffness less gravity",
            "N·m/rad",
            start.effective_stiffness,
            None if fitted is None else fitted.plant.effective_stiffness,
            {
                "plant.roll_stiffness": 1.0,
                "plant.cg_height_above_roll_axis": -body.sprung_mass * GRAVITY,
                "plant.sprung_mass": -body.cg_height_above_roll_axis * GRAVITY,
            },
        ),
        (
            "roll damping",
            "N·m·s/rad",
            start.roll_damping,
            None if fitted is None else fitted.plant.roll_damping,
            {"plant.roll_damping": 1.0},
        ),
    )
    return tuple(
        RecursiveEstimate(
            label,
            unit,
            start=at,
            recursive=at * ratio,
            bounded=not (1 + NEAR) * least < ratio * RATIO_ONE < (1 - NEAR) * most,
            fitted=value,
            half_width=_half_width(fitted, slopes),
        )
        for (label, unit, at, value, slopes), ratio, least, most in zip(
            numbers, ratios, record.rls_lo, record.rls_hi, strict=True
        )
    )


def _half_width(fitted: Vehicle | None, slopes: Mapping[str, float]) -> float | None:
    """Return half the 95 % interval of a number with these slopes over the fitted ones."""
    if fitted is None or fitted.fit is None or not set(slopes) & set(fitted.fit.names):
        return None
    slope = np.array([slopes.get(name, 0.0) for name in fitted.fit.names])
    scaled = slope * np.array(fitted.fit.deviations)
    return SURE * sqrt(float(scaled @ fitted.fit.matrix @ scaled))


def estimate_table(of: Sequence[RecursiveEstimate]) -> PageTable:
    """Return the estimates as a table, each with its place in the interval of the fit."""
    return PageTable(
        "Identified by the ECU",
        ("number", "calibrated", "identified", "fitted offline, 95 %", "unit", ""),
        [
            (
                one.label,
                f"{one.start:.4g}",
                f"{one.recursive:.4g}",
                _interval(one),
                one.unit,
                _verdict(one),
            )
            for one in of
        ],
    )


def _interval(one: RecursiveEstimate) -> str:
    if one.fitted is None:
        return ""
    return f"{one.fitted:.4g}" + ("" if one.half_width is None else f" ± {one.half_width:.2g}")


def _verdict(one: RecursiveEstimate) -> str:
    if one.bounded:
        return "at its bound"
    if one.fitted is None or one.half_width is None:
        return ""
    return "within" if abs(one.recursive - one.fitted) <= one.half_width else "outside"
