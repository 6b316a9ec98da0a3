"""Static output feedback of the roll rate: the H∞ laws of the 2021 and 2022 papers."""

from dataclasses import dataclass
from math import exp, log, pi, sqrt

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from canroll.errors import VerdictError
from gain_gen.certificates import (
    LinearPlant,
    bounded_real_block,
    delay_blocks,
    event_block,
    event_small_gain,
    largest_eigenvalue,
    si_plant,
)
from gain_gen.controller import Controller
from gain_gen.delay_analysis import h_infinity, largest_delay, rightmost_root
from gain_gen.design import Check, Solution, Task, below
from gain_gen.plant import (
    PERFORMANCE,
    ROLL_RATE,
    NormalisedPlant,
    disturbance_input,
    moment_input,
    normalise,
    state_matrix,
)
from gain_gen.state_laws import (
    FEEDFORWARD_SHARE,
    actuator_rate,
    feedforward_row,
    observer_of,
)
from vehicles import RollModel

PRINTED_DELAY_GAIN = -84.06 * 180.0 / pi
"""Redondo 2021, (60), read as N·m per deg/s: −4816 N·m·s/rad, the only plausible unit."""
PRINTED_NO_DELAY_GAIN = -1.29e6
"""Redondo 2021, (66)."""
PRINTED_EVENT_GAIN = -13552.53
"""Viadero 2022, section III."""
EPSILON_SQUARED = 0.1
"""Relative trigger threshold, squared (Viadero 2022)."""
FASTEST_POLE = 5.0
"""Bound on the closed loop's poles for ``hinf_nodelay``, in natural roll frequencies."""
SOFTENING = 5e-3
"""Delay added to that of the theorem for each softening, s: hold and actuator delay as well."""
LEVEL_MARGIN = 1e-5
"""Share by which a certified level is raised, so that the certificate holds strictly."""
USELESS = 0.99
"""A level of this share of the open loop's is no improvement worth a law."""


@dataclass(frozen=True, slots=True)
class ExactOptimum:
    """The best gain of all by exact analysis: what a bound is measured against."""

    gain: float
    gamma: float


def exact_gamma(model: RollModel, gain: float, delay: float) -> float:
    """Return the H∞ level from [a_y, bank, d] to φ + φ' under u = K φ'(t − τ), exactly."""
    delayed = gain * moment_input(model) @ ROLL_RATE
    return h_infinity(
        state_matrix(model), delayed, disturbance_input(model), PERFORMANCE, delay=delay
    ).gamma


def exact_optimum(model: RollModel, delay: float, *, guess: float) -> ExactOptimum:
    """Return the roll-rate gain with the least exact level at ``delay``.

    Args:
        model: design model.
        delay: s.
        guess: a stabilising gain, N·m·s/rad, negative; the search is within [guess / 4, 4 guess].
    """
    found = minimize_scalar(
        lambda log_gain: min(exact_gamma(model, -exp(log_gain), delay), 1e6),
        bounds=(log(-guess) - log(4.0), log(-guess) + log(4.0)),
        method="bounded",
        options={"xatol": 2e-3},
    )
    return ExactOptimum(-exp(float(found.x)), float(found.fun))


def static_controller(task: Task, gain: float) -> Controller:
    """Return u = K (roll rate) as measured."""
    return Controller(
        tick=task.tick,
        observer=observer_of(task),
        feedback=np.zeros(5),
        feedforward=np.zeros(5),
        output_gain=np.array([gain, 0.0, 0.0]),
        actuator_rate=actuator_rate(task),
    )


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


def design_hinf_delay(task: Task) -> Solution:
    """Delay-aware H∞ roll-rate feedback: the corrected theorem of Redondo 2021.

    The structure W = K C1 X is exact, ρ and ε are scanned. Beside it stands the exact optimum of
    the gain, which needs no inequality at all.
    """
    model, delay = task.vehicle.design, task.delay.most
    if task.gains == "as_printed":
        return static_solution(
            task,
            PRINTED_DELAY_GAIN,
            delay=delay,
            gamma_bound=sqrt(0.09932),
            checks={},
            delay_aware=True,
            notes=(
                "hinf_delay: printed −84.06, read per deg/s; the printed γ² = 0.09932 is below "
                "what any roll-rate gain can reach, as the DC gain does not depend on it",
            ),
        )
    from gain_gen.lmi import Clock, DelayProgram  # noqa: PLC0415 - cvxpy only where it is used

    plant, clock = normalise(model), Clock()
    program = DelayProgram(plant)
    open_loop = open_loop_gamma(model)

    def level(point: np.ndarray, seconds: float) -> float:
        found = program.solve(
            exp(float(point[0])), exp(float(point[1])), plant.delay(seconds), clock
        )
        return found.gamma_squared if found is not None else 10.0 * open_loop**2

    def scan(seconds: float) -> tuple[np.ndarray, float]:
        """Least certified γ² over ρ and ε."""
        start = min(
            (
                np.array([log(rho), log(epsilon)])
                for rho in (0.4, 0.9)
                for epsilon in (0.4, 0.8, 1.3)
            ),
            key=lambda point: level(point, seconds),
        )
        found = minimize(
            level,
            start,
            args=(seconds,),
            method="Nelder-Mead",
            options={"xatol": 5e-3, "fatol": 1e-4, "maxfev": 60},
        )
        return found.x, float(found.fun)

    target = task.gamma_target if task.gamma_target else USELESS * open_loop
    seconds = max(delay, 1e-3) + task.softness * SOFTENING
    best, bound_squared = scan(seconds)
    if sqrt(bound_squared) > target:
        raise VerdictError(_infeasible(task, target, sqrt(bound_squared), open_loop, scan))
    rho, epsilon = exp(float(best[0])), exp(float(best[1]))
    found = program.solve(rho, epsilon, plant.delay(seconds), clock)
    assert found is not None
    level_squared = found.gamma_squared * (1.0 + LEVEL_MARGIN)
    first, second = delay_blocks(
        _normalised(plant),
        gain=found.gain,
        x=found.x,
        y=found.y,
        q=found.q,
        gamma_squared=level_squared,
        delay=plant.delay(seconds),
        epsilon=epsilon,
    )
    gain = plant.rate_gain(found.gain)
    optimum = exact_optimum(model, seconds, guess=gain)
    return static_solution(
        task,
        gain,
        delay=seconds,
        gamma_bound=sqrt(level_squared),
        checks={
            "lmi_theorem": below(largest_eigenvalue(first), 0.0),
            "lmi_structure": below(largest_eigenvalue(second), 0.0),
            "lmi_x": below(-float(np.linalg.eigvalsh(found.x)[0]), 0.0),
        },
        delay_aware=True,
        solve_seconds=clock.seconds,
        extra={
            "rho": rho,
            "epsilon": epsilon,
            "exact_best_gain": optimum.gain,
            "exact_best_gamma": optimum.gamma,
            "open_loop_gamma": open_loop,
            "theorem_delay_s": seconds,
            "solves": float(clock.solves),
        },
    )


def _infeasible(task: Task, target: float, reached: float, open_loop: float, scan: object) -> str:
    """Say which delay is the cause and which would do."""
    assert callable(scan)
    lower, upper = 0.0, max(task.delay.most, 1e-3)
    for _ in range(7):
        middle = 0.5 * (lower + upper)
        if sqrt(scan(middle)[1]) <= target:
            lower = middle
        else:
            upper = middle
    if task.gamma_target:
        wish = f"γ ≤ {target:.4g}"
    else:
        wish = f"a γ below {target:.4g} (the open loop's is {open_loop:.4g})"
    near = (
        f"feasible up to a delay of {1e3 * lower:.0f} ms"
        if lower > 0.0
        else "infeasible at every delay"
    )
    return (
        f"hinf_delay for {task.vehicle.name}: {wish} is infeasible at a delay of "
        f"{1e3 * task.delay.most:.0f} ms, where the least certified is {reached:.4g}; it is {near}"
    )


def _normalised(plant: NormalisedPlant) -> LinearPlant:
    return LinearPlant(plant.a, plant.b, plant.b_disturbance, plant.performance, ROLL_RATE)


def design_hinf_nodelay(task: Task) -> Solution:
    """The delay-unaware baseline of Redondo 2021, (52), made finite by a bound on its poles."""
    model = task.vehicle.design
    plant = normalise(model)
    fastest = FASTEST_POLE * 0.8**task.softness
    why = (
        "hinf_nodelay: without a bound γ falls for ever as the gain grows (printed: -1.29e6, a "
        f"limit cycle at any real delay); the closed loop's poles are held below {fastest:.3g} "
        f"times the roll frequency, {fastest * plant.frequency:.1f} rad/s"
    )
    if task.gains == "as_printed":
        return static_solution(
            task,
            PRINTED_NO_DELAY_GAIN,
            delay=0.0,
            gamma_bound=sqrt(0.09932),
            checks={},
            delay_aware=False,
            notes=(why,),
        )
    from gain_gen.lmi import BoundedProgram, Clock  # noqa: PLC0415 - cvxpy only where it is used

    clock = Clock()
    program = BoundedProgram(plant, fastest)

    def level(log_rho: float) -> float:
        found = program.solve(exp(log_rho), clock)
        return found.gamma_squared if found is not None else 1e6

    scanned = minimize_scalar(
        level, bounds=(log(0.05), log(fastest)), method="bounded", options={"xatol": 5e-3}
    )
    found = program.solve(exp(float(scanned.x)), clock)
    assert found is not None
    level_squared = found.gamma_squared * (1.0 + LEVEL_MARGIN)
    block = bounded_real_block(
        _normalised(plant), gain=found.gain, x=found.x, gamma_squared=level_squared
    )
    gain = plant.rate_gain(found.gain)
    poles = np.linalg.eigvals(state_matrix(model) + gain * moment_input(model) @ ROLL_RATE)
    return static_solution(
        task,
        gain,
        delay=0.0,
        gamma_bound=sqrt(level_squared),
        checks={
            "lmi_bounded_real": below(largest_eigenvalue(block), 0.0),
            "lmi_x": below(-float(np.linalg.eigvalsh(found.x)[0]), 0.0),
            "fastest_pole": below(float(np.abs(poles).max()), fastest * plant.frequency * 1.001),
        },
        delay_aware=False,
        solve_seconds=clock.seconds,
        notes=(why,),
        extra={"rho": exp(float(scanned.x)), "solves": float(clock.solves)},
    )


def design_hinf_event(task: Task) -> Solution:
    """Event-triggered H∞ roll-rate feedback of Viadero 2022: gain scanned, level certified.

    The relative threshold is the paper's; the floor comes from the sensor noise when the
    calibration is written. S = 0: the certificate holds for a delay that varies.
    """
    model = task.vehicle.design
    delay = max(task.delay.most, 1e-3) + task.softness * SOFTENING
    physical = si_plant(model, ROLL_RATE)
    if task.gains == "as_printed":
        return static_solution(
            task,
            PRINTED_EVENT_GAIN,
            delay=delay,
            gamma_bound=sqrt(16.96),
            checks={
                "event_small_gain": below(
                    sqrt(EPSILON_SQUARED)
                    * event_small_gain(physical, gain=PRINTED_EVENT_GAIN, delay=delay),
                    1.0,
                )
            },
            delay_aware=True,
        )
    from gain_gen.lmi import Clock, EventProgram  # noqa: PLC0415 - cvxpy only where it is used

    plant, clock = normalise(model), Clock()
    program = EventProgram(plant)

    def level(log_gain: float) -> float:
        found = program.solve(-exp(log_gain), plant.delay(delay), EPSILON_SQUARED, clock)
        return found.gamma_squared if found is not None else 1e6

    coarse = np.linspace(log(0.01), log(8.0), 15)
    values = [level(float(point)) for point in coarse]
    near = int(np.argmin(values))
    scanned = minimize_scalar(
        level,
        bounds=(coarse[max(near - 1, 0)], coarse[min(near + 1, len(coarse) - 1)]),
        method="bounded",
        options={"xatol": 2e-3},
    )
    normalised_gain = -exp(float(scanned.x))
    found = program.solve(normalised_gain, plant.delay(delay), EPSILON_SQUARED, clock)
    open_loop = open_loop_gamma(model)
    if found is None or sqrt(found.gamma_squared) > USELESS * open_loop:
        raise VerdictError(
            f"hinf_event for {task.vehicle.name}: no event-triggered roll-rate gain is certified "
            f"better than the open loop at {1e3 * delay:.0f} ms; shorten the delay"
        )
    level_squared = found.gamma_squared * (1.0 + LEVEL_MARGIN)
    block = event_block(
        _normalised(plant),
        gain=normalised_gain,
        p=found.p,
        r=found.r,
        s=found.s,
        omega=found.omega,
        gamma_squared=level_squared,
        delay=plant.delay(delay),
        epsilon_squared=EPSILON_SQUARED,
    )
    gain = plant.rate_gain(normalised_gain)
    return static_solution(
        task,
        gain,
        delay=delay,
        gamma_bound=sqrt(level_squared),
        checks={
            "lmi_event": below(largest_eigenvalue(block), 0.0),
            "lmi_p": below(-float(np.linalg.eigvalsh(found.p)[0]), 0.0),
            "event_small_gain": below(
                sqrt(EPSILON_SQUARED) * event_small_gain(physical, gain=gain, delay=delay), 1.0
            ),
        },
        delay_aware=True,
        solve_seconds=clock.seconds,
        extra={
            "epsilon_squared": EPSILON_SQUARED,
            "theorem_delay_s": delay,
            "solves": float(clock.solves),
        },
    )


def design_rate_feedforward(task: Task) -> Solution:
    """u = K φ' − β m h a_y on the observer's filtered values: simple and strong.

    K is the exact optimum for the delay with half a hold and the actuator's lag added: no
    inequality, no solver.
    """
    model = task.vehicle.design
    delay = task.delay.most + 0.5 * task.tick + task.lag
    guesses = -model.roll_damping * np.geomspace(0.05, 8.0, 12)
    guess = min(guesses, key=lambda gain: exact_gamma(model, float(gain), delay))
    optimum = exact_optimum(model, delay, guess=float(guess))
    controller = Controller(
        tick=task.tick,
        observer=observer_of(task),
        feedback=np.array([0.0, -optimum.gain, 0.0, 0.0, 0.0]),
        feedforward=feedforward_row(task, FEEDFORWARD_SHARE * model.roll_arm),
        actuator_rate=actuator_rate(task),
    )
    return Solution(controller, gamma=optimum.gamma, delay_aware=True)
