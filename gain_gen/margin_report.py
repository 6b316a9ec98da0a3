"""Margins of a calibration's integers over the family, delay and gain."""

from dataclasses import asdict, dataclass
from math import inf, isfinite
from pathlib import Path

import numpy as np

from canroll.arguments import checked
from canroll.gain_gen.analysis.family import Family, FamilyMargins, family_of
from canroll.gain_gen.analysis.fitted_family import margins_of_draws, with_draws
from canroll.gain_gen.analysis.margins import Margins, margins
from canroll.gain_gen.analysis.sampled_loop import SampledLoop, loop_gain, response_peak
from canroll.gain_gen.analysis.verify import DELAY_LIMIT, family_checks, passive_controller
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration, load
from canroll.gain_gen.calibration.dequantise import dequantise
from canroll.gain_gen.calibration.resolution import of_calibration
from canroll.gain_gen.models.controller import scaled_controller
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import Complex
from canroll.gain_gen.models.task import Check, Delay, Task
from canroll.table import Table

GAIN_FACTORS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0)


@dataclass(frozen=True, slots=True)
class DelayMargin:
    """One row of the tables, of the family's first member.

    Attributes:
        delay: from sample to force, s.
        gain_factor: factor on the whole command.
        peak: peak response of roll angle to a roll moment on the body, relative to no control;
            infinite if unstable.
        margins: margins of the loop.
    """

    delay: float
    gain_factor: float
    peak: float
    margins: Margins

    @property
    def stable(self) -> bool:
        """Whether the sampled loop is."""
        return self.margins.radius < 1.0


def _plain(value: float) -> float | None:
    return value if isfinite(value) else None


def _numbers(of: Margins) -> dict[str, float | None]:
    values = asdict(of) | {"sensitivity": of.sensitivity}
    return {name: _plain(value) for name, value in values.items()}


@dataclass(frozen=True, slots=True)
class MarginReport:
    """Margins of a calibration.

    Attributes:
        law: name.
        vehicle: name.
        delay: least, nominal and longest delay it was designed for, s.
        max_delay: largest constant delay at which the whole family is stable, s.
        family: margins of every member at the least, middle and longest delay.
        checks: the checks of a design.
        note: reason why the family is the roll model alone, or empty.
        over_delay: at the gain of the file.
        over_gain: at the nominal delay of the file.
        frequencies: frequencies of ``loop``, rad/s.
        loop: Nyquist curve by delay in s.
    """

    law: str
    vehicle: str
    delay: Delay
    max_delay: float
    family: FamilyMargins
    checks: dict[str, Check]
    note: str
    over_delay: tuple[DelayMargin, ...]
    over_gain: tuple[DelayMargin, ...]
    frequencies: Matrix
    loop: dict[float, Complex]

    @property
    def fit(self) -> dict[str, float]:
        """Worst margins of the draws of the vehicle's fit, and of the vehicle; empty without."""
        return margins_of_draws(self.family)

    @property
    def table(self) -> Table:
        """One row for each vehicle, curve and delay; None stands for infinity."""
        return Table(
            [
                {
                    **asdict(row.condition),
                    "name": str(row.condition),
                    "delay_s": row.delay,
                    **_numbers(row.margins),
                }
                for row in self.family.rows
            ]
        )


def task_of(calibration: LoadedCalibration) -> Task:
    """Return the task that the file was designed for."""
    table = calibration.tables["design"]
    nominal = float(table["delay_s"])
    least = float(table.get("delay_min_s", nominal))
    most = float(table.get("delay_max_s", nominal))
    return Task(
        vehicle=calibration.vehicle,
        delay=Delay(nominal, least, most),
        tick=calibration.tick,
        actuator=calibration.actuator,
        observer=str(table.get("observer", "two_sensors")),
        resolution=of_calibration(calibration),
    )


@checked
def margin_report(calibration: LoadedCalibration | str | Path) -> MarginReport:
    """Return the margins of the integers in a calibration, from the sampled loop.

    Args:
        calibration: as loaded, or its file.

    Raises:
        CanrollError: the file is not a calibration.
    """
    if not isinstance(calibration, LoadedCalibration):
        calibration = load(Path(calibration))
    task = task_of(calibration)
    family = with_draws(family_of(task), task)
    controller = dequantise(calibration.record)
    member, delay = family.members[0], task.delay.nominal
    free = response_peak(member.loop(passive_controller(controller), delay), member.roll)

    def loop(seconds: float, factor: float = 1.0) -> SampledLoop:
        return member.loop(scaled_controller(controller, factor), seconds)

    def point(seconds: float, factor: float) -> DelayMargin:
        closed = loop(seconds, factor)
        return DelayMargin(
            seconds, factor, response_peak(closed, member.roll) / free, margins(closed)
        )

    worst_case = family.margins(controller)
    largest = (
        family.largest_delay(controller, worst_case, limit=DELAY_LIMIT)
        if worst_case.stable
        else 0.0
    )
    frequencies = np.geomspace(0.1, 0.98 * np.pi / calibration.tick, 600)
    return MarginReport(
        law=calibration.law,
        vehicle=calibration.vehicle.reference,
        delay=task.delay,
        max_delay=largest,
        family=worst_case,
        checks=family_checks(worst_case),
        note=family.note,
        over_delay=tuple(point(seconds, 1.0) for seconds in _delays(family, largest)),
        over_gain=tuple(point(delay, factor) for factor in GAIN_FACTORS),
        frequencies=frequencies,
        loop={seconds: loop_gain(loop(seconds), frequencies) for seconds in family.delays},
    )


def _delays(family: Family, largest: float) -> list[float]:
    """Return the delays of the table: the task's and several well beyond."""
    longest = family.delays[-1]
    top = max(2.0 * longest, 1.2 * largest if isfinite(largest) else 0.0, 4.0 * family.tick)
    return sorted({*family.delays, *np.linspace(0.0, top, 9).tolist()})


def to_json(report: MarginReport) -> dict[str, object]:
    """Return the report as plain numbers; null stands for infinity."""

    def row(point: DelayMargin) -> dict[str, object]:
        return {
            "delay_s": point.delay,
            "gain_factor": point.gain_factor,
            "stable": point.stable,
            "peak": _plain(point.peak),
            **_numbers(point.margins),
        }

    return {
        "law": report.law,
        "vehicle": report.vehicle,
        "delay_s": report.delay.nominal,
        "delay_min_s": report.delay.least,
        "delay_max_s": report.delay.most,
        "max_delay_s": _plain(report.max_delay),
        "note": report.note,
        **({"fit": {k: _plain(v) for k, v in report.fit.items()}} if report.fit else {}),
        "checks": {
            name: check._asdict() | {"value": _plain(check.value)}
            for name, check in report.checks.items()
        },
        "family": list(report.table),
        "over_delay": [row(point) for point in report.over_delay],
        "over_gain": [row(point) for point in report.over_gain],
    }


def admits(report: MarginReport) -> bool:
    """Whether the whole family has its margins up to the longest delay."""
    largest = report.max_delay if report.max_delay > 0.0 else -inf
    return report.delay.most < largest and all(check.ok for check in report.checks.values())
