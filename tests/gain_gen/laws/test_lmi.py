"""The inequalities: numbers of the papers' corrected theorems, certificates, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from canroll.errors import VerdictError
from canroll.gain_gen.analysis.certificates import (
    certified_level,
    event_block,
    event_small_gain,
    largest_eigenvalue,
    si_plant,
)
from canroll.gain_gen.design import design
from canroll.gain_gen.laws.hinf_delay import design_hinf_delay
from canroll.gain_gen.laws.hinf_event import design_hinf_event
from canroll.gain_gen.laws.hinf_state import design_state_hinf, discrete_level
from canroll.gain_gen.laws.lmi import Clock, event_point, fixed_lyapunov_certificate
from canroll.gain_gen.laws.roll_rate_feedback import (
    design_hinf_nodelay,
    exact_gamma,
    exact_optimum,
    normalised_plant,
)
from canroll.gain_gen.laws.state_gains import discrete_plant, yim_weights
from canroll.gain_gen.models.roll import ROLL_RATE, normalise
from canroll.gain_gen.models.state_space import StateSpace
from canroll.gain_gen.models.task import Delay, Task
from canroll.vehicles import load

PRINTED_P = np.array([[14.306391, 0.607416], [0.607416, 0.464377]])


def task(vehicle="van_2021", delay=0.1, **options):
    return Task(load(vehicle), Delay.constant(delay), **options)


@pytest.fixture(scope="module")
def van():
    return load("van_2021").design


@pytest.mark.parametrize(
    ("delay", "gain", "gamma_squared"),
    [(0.04, -7500.0, 0.390), (0.1, -2624.0, 1.356), (0.2, -900.0, 2.614)],
)
def test_exact_best_rate_gain(van, delay, gain, gamma_squared):
    found = exact_optimum(van, delay, guess=1.3 * gain)
    assert found.gamma**2 == pytest.approx(gamma_squared, rel=2e-3)
    # the optimum is flat: the gain is known to the square root of the level's digits
    assert found.gain == pytest.approx(gain, rel=3e-2)


@pytest.mark.parametrize(
    ("delay", "gain", "bound", "exact", "structured"),
    [(0.04, -8285.0, 0.7017, 0.6305, 0.7436), (0.1, -2999.0, 1.3302, 1.1745, 1.4109)],
)
def test_inequality_of_a_varying_delay(delay, gain, bound, exact, structured):
    """By a program written apart; the theorem of the 2021 paper certifies ``structured``."""
    solution = design_hinf_delay(task(delay=delay, gains="theorem"))
    assert solution.controller.output_gain[0] == pytest.approx(gain, rel=5e-3)
    assert solution.gamma_bound == pytest.approx(bound, rel=1e-3)
    assert solution.gamma == pytest.approx(exact, rel=1e-3)
    assert solution.gamma < solution.gamma_bound < 0.95 * structured
    assert all(check.ok for check in solution.checks.values())
    assert solution.rightmost_root < 0.0


def test_exact_optimum_beside_the_inequality_at_100_ms():
    extra = design_hinf_delay(task(gains="theorem")).extra
    assert extra["exact_best_gain"] == pytest.approx(-2624.0, rel=0.03)


def test_a_perturbed_certificate_is_refused(van):
    """The eigenvalue check must be able to fail: a stiffer gain breaks the same certificate."""
    plant = normalise(van)
    gain, delay = -6400.0 / plant.rate_gain(1.0), plant.delay(0.04)
    point = event_point(normalised_plant(plant), gain, delay, 0.1, Clock())
    scale = np.diag([1.0, 1.0 / plant.frequency])
    weights = {
        "p": scale @ point.p @ scale / plant.frequency,
        "r": point.r / plant.frequency / plant.stiffness**2,
        "s": 0.0,
    }
    physical = si_plant(van, ROLL_RATE)
    level = certified_level(physical, gain=-6400.0, delay=0.04, epsilon_squared=0.1, **weights)
    assert level == pytest.approx(0.755, rel=5e-3)
    assert level == pytest.approx(point.gamma_squared, rel=1e-3)
    assert (
        certified_level(physical, gain=-13000.0, delay=0.04, epsilon_squared=0.1, **weights)
        == np.inf
    )


@pytest.mark.parametrize(("delay", "gain", "level"), [(0.04, -6400, 0.755), (0.1, -2200, 2.158)])
def test_event_triggered_optimum(delay, gain, level):
    found = design_hinf_event(task(delay=delay, gains="theorem"))
    assert found.gamma_bound**2 == pytest.approx(level, rel=5e-3)
    assert found.controller.output_gain[0] == pytest.approx(gain, rel=0.03)
    assert all(check.ok for check in found.checks.values())


def test_printed_event_certificate(van):
    """The printed P certifies K = −13552.53 at 20 ms and not at 40 ms; small gain does both."""
    clock = Clock()
    levels = {}
    for name, output in (("rate", ROLL_RATE), ("angle", np.array([[1.0, 0.0]]))):
        physical = si_plant(van, output)
        for delay in (0.02, 0.04):

            def block(delay=delay, physical=physical, **weights):
                return event_block(
                    physical, gain=-13552.53, delay=delay, epsilon_squared=0.1, **weights
                )

            point = fixed_lyapunov_certificate(block, PRINTED_P, -13552.53, clock)
            levels[name, delay] = point.gamma_squared if point else np.inf
            if point:
                scale = np.diag([1.0, 1.0, 13552.53, 13552.53, 1.0, 1.0, 1.0])
                matrix = block(
                    p=point.p,
                    r=point.r,
                    s=point.s,
                    omega=point.omega,
                    gamma_squared=point.gamma_squared * 1.001,
                )
                assert largest_eigenvalue(scale @ matrix @ scale) < 0.0
                # the printed R is the order of magnitude of what is needed
                assert point.r == pytest.approx(3.4e-9, rel=0.1)
    assert levels["rate", 0.02] == pytest.approx(15.8, rel=0.01)
    assert levels["rate", 0.02] < 16.96
    assert levels["rate", 0.04] == np.inf
    assert levels["angle", 0.02] == np.inf
    peak = event_small_gain(si_plant(van, ROLL_RATE), gain=-13552.53, delay=0.04)
    assert peak == pytest.approx(2.905, rel=1e-3)
    assert peak < 1.0 / np.sqrt(0.1)


def test_discrete_hinf_agrees_with_a_riccati_bisection():
    """Yim 2020: χ* = 0.2005 and [137650 35300], the level against the game Riccati equation."""
    found = design_state_hinf(task("suv_2020", 0.0))
    suv = load("suv_2020").design
    np.testing.assert_allclose(found.controller.feedback[:2], [137650, 35300], rtol=1e-3)
    assert found.gamma == pytest.approx(0.2005, rel=1e-3)
    weights = yim_weights(suv)
    phi, gamma, lateral = discrete_plant(suv, 0.01)

    def feasible(level):
        """Game Riccati equation with u minimising and w maximising at this level."""
        scale = np.array([weights.roll, weights.roll_rate])
        a = phi * scale / scale[:, None]
        b = np.hstack([gamma * weights.moment, lateral]) / scale[:, None]
        try:
            x = solve_discrete_are(a, b, np.eye(2), np.diag([1.0, -(level**2)]))
        except np.linalg.LinAlgError:
            return False
        inner = level**2 - float((b[:, 1:].T @ x @ b[:, 1:])[0, 0])
        both = np.linalg.solve(np.diag([1.0, -(level**2)]) + b.T @ x @ b, b.T @ x @ a)
        stabilising = np.abs(np.linalg.eigvals(a - b @ both)).max() < 1.0
        return bool(stabilising and np.linalg.eigvalsh(x).min() >= 0.0 and inner > 0.0)

    lower, upper = 0.05, 1.0
    while upper - lower > 1e-6:
        middle = 0.5 * (lower + upper)
        lower, upper = (lower, middle) if feasible(middle) else (middle, upper)
    assert found.gamma == pytest.approx(upper, rel=1e-3)


def test_discrete_level_of_a_pure_delay_line():
    """z⁻¹ has level one everywhere; an unstable matrix has none."""
    one, none = np.eye(1), np.zeros((1, 1))
    assert discrete_level(StateSpace(none, one, one, none, 0.01)) == pytest.approx(1.0)
    assert discrete_level(StateSpace(1.1 * one, one, one, none, 0.01)) == np.inf


def test_delay_unaware_baseline_is_bounded_and_says_why(van):
    found = design_hinf_nodelay(task())
    # of a program with (52) and the bound: −9512; the bound itself is at −9514
    assert found.controller.output_gain[0] == pytest.approx(-9512.0, rel=2e-3)
    assert all(check.ok for check in found.checks.values())
    assert "without a bound" in found.notes[0]
    # the DC gain from [a_y, bank] does not depend on the rate gain: γ² ≥ 0.2168
    assert found.gamma**2 > 0.2168


def test_a_body_damped_beyond_the_bound_of_the_poles_is_refused():
    its = task()
    stiff = replace(its.vehicle.design, roll_damping=30.0 * its.vehicle.design.roll_damping)
    with pytest.raises(VerdictError, match="a pole is beyond 5 roll frequencies already"):
        design_hinf_nodelay(replace(its, vehicle=replace(its.vehicle, design=stiff)))


def test_printed_level_is_out_of_reach_of_every_rate_gain(van):
    assert min(exact_gamma(van, gain, 0.0) for gain in (-1e3, -1e4, -1e5, -1e7)) ** 2 > 0.2167


@pytest.mark.slow
def test_infeasible_target_says_what_is_feasible():
    with pytest.raises(VerdictError, match=r"infeasible at a delay of 2000 ms.*feasible up to"):
        design("hinf_delay", task(delay=2.0, gains="theorem"))
    with pytest.raises(VerdictError, match=r"γ ≤ 0\.5 is infeasible"):
        design("hinf_delay", task(delay=0.1, gamma_target=0.5, gains="theorem"))


def test_printed_gains_that_fail_are_refused_or_marked(van):
    with pytest.raises(VerdictError, match="use it as it is with --unverified"):
        design("hinf_nodelay", replace(task(), gains="as_printed"))
    answer = design("hinf_nodelay", replace(task(), gains="as_printed", unverified=True))
    assert not answer.is_verified
    assert "spectral_radius" in answer.failures
    assert any("limit cycle" in text for text in answer.warnings)
    delayed_law = design("hinf_delay", replace(task(), gains="as_printed", unverified=True))
    assert delayed_law.controller.output_gain[0] == pytest.approx(-4816.3, rel=1e-4)
    assert "gamma_exact" in delayed_law.failures
    printed = design("lqr", replace(task("suv_2020", 0.02), gains="as_printed", unverified=True))
    np.testing.assert_allclose(printed.controller.feedback[:2], [38315.0, 4232.0])
    assert any("do not follow" in text for text in printed.warnings)
