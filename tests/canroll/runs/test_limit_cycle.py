import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from support.limit_cycles import detect

from canroll.runs import limit_cycle
from canroll.runs.limit_cycle import turning_points

T = np.arange(0, 8, 0.01)
LANE_CHANGE = np.sin(2 * np.pi * 0.4 * T) * ((T > 1) & (T < 6))
SLALOM = np.sin(2 * np.pi * 0.9 * T)
NOISE = np.random.default_rng(1).standard_normal(len(T))


def test_turning_points_alternate_and_ignore_wiggles():
    values = np.sin(2 * np.pi * T) + 0.05 * np.sin(2 * np.pi * 20 * T)
    turns = turning_points(values, 0.3)
    assert len(turns) == 17  # the first sample and two a period
    assert np.all(np.diff(np.sign(values[turns])) != 0)


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=60))
def test_turning_points_are_alternate_extremes(values):
    values = np.array(values)
    turns = turning_points(values, 1.0)
    assert np.all(np.diff(turns) > 0)
    steps = np.diff(values[turns])
    assert np.all(np.abs(steps) > 1.0)
    assert np.all(steps[1:] * steps[:-1] < 0)


@pytest.mark.parametrize(
    ("command", "roll"),
    [
        (-900 * LANE_CHANGE, 0.05 * LANE_CHANGE),
        (900 * np.exp(-0.8 * T) * np.sin(2 * np.pi * 1.5 * T), 0.05 * LANE_CHANGE),
        (20 * NOISE - 900 * LANE_CHANGE, 0.05 * LANE_CHANGE),
        (-900 * SLALOM, 0.05 * SLALOM),
    ],
    ids=["control of a lane change", "decaying", "noise", "a slalom asks for its swings"],
)
def test_what_is_no_limit_cycle(command, roll):
    assert detect(T, command, T, roll) is None


@pytest.mark.parametrize("frequency", [0.9, 1.8, 4.0])
def test_a_sustained_oscillation_is_found_and_measured(frequency):
    swing = 700 * np.sin(2 * np.pi * frequency * T) * (T > 2)
    cycle = detect(T, swing, T, 0.05 * LANE_CHANGE)
    assert cycle is not None
    assert cycle.frequency == pytest.approx(frequency, rel=0.03)
    assert cycle.amplitude == pytest.approx(700, rel=0.1)
    assert cycle.start == pytest.approx(2, abs=1 / frequency)
    assert "limit cycle" in str(cycle)


def test_a_saturated_oscillation_on_top_of_the_manoeuvre_is_found():
    swing = np.clip(2000 * np.sin(2 * np.pi * 2 * T) - 300 * LANE_CHANGE, -1500, 1500)
    assert detect(T, swing, T, 0.05 * LANE_CHANGE).frequency == pytest.approx(2, rel=0.05)


def test_a_growing_oscillation_that_rides_on_the_manoeuvre_is_found():
    swing = np.minimum(40 * np.exp(0.7 * T), 500) * np.sin(2 * np.pi * 2.3 * T)
    cycle = detect(T, swing - 1200 * LANE_CHANGE, T, 0.05 * LANE_CHANGE)
    assert cycle.frequency == pytest.approx(2.3, rel=0.05)


@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.5])
def test_a_run_of_less_than_a_second_has_none(seconds):
    elapsed = T - T[0]
    short = T[elapsed <= seconds]
    swing = 700 * np.sin(2 * np.pi * 8 * short)
    assert detect(short, swing, short, 0.0 * short) is None


@pytest.mark.parametrize("kept", [0.9, 0.5, 0.02])
def test_a_run_that_missed_ticks_is_judged_all_the_same(kept):
    draws = np.random.default_rng(4)
    ran = draws.random(len(T)) < kept
    ran[[0, -1]] = True
    swinging = 900 * np.sin(2 * np.pi * 1.5 * T)
    found = detect(T[ran], swinging[ran], T, 0.05 * LANE_CHANGE)
    if kept > 0.1:
        assert found.frequency == pytest.approx(1.5, rel=0.05)
    assert detect(T[ran], -900 * LANE_CHANGE[ran], T, 0.05 * LANE_CHANGE) is None


def test_a_burst_of_ticks_after_a_gap_is_judged_all_the_same():
    t = np.array([0.01, 0.02, 0.03, 1.5, 1.51])
    assert detect(t, np.array([0.0, 500.0, -500.0, 400.0, 0.0]), T, 0.05 * LANE_CHANGE) is None


@pytest.mark.parametrize("window", limit_cycle.AVERAGES)
@pytest.mark.parametrize("size", [1, 37, 600, 2000, 10**6])
def test_pieces_of_a_signal_lose_the_same_average_as_the_whole(window, size):
    parts = ((T[i : i + size], LANE_CHANGE[i : i + size]) for i in range(0, len(T), size))
    t, values = map(
        np.concatenate, zip(*limit_cycle._pieces_without_average(parts, window), strict=True)
    )
    assert np.array_equal(t, T)
    whole = limit_cycle._without_average(LANE_CHANGE, T, window)
    np.testing.assert_allclose(values, whole, rtol=0, atol=1e-12)


TICK = 0.01
LONG = np.arange(0, 14, TICK)
STEERING = np.interp(LONG, T, 4.0 * LANE_CHANGE)
"""Lateral acceleration, m/s²: a lane change, then 8 s straight on."""
LIMIT = 2000.0
LEAST_DAMPING = -np.log(limit_cycle.DECAY) / (np.pi * (limit_cycle.HALF_CYCLES_MIN - 2))
"""Damping ratio whose oscillation decays to DECAY over whole swings of the shortest limit cycle.

The first of its swings may be one that began before the loop was watched.
"""


class Loop:
    """A car's roll as a second-order system, and a moment commanded from its noisy roll rate.

    ``law`` is called with the measured roll (rad) and roll rate (rad/s).
    """

    INERTIA, OMEGA, DAMPING, LEVER = 900.0, 2 * np.pi * 1.5, 0.15, 800.0

    def __init__(self, law, delay):
        a = np.array([[0.0, 1.0], [-(self.OMEGA**2), -2 * self.DAMPING * self.OMEGA]])
        self.phi = expm(a * TICK)
        self.gamma = np.linalg.solve(a, (self.phi - np.eye(2)) @ [0.0, 1 / self.INERTIA])
        self.law, self.delay = law, delay

    def run(self, t, steering, noise):
        """Return the commands (N·m) and the roll angle (rad); ``steering``: m/s² by tick."""
        x, queue = np.zeros(2), [0.0] * self.delay
        commands, roll = np.empty(len(t)), np.empty(len(t))
        for k in range(len(t)):
            commands[k] = np.clip(self.law(*(x + noise[k])), -LIMIT, LIMIT)
            roll[k] = x[0]
            queue.append(commands[k])
            x = self.phi @ x + self.gamma * (queue.pop(0) + self.LEVER * steering[k])
        return commands, roll

    def least_damping(self, feedback):
        """Least damping ratio of the closed loop's modes that oscillate."""
        size = 2 + self.delay
        closed = np.zeros((size, size))
        closed[:2, :2] = self.phi
        row = np.zeros(size)
        row[:2] = feedback
        if self.delay:
            closed[:2, 2] = self.gamma
            closed[2:-1, 3:] = np.eye(self.delay - 1)
            closed[-1] = row
        else:
            closed[:2] += np.outer(self.gamma, row)
        factors = np.linalg.eigvals(closed)
        poles = np.log(factors[np.abs(factors.imag) > 1e-6]) / TICK
        return np.min(-poles.real / np.abs(poles), initial=1.0)


def claimed(loop, deviation, seed, steering=STEERING):
    """Whether a limit cycle is claimed of the loop, driven as a run is, with noise of the sensors.

    ``deviation``: standard deviations of roll (rad) and roll rate (rad/s).
    """
    noise = np.random.default_rng(seed).standard_normal((len(LONG), 2)) * deviation
    commands, _ = loop.run(LONG, steering, noise)
    _, roll = Loop(lambda roll, rate: 0.0, 0).run(LONG, steering, 0 * noise)
    found = limit_cycle.oscillations(LONG, commands)
    for cycle in limit_cycle.unexcited(found, lambda: [(LONG, roll)]):
        t = np.arange(0.0, cycle.established + cycle.watched, TICK)
        still = np.pad(noise, ((0, max(0, len(t) - len(noise))), (0, 0)))
        ahead = np.interp(t, LONG, steering) * (t < cycle.established)
        quiet, _ = loop.run(t, ahead, still[: len(t)] * (t < cycle.established)[:, None])
        if limit_cycle.goes_on(t, quiet, cycle.established):
            return True
    return False


feedbacks = st.tuples(st.floats(0, 8e4), st.floats(-1e4, 2e4))


@pytest.mark.slow
@example(feedback=(56_000.0, 0.0), delay=3, rate=0.0, seed=0, straight=False)
@given(feedbacks, st.integers(0, 12), st.floats(0, 0.1), st.integers(0, 1000), st.booleans())
def test_a_stable_loop_with_noise_has_no_limit_cycle(feedback, delay, rate, seed, straight):
    loop = Loop(lambda roll, roll_rate: -feedback[0] * roll - feedback[1] * roll_rate, delay)
    assume(loop.least_damping(np.negative(feedback)) > LEAST_DAMPING)
    steering = 0 * STEERING if straight else STEERING
    assert not claimed(loop, (0.1 * rate, rate), seed, steering)


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(feedbacks, st.integers(1, 12), st.floats(0, 30), st.integers(0, 1000))
def test_an_unstable_loop_with_noise_has_one(feedback, delay, noise, seed):
    """``noise`` of the command, N·m, is well within the hysteresis of SHARE_OF_PEAK * LIMIT."""
    loop = Loop(lambda roll, roll_rate: -feedback[0] * roll - feedback[1] * roll_rate, delay)
    assume(loop.least_damping(np.negative(feedback)) < -LEAST_DAMPING)
    rate = noise / (0.1 * feedback[0] + abs(feedback[1]))
    assert claimed(loop, (0.1 * rate, rate), seed)


@settings(deadline=None, max_examples=30)
@given(st.floats(300, LIMIT), st.integers(3, 12), st.floats(0, 0.05), st.integers(0, 1000))
def test_a_relay_with_noise_has_one(moment, delay, share, seed):
    loop = Loop(lambda roll, roll_rate: -moment * np.sign(roll_rate), delay)
    # the roll rate that the moment builds up within the delay
    rate = share * moment / loop.INERTIA * delay * TICK
    assert claimed(loop, (0.0, rate), seed)
