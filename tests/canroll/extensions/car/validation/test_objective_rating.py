"""The rating of ISO/TS 18571: by values of others, and by what each of its parts is for."""

import numpy as np
import pytest

from canroll.extensions.car.validation.rating import Rating, rate


def test_the_overall_rating_is_that_of_another_user_of_the_standard():
    """pyisomme's own test has 0.713 for these two curves."""
    time = np.arange(0.0, 0.150, 0.0001)
    curve = np.sin(time * 20)
    rated = rate(curve, 1.3 * curve, 0.0001)
    assert rated.overall == pytest.approx(0.713, abs=5e-4)
    assert rated.phase == 1.0


def test_the_corridors_by_hand():
    """A constant difference d of a peak of 1: ((0.5 − d)/(0.5 − 0.05))², ISO/TS 18571."""
    curve = np.sin(np.linspace(0.0, 2 * np.pi, 401))
    for difference in (0.02, 0.1, 0.275, 0.6):
        inside = 1.0 if difference < 0.05 else max((0.5 - difference) / 0.45, 0.0) ** 2
        assert rate(curve, curve + difference).corridor == pytest.approx(inside)


def test_a_shift_is_one_of_phase():
    """A tenth of the length is half of the shift that is allowed."""
    time = np.linspace(0.0, 4.0, 401)
    curve, late = (np.exp(-(((time - at) / 0.3) ** 2)) for at in (1.5, 1.9))
    rated = rate(curve, late)
    assert rated.phase == pytest.approx(0.5, abs=0.02)
    assert rated.magnitude > 0.99
    assert rated.slope > 0.99
    assert rated.corridor < 0.8


def test_overall_is_the_weighted_mean():
    curve = np.sin(np.linspace(0.0, 5.0, 300))
    rated = rate(curve, 0.8 * np.roll(curve, 7))
    parts = 0.4 * rated.corridor + 0.2 * (rated.phase + rated.magnitude + rated.slope)
    assert rated.overall == pytest.approx(parts)


@pytest.mark.parametrize(
    ("overall", "word"),
    [(1.0, "excellent"), (0.94, "good"), (0.81, "good"), (0.8, "fair"), (0.58, "poor")],
)
def test_words_of_the_standard(overall, word):
    assert Rating(overall, 1.0, 1.0, 1.0, 1.0).grade == word


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_every_part_is_that_of_the_package_of_tu_graz(seed):
    package = pytest.importorskip("objective_rating_metrics.rating")
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(rng.integers(50, 600))
    measured = np.sin(rng.uniform(0.5, 6.0) * time) + 0.1 * rng.normal(size=len(time))
    late = np.roll(measured, rng.integers(-len(time) // 4, len(time) // 4))
    simulated = rng.uniform(0.3, 1.6) * late + 0.1 * rng.normal(size=len(time))
    if seed % 3 == 0:  # many equal differences: of several ways to warp the same one is taken
        measured, simulated = np.round(measured, 1), np.round(simulated, 1)
    judge = package.ISO18571(*(np.column_stack((time, v)) for v in (measured, simulated)), dt=0.01)
    rated = rate(measured, simulated)
    for part in ("overall", "corridor", "phase", "magnitude", "slope"):
        expected = getattr(judge, f"{part}_rating")(-1)
        assert getattr(rated, part) == pytest.approx(expected, abs=1e-13)
