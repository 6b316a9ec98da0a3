"""The min–max roll-rate gain, its certificates, and designs that are detuned or refused."""

import control
import numpy as np
import pytest

from canroll import vehicles
from canroll.errors import CanrollError, VerdictError
from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.analysis.level_certificate import (
    LEVEL_UNIT,
    bound_over_delays,
    delay_grid,
    switched_loop,
)
from canroll.gain_gen.analysis.sampled_loop import response_peak
from canroll.gain_gen.analysis.verify import passive_controller
from canroll.gain_gen.design import design
from canroll.gain_gen.laws.lmi import Clock, certify_level
from canroll.gain_gen.laws.rate_gain import best_rate_gain, free_peak
from canroll.gain_gen.laws.roll_rate_feedback import static_controller
from canroll.gain_gen.models.task import Delay, Task

DELAYS = {"500k": (5.6e-3, 23.1e-3), "gateway_20ms": (16.1e-3, 50.2e-3)}
GATEWAY_50MS = (0.106, 0.130)


def task_of(least, most, vehicle="van_real", **options):
    delay = Delay(0.5 * (least + most), least, most)
    return Task(vehicles.load(vehicle), delay, **options)


@pytest.fixture(scope="module", params=DELAYS)
def designed(request):
    return design("hinf_delay", task_of(*DELAYS[request.param]))


@pytest.mark.slow
def test_the_gain_has_its_margins_on_every_car_and_is_certified(designed):
    assert designed.is_verified
    assert designed.warnings == ()
    assert designed.verified["gain_margin_db"].value > 8.0
    assert designed.verified["peak_sensitivity"].value < 1.7
    assert designed.verified["jitter_small_gain"].value < 0.5
    assert designed.solution.extra["peak_ratio"] < 0.88
    assert 0.76 < designed.solution.extra["certified_peak_ratio"] < 0.83


def test_it_is_as_near_as_the_margins_take_to_what_no_damper_passes(designed):
    """The steady roll, which the roll rate says nothing of, is the floor of every gain."""
    found = designed.solution.extra
    # equal but for the grids of both, where the steady roll is the peak
    assert 1.0 - 1e-5 < found["peak_ratio"] / found["least_peak_ratio"] < 1.015
    steady = []
    for member in family_of(designed.task).members:
        free = np.abs(member.disturbed[:, 2])
        loop = member.loop(designed.controller, designed.task.delay.most)
        whole = np.eye(len(loop.a)) - loop.closed
        row = np.concatenate([member.roll, np.zeros(len(loop.a) - len(member.roll))])
        closed = abs(float((row @ np.linalg.solve(whole, loop.noise))[0]))
        assert closed == pytest.approx(free[0], rel=1e-3)
        steady.append(closed / free.max())
    assert found["least_peak_ratio"] == pytest.approx(max(steady), rel=1e-3)


def test_the_peak_ratio_is_that_of_the_loops_matrices(designed):
    family = family_of(designed.task)
    worst = 0.0
    for member in family.members:
        free = member.loop(passive_controller(designed.controller), 0.0)
        for delay in family.delays:
            closed = response_peak(member.loop(designed.controller, delay), member.roll)
            worst = max(worst, closed / response_peak(free, member.roll))
    assert designed.solution.extra["peak_ratio"] == pytest.approx(worst, rel=2e-3)


def test_no_other_gain_with_margins_is_better(designed):
    family = family_of(designed.task)
    best = best_rate_gain(family)
    for factor in (0.3, 0.7, 0.95):
        weaker = static_controller(designed.task, factor * best.gain)
        member = next(m for m in family.members if best.where.startswith(f"{m.condition}, d"))
        free = member.loop(passive_controller(weaker), 0.0)
        peaks = [response_peak(member.loop(weaker, d), member.roll) for d in family.delays]
        assert max(peaks) / response_peak(free, member.roll) >= best.peak_ratio - 1e-3
    beyond = family.margins(static_controller(designed.task, 1.05 * best.largest))
    worst = beyond.worst_sensitivity.margins
    assert worst.sensitivity > 1.7 or beyond.worst_gain.margins.gain_db < 8.0


def test_the_certified_level_is_above_every_constant_delays_and_close():
    task = task_of(*DELAYS["500k"])
    family = family_of(task)
    member, gain = family.members[0], -12500.0
    few = switched_loop(member, gain, delay_grid(member, family.delays, 0.01, 2e-3), 0.01)
    point = certify_level(few, 0.0, Clock())
    assert point is not None
    level = np.sqrt(point.level_squared)
    exact = []
    for delay in family.delays:
        loop = member.loop(static_controller(task, gain), delay)
        exact.append(response_peak(loop, member.roll) / LEVEL_UNIT)
    assert max(exact) < level < 1.02 * max(exact)
    many = switched_loop(member, gain, delay_grid(member, family.delays, 0.01, 2e-5), 0.01)
    values = {"p": point.p, "weight": 0.0, "epsilon": 0.0}
    assert max(bound_over_delays(many, level_squared=1.001 * point.level_squared, **values)) < 0.0
    assert min(bound_over_delays(many, level_squared=0.98 * max(exact) ** 2, **values)) > 0.0


def test_the_curvature_of_the_loop_is_its_second_difference():
    task = task_of(*DELAYS["500k"])
    member = family_of(task).members[0]
    for middle in (6.5e-3, 14.1e-3, 22.3e-3):
        delays = middle + 1e-5 * np.array([-1.0, 0.0, 1.0])
        loop = switched_loop(member, -12500.0, np.append(delays, 23.1e-3), 0.01)
        joint = [np.hstack([a, b]) for a, b in zip(loop.a, loop.b, strict=True)]
        difference = (joint[0] - 2.0 * joint[1] + joint[2]) / 1e-10
        error = np.abs(difference - loop.curvature[1]).max()
        assert error < 1e-3 * np.abs(loop.curvature[1]).max()


@pytest.mark.parametrize("epsilon", [0.0, 0.3])
def test_what_is_between_the_delays_is_bounded_not_only_what_is_at_them(epsilon):
    """A function that weighs the bend of the hold's column is largest between two delays."""
    task = task_of(*DELAYS["500k"])
    member = family_of(task).members[0]
    loops = [
        switched_loop(member, -12500.0, np.linspace(16e-3, 20e-3, points), 0.01)
        for points in (2, 41, 401)
    ]
    m, n = len(loops[0].flow), len(loops[0].a[0])
    ends, bent = [a[:m, m:] for a in loops[0].a], loops[2].a[200][:m, m]
    basis, _ = np.linalg.qr(np.stack([ends[0][:, 0], ends[1][:, 0], ends[0][:, 1]], axis=1))
    weight = np.zeros(n)
    weight[:m] = bent - basis @ (basis.T @ bent)
    p = np.outer(weight, weight) / (weight @ weight) + 1e-3 * np.eye(n)
    values = {"p": p, "level_squared": 1e-3, "weight": 1e-3, "epsilon": epsilon}
    found = [bound_over_delays(loop, **values) for loop in loops]
    between = found[2][0]
    assert found[0][0] < between
    assert all(between <= bound for _, bound in found)
    assert found[0][1] > found[1][1] > found[2][1]
    assert found[2][1] == pytest.approx(between, rel=1e-4)


@pytest.mark.parametrize("epsilon", [0.0, 0.3])
def test_a_few_delays_certify_nothing_between_them(epsilon):
    """The inequality holds at both ends and the kinks, its bound between them does not."""
    task = task_of(*DELAYS["500k"])
    family = family_of(task)
    member = family.members[0]
    few, many = (
        switched_loop(member, -12500.0, delay_grid(member, family.delays, 0.01, step), 0.01)
        for step in (1.0, 2e-5)
    )
    point = certify_level(few, epsilon, Clock())
    assert point is not None
    values = {"p": point.p, "weight": point.weight, "epsilon": epsilon}
    at, bound = bound_over_delays(few, level_squared=1.001 * point.level_squared, **values)
    assert at < 0.0 < bound
    assert bound_over_delays(many, level_squared=1.001 * point.level_squared, **values)[1] < 0.0


def test_the_certificates_loop_is_the_sampled_loop():
    task = task_of(*DELAYS["gateway_20ms"])
    family = family_of(task)
    member, gain = family.members[0], -9000.0
    for delay in (*family.delays, member.filtered, member.filtered + 0.02):
        loop = switched_loop(member, gain, np.array([delay, family.delays[-1]]), 0.01)
        system = control.ss(loop.a[0], loop.b[0][:, :1], loop.z, 0, 0.01)
        direct = member.loop(static_controller(task, gain), delay)
        expected = control.ss(
            direct.closed, direct.noise, np.r_[member.roll, np.zeros(len(direct.a) - 13)], 0, 0.01
        )
        for frequency in (0.5, 8.0, 40.0):
            z = np.exp(1j * frequency * 0.01)
            assert system(z) * LEVEL_UNIT == pytest.approx(expected(z), rel=1e-6)


def test_switching_delays_stay_below_the_certified_level():
    """The loop under delays that change at random amplifies less than is certified."""
    task = task_of(*DELAYS["500k"])
    family = family_of(task)
    member, gain = family.members[0], -14000.0
    grid = delay_grid(member, family.delays, 0.01, 2e-3)
    loop = switched_loop(member, gain, grid, 0.01)
    point = certify_level(loop, 0.0, Clock())
    assert point is not None
    random = np.random.default_rng(1)
    x = np.zeros(len(loop.a[0]))
    rolled = pushed = 0.0
    for k in range(4000):
        i = random.integers(len(loop.a))
        d = np.sin(6.0 * 0.01 * k) if k < 3000 else 0.0
        rolled += float(loop.z[0] @ x) ** 2
        pushed += d**2
        x = loop.a[i] @ x + loop.b[i][:, 0] * d
    assert 0.5 < np.sqrt(rolled / pushed) / np.sqrt(point.level_squared) < 1.0


def test_the_trigger_is_a_bounded_error_in_the_certificate():
    task = task_of(*DELAYS["500k"])
    answer = design("hinf_event", task)
    assert answer.is_verified
    assert answer.verified["event_small_gain"].value < 0.54
    plain = design("hinf_delay", task)
    assert answer.controller.output_gain[0] == plain.controller.output_gain[0]
    held = answer.solution.extra["certified_peak_ratio"]
    assert plain.solution.extra["certified_peak_ratio"] < held < 1.0


def test_where_no_gain_helps_one_line_says_so():
    with pytest.raises(VerdictError, match="makes the feedback destabilising") as refusal:
        design("hinf_delay", task_of(*GATEWAY_50MS))
    assert "\n" not in str(refusal.value)
    with pytest.raises(
        VerdictError, match="the steady-state roll, which rate feedback cannot reduce"
    ):
        design("hinf_delay", task_of(*DELAYS["500k"], vehicle="suv_2020"))


def test_the_theorem_keeps_its_gain_and_fails_on_the_car():
    answer = design("hinf_delay", task_of(*DELAYS["500k"], gains="theorem", unverified=True))
    assert answer.controller.output_gain[0] == pytest.approx(-86899.0, rel=0.01)
    assert not answer.is_verified
    assert answer.verified["gamma_exact"].ok
    assert answer.verified["gain_margin_db"].value < 0.0
    assert any("NOT VERIFIED: hinf_delay with the gains of the" in text for text in answer.warnings)
    with pytest.raises(CanrollError, match="--gains theorem: lqr has none"):
        design("lqr", task_of(0.01, 0.02, gains="theorem"))


def test_a_design_without_margins_is_detuned_and_says_where_it_failed():
    answer = design("rate_feedforward", task_of(*DELAYS["500k"]))
    assert answer.is_verified
    told = answer.warnings[-1]
    assert "command reduced by" in told
    assert "gain margin is" in told
    assert "delay 23.1 ms" in told


def test_the_free_peak_is_the_passive_cars():
    family = family_of(task_of(*DELAYS["500k"]))
    member = family.members[0]
    still = static_controller(task_of(*DELAYS["500k"]), 0.0)
    assert free_peak(member) == pytest.approx(
        response_peak(member.loop(still, 0.01), member.roll), rel=1e-3
    )
