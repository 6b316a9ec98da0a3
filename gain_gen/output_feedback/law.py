"""LQG and H∞ by dynamic output feedback: of the requested effort, as far as margins permit.

The weight of the command determines the effort: the RMS moment caused by the nominal car's driver.
It is found by bisection for the requested share; the share is reduced until every car of the family
has its margins at every delay.
"""

from collections.abc import Callable
from dataclasses import replace
from math import exp, log

import numpy as np
from scipy.linalg import solve_discrete_are

from canroll.errors import VerdictError
from canroll.firmware.calibration import N_ORDER
from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.analysis.steering_response import SteeringResponse, steering_response
from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.hinf_state import design_state_hinf
from canroll.gain_gen.laws.state_feedback import controller_of
from canroll.gain_gen.laws.state_gains import riccati_gain
from canroll.gain_gen.laws.steering_lead import GAIN_MARGIN_DB, MOMENT_SHARE, PEAK_SENSITIVITY
from canroll.gain_gen.models.controller import (
    S_LATERAL,
    S_RATE,
    S_STEERING,
    Y_LATERAL,
    Y_RATE,
    Compensator,
)
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import StateSpace, resolvent_rows
from canroll.gain_gen.models.task import Solution, Task, below
from canroll.gain_gen.output_feedback.driven_car import DrivenCar, driven_car
from canroll.gain_gen.output_feedback.dynamic import compensator, residualised
from canroll.gain_gen.output_feedback.hinf import closed_level, hinf, weighted

LIGHTEST, HEAVIEST = log(0.05), log(20.0)
"""Range of the weight of 1 kN·m over its steady roll."""
ACCURACY = 0.01
"""Of the weight, as share of it."""
HEAVIER = 1.1
HEAVIER_STEPS = 25
"""Factor on the weight while a loop lacks its margins, and how often."""
SHORT = 0.02
"""Shortfall of the effort, as a fraction, up to which no note is given."""

Synthesise = Callable[[DrivenCar, float], StateSpace | None]


@law(share=True)
def design_lqg_delay(task: Task) -> Solution:
    """LQG on the car with its driver and exact delay, reduced to the ECU's compensator.

    Raises:
        CanrollError: the data sheet does not define such a car.
        VerdictError: no stable controller.
    """
    return _designed("lqg_delay", task, lqg)


@law(gains=("computed", "theorem", "as_printed"), share=True)
def design_hinf(task: Task) -> Solution:
    """H∞ output feedback on the car with its driver and exact delay; of a paper: state feedback.

    Raises:
        CanrollError: the data sheet does not define such a car.
        VerdictError: no stable controller.
    """
    if task.gains != "computed":
        return design_state_hinf(task)

    def central(car: DrivenCar, weight: float) -> StateSpace | None:
        answer = hinf(car, weight)
        return None if answer is None else answer.controller

    solution = _designed("hinf", task, central)
    car, weight = driven_car(task, family_of(task)), solution.extra["moment_weight"]
    synthesis = hinf(car, weight)
    assert synthesis is not None
    reduced = residualised(synthesis.controller, N_ORDER)
    return replace(
        solution,
        gamma=closed_level(weighted(car, weight), reduced, car.tick),
        gamma_bound=synthesis.bound,
        gamma_channel="[steering, unknown angle, roll moment, noise] in their sizes to [roll, roll "
        "rate, moment] in weighted degrees, linear car",
        checks={"hinf_level": below(synthesis.level, synthesis.bound)},
    )


def _designed(law: str, task: Task, synthesise: Synthesise) -> Solution:
    """Return the strongest controller with margins, up to the requested share."""
    family = family_of(task)
    car = driven_car(task, family)
    response = steering_response(family, task.vehicle, family.delays[len(family.delays) // 2])
    wanted = MOMENT_SHARE if task.moment_share is None else task.moment_share
    arm, unit = task.vehicle.design.roll_arm, _unit_weight(car)

    def at(relative: float) -> Compensator | None:
        controller = synthesise(car, relative * unit)
        return compensator(controller) if controller is not None and controller.stable else None

    relative, own = _of_effort(wanted * arm, response, at, task.tick)
    for _ in range(HEAVIER_STEPS):
        if own is not None:
            controller = controller_of(task, compensator=own)
            if family.margins(controller).within(GAIN_MARGIN_DB, PEAK_SENSITIVITY):
                break
        relative *= HEAVIER
        own = at(relative)
    if own is None:
        raise VerdictError(f"{law} for {task.vehicle.name}: the solver finds no stable controller")
    share = effort(response, own, task.tick) / arm
    notes: tuple[str, ...] = ()
    if share < (1.0 - SHORT) * wanted:
        notes = (
            f"{law}: --moment-share {wanted:.3g} reduced to {share:.3g} for gain margin and peak "
            "sensitivity over the family, and a stable controller",
        )
    return Solution(
        controller,
        delay_aware=True,
        notes=notes,
        extra={"moment_share": share, "moment_weight": relative * unit},
    )


def effort(response: SteeringResponse, own: Compensator, tick: float) -> float:
    """Return the RMS moment per RMS lateral acceleration caused by the driver, N·m per m/s²."""
    z = np.exp(1j * response.frequencies * tick)
    gains = (resolvent_rows(own.a, own.c, z) @ own.b + own.d)[:, 0]
    readings = np.zeros((len(z), 4), dtype=complex)
    readings[:, Y_RATE], readings[:, Y_LATERAL] = gains[:, S_RATE], gains[:, S_LATERAL]
    return response.rms(response.moment(readings, gains[:, S_STEERING]))


def _of_effort(
    wanted: float,
    response: SteeringResponse,
    at: Callable[[float], Compensator | None],
    tick: float,
) -> tuple[float, Compensator | None]:
    """Return the least weight with a stable controller of at most the wanted effort."""
    low, high = LIGHTEST, HEAVIEST
    best = at(exp(high))
    while high - low > ACCURACY:
        middle = 0.5 * (low + high)
        own = at(exp(middle))
        if own is not None and effort(response, own, tick) <= wanted:
            high, best = middle, own
        else:
            low = middle
    return exp(high), best


def _unit_weight(car: DrivenCar) -> float:
    """Return the steady roll from 1 kN·m without control, deg."""
    steady = np.linalg.solve(np.eye(len(car.a)) - car.a, car.command)
    return abs(float((car.rolled @ steady)[0, 0]))


def lqg(car: DrivenCar, weight: float) -> StateSpace:
    """Return the controller that minimises roll, roll rate and the command with ``weight``.

    Args:
        car: commands under way are states of it, so that the gain sees the whole delay.
        weight: degrees that a kN·m counts for.
    """
    gain = riccati_gain(car.a, car.command, car.rolled.T @ car.rolled, np.array([[weight**2]]))
    corrected = kalman_gain(car)
    left = np.eye(len(car.a)) - corrected @ car.measured
    following = car.a - car.command @ gain
    a, b = following @ left, following @ corrected
    return StateSpace(a, b, -gain @ left, -gain @ corrected, car.tick)


def kalman_gain(car: DrivenCar) -> Matrix:
    """Return M of x̂ = x̄ + M (y − C₂ x̄), the current estimator's, (n, 3)."""
    variance = np.diag(car.noise**2)
    # no noise acts on the commands under way: a small one keeps the Riccati equation well posed
    process = car.driven @ car.driven.T + 1e-12 * np.eye(len(car.a))
    covariance = solve_discrete_are(car.a.T, car.measured.T, process, variance)
    innovation = car.measured @ covariance @ car.measured.T + variance
    return np.asarray(np.linalg.solve(innovation, car.measured @ covariance).T)
