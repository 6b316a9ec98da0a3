"""Static output feedback of the roll rate: exact analysis, the delay-free law, the simple law."""

from dataclasses import dataclass
from math import exp, log, sqrt

import numpy as np
from scipy.optimize import minimize_scalar

from canroll.errors import VerdictError
from canroll.gain_gen.analysis.certificates import CertifiedPlant
from canroll.gain_gen.analysis.delay_system import h_infinity, largest_delay, rightmost_root
from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.state_feedback import (
    FEEDFORWARD_SHARE,
    controller_of,
    feedforward_row,
)
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.roll import (
    PERFORMANCE,
    ROLL_RATE,
    NormalisedPlant,
    disturbance_input,
    moment_input,
    normalise,
    state_matrix,
)
from canroll.gain_gen.models.task import Check, Solution, Task, below
from canroll.vehicles import RollModel

PRINTED_NO_DELAY_GAIN = -1.29e6
"""Redondo 2021, (66)."""
FASTEST_POLE = 5.0
"""Bound on the closed loop's poles for ``hinf_nodelay``, in natural roll frequencies."""
LEVEL_MARGIN = 1e-5
"""Share by which a certified level is raised, so that the certificate holds strictly."""
SEARCHED = 4.0
"""Factor on a guessed gain up to which the best is searched."""
USELESS = 0.99
"""Level, relative to the open loop's, above which a gain counts as useless."""
CHANNEL = "[a_y, bank, disturbance] to roll + roll rate, SI units, roll model"
"""Channel of :func:`exact_gamma`."""


@dataclass(frozen=True, slots=True)
class ExactOptimum:
    """The optimal gain by exact analysis: the reference for bounds."""

    gain: float
    gamma: float


def exact_gamma(model: RollModel, gain: float, delay: float) -> float:
    """Return the H∞ level from [a_y, bank, d] to φ + φ' under u = K φ'(t − τ), exactly."""
    delayed = gain * moment_input(model) @ ROLL_RATE
    return h_infinity(
        state_matrix(model), delayed, disturbance_input(model), PERFORMANCE, delay=delay
    )


def exact_optimum(model: RollModel, delay: float, *, guess: float) -> ExactOptimum:
    """Return the roll-rate gain with the least exact level at ``delay``.

    Args:
        model: design model.
        delay: s.
        guess: a stabilising gain, N·m·s/rad, negative; the search covers :data:`SEARCHED` times
            it, and the inverse.
    """
    minimum = minimize_scalar(
        lambda log_gain: min(exact_gamma(model, -exp(log_gain), delay), 1e6),
        bounds=(log(-guess) - log(SEARCHED), log(-guess) + log(SEARCHED)),
        method="bounded",
        options={"xatol": 2e-3},
    )
    return ExactOptimum(-exp(float(minimum.x)), float(minimum.fun))


def static_controller(task: Task, gain: float) -> LinearController:
    """Return u = K (roll rate) as measured."""
    return controller_of(task, output_gain=np.array([gain, 0.0, 0.0]))


def static_solution(
    task: Task,
    gain: float,
    *,
    delay: float,
    gamma_bound: float | None,
    checks: dict[str, Check],
    delay_aware: bool,
    solve_seconds: float = 0.0,
    notes: tuple[str, ...] = (),
    extra: dict[str, float] | None = None,
) -> Solution:
    """Return a roll-rate law with its exact analysis at ``delay``."""
    model = task.vehicle.design
    gamma = exact_gamma(model, gain, delay)
    if gamma_bound is not None:
        checks = checks | {"gamma_exact": below(gamma, gamma_bound * (1.0 + 1e-6))}
    root = rightmost_root(state_matrix(model), gain * moment_input(model) @ ROLL_RATE, delay)
    return Solution(
        static_controller(task, gain),
        gamma=gamma if np.isfinite(gamma) else None,
        gamma_bound=gamma_bound,
        gamma_channel=CHANNEL,
        checks=checks,
        rightmost_root=root.real,
        max_delay=largest_delay(state_matrix(model), moment_input(model), gain * ROLL_RATE),
        delay_aware=delay_aware,
        solve_seconds=solve_seconds,
        notes=notes,
        extra=extra or {},
    )


def open_loop_gamma(model: RollModel) -> float:
    """Return the level without control."""
    return exact_gamma(model, 0.0, 0.0)


def normalised_plant(plant: NormalisedPlant) -> CertifiedPlant:
    """Return the normalised plant in the form of the certificates, roll rate measured."""
    return CertifiedPlant(plant.a, plant.b, plant.b_disturbance, plant.performance, ROLL_RATE)


@law(gains=("computed", "as_printed"), feedforward="none")
def design_hinf_nodelay(task: Task) -> Solution:
    """Roll-rate feedback without regard to the delay (Redondo 2021, (52)), its poles bounded.

    Without a delay (52) is the exact level, so the gain is searched without an inequality: up to
    the one with a pole at the bound −α, 2ζ − K = α + 1/α in the units of the roll model.
    """
    model = task.vehicle.design
    plant = normalise(model)
    fastest = FASTEST_POLE
    why = (
        "hinf_nodelay: without a bound γ decreases without limit as the gain grows "
        "(printed: -1.29e6, a "
        f"limit cycle at any real delay); the closed loop's poles are kept below {fastest:.3g} "
        f"times the roll frequency, {fastest * plant.frequency:.1f} rad/s"
    )
    if task.gains == "as_printed":
        gain, gamma_bound, checks = PRINTED_NO_DELAY_GAIN, sqrt(0.09932), dict[str, Check]()
    else:
        most = plant.rate_gain(2.0 * model.damping_ratio - fastest - 1.0 / fastest)
        if most >= 0.0:
            raise VerdictError(
                f"hinf_nodelay: with a damping ratio of {model.damping_ratio:.3g} a pole is beyond "
                f"{fastest:.3g} roll frequencies already: choose another law"
            )
        gain, gamma_bound = exact_optimum(model, 0.0, guess=most / SEARCHED).gain, None
        poles = np.linalg.eigvals(state_matrix(model) + gain * moment_input(model) @ ROLL_RATE)
        checks = {"fastest_pole": below(float(np.abs(poles).max()), fastest * plant.frequency)}
    return static_solution(
        task,
        gain,
        delay=0.0,
        gamma_bound=gamma_bound,
        checks=checks,
        delay_aware=False,
        notes=(why,),
    )


def design_rate_feedforward(task: Task) -> Solution:
    """u = K φ' − β m h a_y on the observer's filtered values, K optimal for the delay.

    K is the exact optimum for the delay with half a hold and the actuator's lag added: no
    inequality, no solver.
    """
    model = task.vehicle.design
    delay = task.delay.most + 0.5 * task.tick + task.lag
    guesses = -model.roll_damping * np.geomspace(0.05, 8.0, 12)
    guess = min(guesses, key=lambda gain: exact_gamma(model, float(gain), delay))
    optimum = exact_optimum(model, delay, guess=float(guess))
    controller = controller_of(
        task,
        feedback=np.array([0.0, -optimum.gain, 0.0, 0.0, 0.0]),
        feedforward=feedforward_row(task, FEEDFORWARD_SHARE * model.roll_arm),
    )
    return Solution(controller, gamma=optimum.gamma, gamma_channel=CHANNEL, delay_aware=True)
