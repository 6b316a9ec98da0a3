"""Verification of any design, independent of the solver that found it."""

from dataclasses import asdict, replace
from itertools import product
from math import inf

import numpy as np

from canroll.gain_gen.analysis.family import Family, FamilyMargins, FamilyRow
from canroll.gain_gen.analysis.fitted_family import margins_of_draws
from canroll.gain_gen.analysis.sampled_loop import SampledLoop, build, roll_rms, spectral_radius
from canroll.gain_gen.analysis.speed_schedule import Speeds
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.roll import scaled
from canroll.gain_gen.models.task import Check, Design, Solution, Task, above, below

GAIN_MARGIN_DB = 8.0
"""Least gain margin of every member of the family at every delay."""
PEAK_SENSITIVITY = 1.7
"""Greatest Ms of every member at every delay."""
BOX = 0.2
"""Relative error of every parameter, both ways and combined."""
DELAY_LIMIT = 1.0
"""Largest delay considered, s."""


def verify(
    law: str, task: Task, solution: Solution, family: Family, speeds: Speeds | None = None
) -> Design:
    """Return the design with its margins, checks and warnings.

    Args:
        law: its name.
        task: the task it was designed for.
        solution: the law's answer.
        family: family of the task, on which the loop is verified.
        speeds: families over speed, if the command is scheduled.
    """
    if solution.verified_by_law:
        return Design(law, task, solution, {}, solution.checks, solution.notes)
    controller = solution.controller
    margins = family.margins(controller)
    checks = dict(solution.checks) | family_checks(margins)
    report: dict[str, float] = {}
    if solution.rightmost_root is not None:
        checks["rightmost_root"] = below(solution.rightmost_root, 0.0)
    if solution.max_delay is not None:
        report["max_delay_s"] = solution.max_delay
    report["max_delay_sampled_s"] = largest = (
        family.largest_delay(controller, margins, limit=DELAY_LIMIT) if margins.stable else 0.0
    )
    checks["delay_margin_s"] = above(
        min(largest, solution.max_delay if solution.max_delay is not None else inf)
        - task.delay.most,
        0.0,
    )
    if margins.stable:
        report |= asdict(margins.nominal.margins)
        report |= margins_of_draws(margins)
        level, where = family.jitter(controller)
        checks["jitter_small_gain"] = below(level, 1.0, str(where))
        _check_roll(task, checks, report, controller)
        _check_box(task, checks, report, controller)
        if speeds is not None:
            _check_speeds(speeds, checks, report, controller)
    notes = (*solution.notes, family.note) if family.note else solution.notes
    return Design(law, task, solution, report, checks, _warnings(task, solution, notes, report))


def family_checks(margins: FamilyMargins) -> dict[str, Check]:
    """Return checks of stability, gain margin and peak sensitivity, each at its worst member."""
    gain, peak, edge = margins.worst_gain, margins.worst_sensitivity, margins.least_stable
    return {
        "spectral_radius": below(edge.margins.radius, 1.0, str(edge)),
        "gain_margin_db": above(gain.margins.gain_db, GAIN_MARGIN_DB, str(gain)),
        "peak_sensitivity": below(peak.margins.sensitivity, PEAK_SENSITIVITY, str(peak)),
    }


def holds(row: FamilyRow) -> bool:
    """Whether one loop of the family has the required margins."""
    margins = row.margins
    return margins.gain_db > GAIN_MARGIN_DB and margins.sensitivity < PEAK_SENSITIVITY


def _roll_loop(task: Task, controller: LinearController, delay: float) -> SampledLoop:
    """Return the loop on the roll model of the vehicle's ``design`` part."""
    return build(task.vehicle.design, controller, delay=delay, lag=task.lag, lateral=task.lateral)


def _check_roll(
    task: Task, checks: dict[str, Check], report: dict[str, float], controller: LinearController
) -> None:
    """Check that the roll model rolls less, and report by how much at half to twice the delay."""
    passive = roll_rms(_roll_loop(task, passive_controller(controller), 0.0))
    for name, factor in (("half", 0.5), ("nominal", 1.0), ("double", 2.0)):
        ratio = roll_rms(_roll_loop(task, controller, factor * task.delay.nominal)) / passive
        report[f"roll_rms_ratio_{name}_delay"] = ratio
    nominal = report["roll_rms_ratio_nominal_delay"]
    checks["roll_rms_ratio_nominal_delay"] = below(nominal, 1.0)


def _check_box(
    task: Task, checks: dict[str, Check], report: dict[str, float], controller: LinearController
) -> None:
    """Stability and benefit at every corner of the roll model's parameter box."""
    worst_radius = worst_ratio = 0.0
    for inertia, damping, stiffness, mass in product((1.0 - BOX, 1.0 + BOX), repeat=4):
        model = scaled(
            task.vehicle.design,
            inertia=inertia,
            damping=damping,
            stiffness=stiffness,
            mass=mass,
        )
        if model.effective_stiffness <= 0.0:
            continue
        corner = replace(task, vehicle=replace(task.vehicle, design=model))
        active = _roll_loop(corner, controller, task.delay.nominal)
        worst_radius = max(worst_radius, spectral_radius(active))
        passive = _roll_loop(corner, passive_controller(controller), 0.0)
        worst_ratio = max(worst_ratio, roll_rms(active) / roll_rms(passive))
    checks["box_spectral_radius"] = below(worst_radius, 1.0)
    checks["box_roll_rms_ratio"] = below(worst_ratio, 1.0)
    report["box_roll_rms_ratio"] = worst_ratio


def _check_speeds(
    speeds: Speeds, checks: dict[str, Check], report: dict[str, float], controller: LinearController
) -> None:
    """Check margins at and between the speeds of the schedule."""
    gain_db, sensitivity = speeds.worst(controller)
    checks["schedule_gain_margin_db"] = above(gain_db, GAIN_MARGIN_DB)
    checks["schedule_peak_sensitivity"] = below(sensitivity, PEAK_SENSITIVITY)
    report["least_schedule_factor"] = min(controller.schedule)


def passive_controller(controller: LinearController) -> LinearController:
    """Return a controller whose command is zero."""
    return replace(
        controller,
        output_gain=np.zeros(3),
        compensator=None,
        predict_steps=0,
    )


def _warnings(
    task: Task, solution: Solution, notes: tuple[str, ...], report: dict[str, float]
) -> tuple[str, ...]:
    """Return the warnings for the user, one line each."""
    lines = [*solution.controller.observer.warnings, *notes]
    largest = min(report.get("max_delay_s", inf), report["max_delay_sampled_s"])
    if task.delay.most >= largest:
        lines.append(
            f"the delay of {1e3 * task.delay.most:.0f} ms exceeds the {1e3 * largest:.0f} ms that "
            f"this design allows: expect a limit cycle; choose --law steering_lead"
        )
    return tuple(lines)
