"""The ECU finds the sensor's clock in what the bus makes of it, and follows it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canroll.hil.phase_lock import ACQUIRE, CREEP_NS, PhaseLock

CYCLE = 10_000_000


def follow(seed, *, drift=0.0, phase=2_500_000, start=0, frames=2000, late=None):
    """Phases after the true clock of the ticks of an ECU that is locked, ns."""
    draws = np.random.default_rng(seed)
    lock = PhaseLock(phase_ns=phase, cycle_ns=CYCLE)
    deadline, found = start, []
    for k in range(frames):
        sensor = round(k * CYCLE * (1 + drift))
        jitter = int(draws.exponential(120_000)) if draws.random() < 0.7 else 0
        arrival = sensor + 230_000 + jitter + (late(k) if late else 0)
        lock.arrived(arrival)
        deadline += CYCLE
        deadline += lock.correction(deadline)
        found.append((deadline - sensor - 230_000) % CYCLE)
    return np.array(found)


@given(st.integers(0, 10**6), st.integers(0, CYCLE - 1), st.integers(500_000, 9_000_000))
def test_the_phase_is_kept_whatever_the_clocks_began_with(seed, start, phase):
    found = follow(seed, start=start, phase=phase, frames=600)[ACQUIRE + 50 :]
    assert np.all(np.abs(found - phase) < 250_000)
    assert abs(np.mean(found) - phase) < 60_000


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_a_drifting_clock_is_followed(drift):
    found = follow(3, drift=drift, frames=6000)[200:]
    assert np.all(np.abs(found - 2_500_000) < 300_000)


def test_a_held_up_frame_moves_nothing():
    """One that comes six ms late could be taken for one four ms early."""
    found = follow(5, late=lambda k: 6_000_000 if k % 500 == 400 else 0)[ACQUIRE + 50 :]
    assert np.all(np.abs(found - 2_500_000) < 300_000)


def test_frames_that_come_anyhow_are_not_followed():
    draws = np.random.default_rng(1)
    lock = PhaseLock(phase_ns=0, cycle_ns=CYCLE)
    for k in range(3000):
        lock.arrived(k * CYCLE + int(draws.integers(CYCLE)))
    assert not lock.locked
    assert lock.correction(123) == 0


def test_nothing_moves_before_the_phase_is_found():
    lock = PhaseLock(phase_ns=0, cycle_ns=CYCLE)
    for k in range(ACQUIRE - 1):
        lock.arrived(k * CYCLE)
        assert lock.correction(3_000_000) == 0
    assert not lock.locked
    lock.arrived(ACQUIRE * CYCLE)
    assert lock.locked
    assert lock.correction(ACQUIRE * CYCLE + 3_000_000) == 7_000_000
    assert abs(lock.correction((ACQUIRE + 1) * CYCLE)) <= CREEP_NS
