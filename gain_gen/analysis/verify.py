"""Verification of any design, independent of the solver that found it."""

from dataclasses import asdict, replace
from itertools import product
from math import inf

import numpy as np

from gain_gen.analysis.margins import jitter_gain, largest_sampled_delay, margins
from gain_gen.analysis.sampled_loop import Loop, build, roll_rms, spectral_radius
from gain_gen.models.controller import Controller
from gain_gen.models.roll import scaled
from gain_gen.models.task import Check, Delay, Design, Solution, Task, above, below

GAIN_MARGIN_DB = 3.0
PHASE_MARGIN_DEG = 20.0
BOX = 0.2
"""Share by which every parameter may be off, each way, all at once."""
DELAY_LIMIT = 1.0
"""Delays beyond this are not looked at, s."""
UNAWARE_DELAY = 0.02
"""Delay at which a delay-unaware law is verified, s."""


def verify(law: str, task: Task, solution: Solution) -> Design:
    """Return the design with its margins, checks and warnings.

    A law that does not know of the delay is verified at :data:`UNAWARE_DELAY`, or at the delay
    of the task where that is less; a task's delay beyond what it admits is a warning.
    """
    if solution.verified_by_law:
        return Design(law, task, solution, {}, solution.checks, solution.notes)
    model = task.vehicle.design
    controller = solution.controller
    delay = task.delay if solution.delay_aware else _assumed(task.delay)

    def loop(seconds: float) -> Loop:
        return build(model, controller, delay=seconds, lag=task.lag, lateral=task.lateral)

    nominal = loop(delay.nominal)
    radius = spectral_radius(nominal)
    checks: dict[str, Check] = dict(solution.checks)
    if solution.rightmost_root is not None:
        checks["rightmost_root"] = below(solution.rightmost_root, 0.0)
    checks["sampled_spectral_radius"] = below(radius, 1.0)
    largest = largest_sampled_delay(loop, task.tick, limit=DELAY_LIMIT)
    report: dict[str, float] = {"max_delay_sampled_s": largest}
    if solution.max_delay is not None:
        report["max_delay_s"] = solution.max_delay
    checks["delay_margin_s"] = above(
        min(largest, solution.max_delay if solution.max_delay is not None else inf) - delay.most,
        0.0,
    )
    if radius < 1.0:
        report |= asdict(margins(nominal))
        checks["gain_margin_db"] = above(report["gain_db"], GAIN_MARGIN_DB)
        checks["phase_margin_deg"] = above(report["phase_deg"], PHASE_MARGIN_DEG)
        _check_delays(task, delay, checks, report, controller)
        _check_box(task, delay, checks, report, controller)
    return Design(law, task, solution, report, checks, _warnings(task, solution, report))


def _assumed(delay: Delay) -> Delay:
    """Return the task against which a delay-unaware law is verified."""
    return Delay.constant(min(delay.most, UNAWARE_DELAY))


def _check_delays(
    task: Task,
    delay: Delay,
    checks: dict[str, Check],
    report: dict[str, float],
    controller: Controller,
) -> None:
    """Every constant delay between the bounds, jitter between them, and half to twice of it."""

    def loop(seconds: float) -> Loop:
        return build(
            task.vehicle.design, controller, delay=seconds, lag=task.lag, lateral=task.lateral
        )

    grid = np.linspace(delay.least, delay.most, 9 if delay.most > delay.least else 1)
    checks["sampled_spectral_radius_delays"] = below(
        max(spectral_radius(loop(float(seconds))) for seconds in grid), 1.0
    )
    span = delay.most - delay.least
    checks["jitter_small_gain"] = below(
        jitter_gain(loop(0.5 * (delay.least + delay.most)), span), 1.0
    )
    passive = roll_rms(
        build(
            task.vehicle.design,
            passive_controller(controller),
            delay=0.0,
            lag=task.lag,
            lateral=task.lateral,
        )
    )
    for name, factor in (("half", 0.5), ("nominal", 1.0), ("double", 2.0)):
        ratio = roll_rms(loop(factor * delay.nominal)) / passive
        report[f"roll_rms_ratio_{name}_delay"] = ratio
        checks[f"roll_rms_ratio_{name}_delay"] = below(ratio, 1.0)


def _check_box(
    task: Task,
    delay: Delay,
    checks: dict[str, Check],
    report: dict[str, float],
    controller: Controller,
) -> None:
    """Stability and benefit at every corner of the parameter box."""
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
        active = build(model, controller, delay=delay.nominal, lag=task.lag, lateral=task.lateral)
        worst_radius = max(worst_radius, spectral_radius(active))
        passive = build(
            model, passive_controller(controller), delay=0.0, lag=task.lag, lateral=task.lateral
        )
        worst_ratio = max(worst_ratio, roll_rms(active) / roll_rms(passive))
    checks["box_spectral_radius"] = below(worst_radius, 1.0)
    checks["box_roll_rms_ratio"] = below(worst_ratio, 1.0)
    report["box_roll_rms_ratio"] = worst_ratio


def passive_controller(controller: Controller) -> Controller:
    """Return a controller that commands nothing."""
    return replace(
        controller,
        output_gain=np.zeros(3),
        compensator=None,
        predict_steps=0,
    )


def _warnings(task: Task, solution: Solution, report: dict[str, float]) -> tuple[str, ...]:
    """Return the warnings for the user, one line each."""
    lines = [*solution.controller.observer.warnings, *solution.notes]
    largest = min(report.get("max_delay_s", inf), report["max_delay_sampled_s"])
    if task.delay.most >= largest:
        lines.append(
            f"the delay of {1e3 * task.delay.most:.0f} ms exceeds the {1e3 * largest:.0f} ms that "
            f"this design allows: expect a limit cycle; choose --law steering_lead"
        )
    return tuple(lines)
