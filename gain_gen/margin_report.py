"""The margins of a calibration file: of the integers as they are, over delay and over gain."""

from dataclasses import asdict, dataclass, replace
from math import inf, isfinite

import numpy as np

from gain_gen.analysis.delay_system import Complex
from gain_gen.analysis.margins import Margins, largest_sampled_delay, margins
from gain_gen.analysis.sampled_loop import (
    Loop,
    build,
    lateral_level,
    loop_gain,
    roll_rms,
    spectral_radius,
)
from gain_gen.analysis.verify import DELAY_LIMIT, passive_controller
from gain_gen.calibration.calibration_file import LoadedCalibration
from gain_gen.calibration.dequantise import dequantise
from gain_gen.models.controller import Controller
from gain_gen.models.roll import Matrix
from vehicles import RollModel

GAIN_FACTORS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0)


@dataclass(frozen=True, slots=True)
class Point:
    """One row of the tables.

    Attributes:
        delay: from sample to force, s.
        gain_factor: of the whole command.
        stable: whether the sampled loop is.
        gamma: peak of (φ + φ') over a_y, rad per m/s²; infinite if unstable.
        roll_rms_ratio: against no control; infinite if unstable.
        margins: None if unstable.
    """

    delay: float
    gain_factor: float
    stable: bool
    gamma: float
    roll_rms_ratio: float
    margins: Margins | None


@dataclass(frozen=True, slots=True)
class MarginReport:
    """Margins of a calibration.

    Attributes:
        law: name.
        vehicle: name.
        delay: that it was designed for, s.
        max_delay: largest constant delay that the integers admit, s.
        passive_gamma: peak of (φ + φ') over a_y without control.
        over_delay: at the gain of the file.
        over_gain: at the delay of the file.
        frequencies: of ``loop``, rad/s.
        loop: Nyquist curve by delay in s.
    """

    law: str
    vehicle: str
    delay: float
    max_delay: float
    passive_gamma: float
    over_delay: tuple[Point, ...]
    over_gain: tuple[Point, ...]
    frequencies: Matrix
    loop: dict[float, Complex]


def plant_of(calibration: LoadedCalibration) -> tuple[RollModel, float]:
    """Return the design model and the actuator's time constant that the file was made with."""
    table = dict(calibration.tables["plant"])
    lag = float(table.pop("actuator_lag_s"))
    return RollModel(**{name: float(value) for name, value in table.items()}), lag


def scaled_controller(controller: Controller, factor: float) -> Controller:
    """Return the controller with its whole command multiplied."""
    compensator = controller.compensator
    if compensator is not None:
        compensator = replace(compensator, c=factor * compensator.c, d=factor * compensator.d)
    gain = controller.output_gain
    return replace(
        controller,
        feedback=factor * controller.feedback,
        feedforward=factor * controller.feedforward,
        output_gain=None if gain is None else factor * gain,
        compensator=compensator,
    )


def margin_report(calibration: LoadedCalibration) -> MarginReport:
    """Return the margins of the integers in ``calibration``, by the sampled loop."""
    model, lag = plant_of(calibration)
    controller = dequantise(calibration.record)
    delay = float(calibration.tables["design"]["delay_s"])
    passive = build(model, passive_controller(controller), delay=0.0, lag=lag)
    passive_rms = roll_rms(passive)

    def loop(seconds: float, factor: float = 1.0) -> Loop:
        return build(model, scaled_controller(controller, factor), delay=seconds, lag=lag)

    def point(seconds: float, factor: float) -> Point:
        closed = loop(seconds, factor)
        stable = spectral_radius(closed) < 1.0
        return Point(
            seconds,
            factor,
            stable,
            lateral_level(closed),
            roll_rms(closed) / passive_rms,
            margins(closed) if stable else None,
        )

    largest = largest_sampled_delay(loop, calibration.tick, limit=DELAY_LIMIT)
    top = max(2.0 * delay, 1.2 * largest if isfinite(largest) else 0.0, 4.0 * calibration.tick)
    delays = sorted({0.0, delay, 2.0 * delay, *np.linspace(0.0, top, 9).tolist()})
    frequencies = np.geomspace(0.1, 0.98 * np.pi / calibration.tick, 600)
    return MarginReport(
        law=calibration.law,
        vehicle=calibration.vehicle,
        delay=delay,
        max_delay=largest,
        passive_gamma=lateral_level(passive),
        over_delay=tuple(point(seconds, 1.0) for seconds in delays),
        over_gain=tuple(point(delay, factor) for factor in GAIN_FACTORS),
        frequencies=frequencies,
        loop={
            seconds: loop_gain(loop(seconds), frequencies) for seconds in (0.0, delay, 2.0 * delay)
        },
    )


def to_json(report: MarginReport) -> dict[str, object]:
    """Return the report as plain numbers; null stands for infinity."""

    def plain(value: float) -> float | None:
        return value if isfinite(value) else None

    def row(point: Point) -> dict[str, object]:
        found = asdict(point.margins) if point.margins is not None else {}
        return {
            "delay_s": point.delay,
            "gain_factor": point.gain_factor,
            "stable": point.stable,
            "gamma": plain(point.gamma),
            "roll_rms_ratio": plain(point.roll_rms_ratio),
            **{name: plain(value) for name, value in found.items()},
        }

    return {
        "law": report.law,
        "vehicle": report.vehicle,
        "delay_s": report.delay,
        "max_delay_s": plain(report.max_delay),
        "passive_gamma": report.passive_gamma,
        "over_delay": [row(point) for point in report.over_delay],
        "over_gain": [row(point) for point in report.over_gain],
    }


def admits(report: MarginReport) -> bool:
    """Whether the loop is stable at the delay that it was designed for."""
    return report.delay < (report.max_delay if report.max_delay > 0.0 else -inf)
