"""The tolerance of jitter: its sum over aliases, and loops whose delay changes at every tick."""

from itertools import pairwise, product
from math import ceil

import numpy as np
import pytest
from scipy.linalg import expm

from canroll import vehicles
from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.analysis.held_plant import aliased, command_response, held
from canroll.gain_gen.analysis.margins import jitter_level
from canroll.gain_gen.laws.roll_rate_feedback import static_controller
from canroll.gain_gen.models.state_space import resolvent_rows
from canroll.gain_gen.models.task import Delay, Task

TICK = 0.3
LAG = (np.array([[-1.0]]), np.array([[1.0]]), np.array([[1.0]]))
OSCILLATOR = (
    np.array([[0.0, 1.0], [-4.0, -0.4]]),
    np.array([[0.0], [1.0]]),
    np.array([[0.0, 1.0]]),
)
CASES = [(LAG, 0.0, 0.3), (LAG, 0.0, 0.6), (OSCILLATOR, 0.0, 0.3), (OSCILLATOR, 0.1, 0.4)]


def level(plant, gain, least, most):
    """Return the small-gain level of u = ``gain`` y at a plant with delays between the bounds."""
    a, b, c = plant
    frequencies = np.linspace(1e-3, np.pi / TICK, 1500)
    z = np.exp(1j * frequencies * TICK)
    sampled = held(a, b, tick=TICK, delay=0.5 * (least + most))
    rows = resolvent_rows(sampled.phi, c, z)
    power = aliased(a, b, c, tick=TICK, rows=rows, z=z)[:, 0, 0].real
    loop = -gain * command_response(sampled, rows, z)[:, 0]
    return jitter_level(
        frequencies, loop, abs(gain) * np.sqrt(power), tick=TICK, jitter=most - least
    )


def gain_of_level(plant, wanted, least, most):
    """Return the negative gain of a level, by bisection from zero on."""
    low, high = 0.0, 1.0
    while level(plant, -high, least, most) < wanted:
        low, high = high, 2.0 * high
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if level(plant, -middle, least, most) < wanted else (low, middle)
    return -low


def growth(plant, gain, delays):
    """Return the growth per tick of the loop with periodic delays, the newest command in force.

    The state and the past commands are carried as matrices through the exact solution between the
    instants at which commands arrive.
    """
    a, b, c = plant
    n, past, period = len(a), ceil(max(delays) / TICK) + 1, len(delays)
    ticks = period * ceil(past / period)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n:] = a, b
    whole = np.eye(n + past)
    x, sent = whole[:n], {-1 - i: whole[n + i] for i in range(past)}
    for k in range(ticks):
        sent[k] = gain * (c @ x)[0]
        arrivals = {j: (j - k) * TICK + delays[j % period] for j in range(k - past, k + 1)}
        instants = [0.0, *sorted(at for at in arrivals.values() if 0.0 < at < TICK), TICK]
        for start, end in pairwise(instants):
            newest = max(j for j, at in arrivals.items() if at <= start + 1e-12)
            flow = expm(block * (end - start))
            x = flow[:n, :n] @ x + flow[:n, n:] * sent[newest]
    following = np.vstack([x, *(sent[ticks - 1 - i] for i in range(past))])
    return float(np.abs(np.linalg.eigvals(following)).max() ** (1.0 / ticks))


def sequences(least, most):
    """Return constant, short periodic and long random sequences of delays."""
    middle = 0.5 * (least + most)
    found = [s for length in (1, 2, 3) for s in product((least, middle, most), repeat=length)]
    found += product((least, most), repeat=4)
    rng = np.random.default_rng(0)
    return found + [tuple(rng.uniform(least, most, 9)) for _ in range(20)]


@pytest.mark.parametrize(("plant", "least", "most"), CASES)
def test_no_sequence_of_delays_destabilises_what_is_below_one(plant, least, most):
    gain = gain_of_level(plant, 0.99, least, most)
    assert gain < -0.5
    assert max(growth(plant, gain, delays) for delays in sequences(least, most)) < 1.0


def test_delays_that_alternate_can_destabilise_where_each_alone_is_stable():
    """So the judge of the other test does find what a constant delay would not show."""
    gain, bounds = -2.56, (0.0, 0.6)
    assert max(growth(LAG, gain, (delay,)) for delay in np.linspace(*bounds, 13)) < 0.99
    assert growth(LAG, gain, (0.6, 0.6, 0.0)) > 1.03
    assert level(LAG, gain, *bounds) > 1.0


def test_the_judge_of_a_constant_delay_is_the_sampled_loop():
    a, b, c = OSCILLATOR
    sampled = held(a, b, tick=TICK, delay=0.2)
    loop = np.zeros((3, 3))
    loop[:2, :2], loop[:2, 2:] = sampled.phi - 1.1 * sampled.fresh @ c, sampled.stale
    loop[2, :2] = -1.1 * c
    radius = np.abs(np.linalg.eigvals(loop)).max()
    assert growth(OSCILLATOR, -1.1, (0.2,)) == pytest.approx(radius, rel=1e-9)


def test_the_level_grows_with_the_span_and_is_nothing_without():
    levels = [level(LAG, -1.0, 0.3 - span, 0.3 + span) for span in (0.0, 0.05, 0.15, 0.3)]
    assert levels[0] == 0.0
    assert np.all(np.diff(levels) > 0.0)


def direct_sum(member, tick, reach):
    """Return the products of the readings, summed over aliases one by one, (frequencies, 4, 4)."""
    car, found = member.plant, 0.0
    for k in range(-reach, reach + 1):
        s = 1j * (member.frequencies + 2.0 * np.pi * k / tick)
        columns = np.broadcast_to(car.command.astype(complex), (len(s), *car.command.shape))
        states = np.linalg.solve(s[:, None, None] * np.eye(len(car.a)) - car.a, columns)
        readings = (car.measured @ states)[:, :, 0]
        found = found + readings[:, :, None] * readings[:, None, :].conj()
    return found


@pytest.mark.parametrize("delays", [(5.6e-3, 23.1e-3), (16.1e-3, 50.2e-3)])
def test_the_familys_level_is_that_of_the_sum_over_aliases(delays):
    task = Task(vehicles.load("van_real"), Delay(0.5 * sum(delays), *delays))
    family = family_of(task)
    gain = -12000.0
    found, where = family.jitter(static_controller(task, gain))
    member = next(member for member in family.members if member.condition == where)
    power = direct_sum(member, task.tick, 40)
    # that of the delivered moment, the last reading, converges slowly
    inertial = power[:, :3, :3]
    scale = np.sqrt(np.abs(np.einsum("fii->if", inertial)))
    error = (member.aliased[:, :3, :3] - inertial).transpose(1, 2, 0) / (scale[:, None] * scale)
    assert np.abs(error).max() < 1e-4
    expected = jitter_level(
        family.frequencies,
        -gain * member.commanded(family.delays[1])[:, 0],
        abs(gain) * np.sqrt(power[:, 0, 0].real),
        tick=task.tick,
        jitter=family.span,
    )
    assert found == pytest.approx(expected, rel=1e-6)
