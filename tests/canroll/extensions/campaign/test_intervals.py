"""Intervals cover a known probability as often as they say."""

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from canroll.extensions.campaign.intervals import always, exact, martingale


@pytest.mark.parametrize(("events", "draws"), [(0, 60), (3, 100), (60, 60), (17, 1000)])
def test_the_exact_interval_is_that_of_scipy(events, draws):
    reference = binomtest(events, draws).proportion_ci(method="exact")
    found = exact(events, draws)
    assert (found.low, found.high) == pytest.approx((reference.low, reference.high), rel=1e-9)


@pytest.mark.parametrize("probability", [0.001, 0.02, 0.3])
def test_the_exact_interval_covers(probability):
    """The coverage itself, over all possible counts."""
    draws = 300
    covered = sum(
        binom.pmf(events, draws, probability)
        for events in range(draws + 1)
        if exact(events, draws).low <= probability <= exact(events, draws).high
    )
    assert covered >= 0.95


@pytest.mark.parametrize("probability", [0.001, 0.02, 0.3])
def test_the_sequence_covers_at_all_times(probability):
    """In at most 5 % of 1000 campaigns of 5000 draws the probability is ever outside."""
    random = np.random.default_rng(7)
    ever = 0
    draws = np.arange(1, 5001)
    for _ in range(1000):
        events = np.cumsum(random.random(5000) < probability)
        ever += bool(np.any(martingale(events, draws, probability) > np.log(20)))
    assert ever <= 50


def test_the_sequence_is_where_the_martingale_is_below_its_bound():
    for events, draws in ((0, 50), (3, 100), (40, 64), (64, 64)):
        interval = always(events, draws)
        for end in (interval.low, interval.high):
            if 0 < end < 1:
                assert martingale(events, draws, end) == pytest.approx(np.log(20), abs=1e-6)
        assert interval.low <= events / draws <= interval.high
    assert (always(0, 0).low, always(0, 0).high) == (0.0, 1.0)


@pytest.mark.parametrize("draws", [3_000_000, 10_000_000, 10**12])
def test_one_event_in_very_many_draws_has_an_interval(draws):
    for events in (1, draws - 1):
        interval = always(events, draws)
        assert 0.0 <= interval.low < events / draws < interval.high <= 1.0
    rare = always(1, draws)
    assert 0.0 < rare.low < 1e-3 / draws
    assert martingale(1, draws, rare.low) == pytest.approx(np.log(20), abs=1e-6)
    assert 5.0 / draws < rare.high < 30.0 / draws


def test_the_sequence_stops_later_than_the_exact_interval_is_as_narrow():
    for events, draws in ((0, 500), (5, 1000), (300, 2000)):
        assert always(events, draws).width > exact(events, draws).width
