import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.runs import limit_cycle
from hil.runs.limit_cycle import detect, turning_points

T = np.arange(0, 8, 0.01)
LANE_CHANGE = np.sin(2 * np.pi * 0.4 * T) * ((T > 1) & (T < 6))


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


def test_control_of_a_lane_change_is_no_limit_cycle():
    assert detect(T, -900 * LANE_CHANGE, T, 0.05 * LANE_CHANGE) is None


def test_a_decaying_oscillation_is_no_limit_cycle():
    ringing = 900 * np.exp(-0.8 * T) * np.sin(2 * np.pi * 1.5 * T)
    assert detect(T, ringing, T, 0.05 * LANE_CHANGE) is None


def test_noise_is_no_limit_cycle():
    noise = 20 * np.random.default_rng(1).standard_normal(len(T))
    assert detect(T, noise - 900 * LANE_CHANGE, T, 0.05 * LANE_CHANGE) is None


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


def test_a_slalom_asks_for_its_swings():
    slalom = np.sin(2 * np.pi * 0.9 * T)
    assert detect(T, -900 * slalom, T, 0.05 * slalom) is None


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
