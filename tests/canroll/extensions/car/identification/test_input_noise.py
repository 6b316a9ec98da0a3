"""Noise of the inputs in a fit's uncertainty, of cars whose response to it has a closed form."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import get_ident

import numpy as np
import pytest

from canroll.cases.engine import HERE, Engine
from canroll.extensions.car.identification.input_noise import DRAWS, input_scores
from canroll.extensions.car.identification.output_error import Simulator
from canroll.extensions.car.identification.pieces import Piece
from canroll.extensions.car.identification.smoothing import EXACT, Noise

COUNT = 400
TIME = 0.01 * np.arange(COUNT)


@dataclass(frozen=True)
class Car:
    """Turns at ``gain`` times its steering, at once, and feels its speed in the second signal."""

    pieces: tuple[Piece, ...]
    gain: float = 0.3

    @property
    def compared(self):
        compared = np.ones((COUNT, 2), bool)
        compared[:100] = False
        return compared

    def simulated(self, x):
        (piece,) = self.pieces
        return np.column_stack((self.gain * piece.steering, 0.1 * piece.speed))


def car(steering=EXACT, speed=EXACT):
    wheel, constant = np.sin(TIME), np.full(COUNT, 20.0)
    names = ("yaw_rate", "roll")
    return Car((Piece(0.0, wheel, constant, names, np.zeros((COUNT, 2)), steering, speed),))


def weighted(model):
    slopes = np.random.default_rng(3).standard_normal((COUNT, 2, 1))
    return np.where(model.compared[:, :, None], slopes, 0.0)


def scores_of(model, slopes=None, where=HERE, report=lambda share: None):
    x = np.zeros(1)
    slopes = weighted(model) if slopes is None else slopes
    return input_scores(Simulator(model, where), x, model.simulated(x), slopes, report)


def test_white_noise_of_the_steering_comes_through_the_gain():
    model = car(steering=Noise(0.01, 0.0, TIME))
    covariance, variances, _ = scores_of(model)
    expected = (0.3 * 0.01) ** 2 * np.sum(weighted(model)[:, 0] ** 2)
    # three standard deviations of a variance from so many draws
    assert covariance[0, 0] == pytest.approx(expected, rel=3 * np.sqrt(2 / DRAWS))
    assert variances == pytest.approx([(0.3 * 0.01) ** 2, 0.0], rel=0.05)


def test_a_smoothed_speed_is_wrong_for_longer_but_by_less():
    rough, smooth = (car(speed=Noise(0.01, weight, TIME)) for weight in (0.0, 1e4))
    assert scores_of(smooth).variances[1] < 0.1 * scores_of(rough).variances[1]
    # slow errors do not average out over slopes that are slow too
    drift = np.where(rough.compared[:, :, None], 1.0, 0.0)
    slow = [scores_of(m, drift).covariance[0, 0] for m in (rough, smooth)]
    assert slow[1] == pytest.approx(slow[0], rel=0.6)


def test_inputs_without_noise_leave_nothing():
    effect = scores_of(car())
    assert not effect.covariance.any()
    assert not effect.variances.any()
    assert effect.drives == DRAWS


def test_an_engine_drives_the_draws_and_changes_nothing():
    drivers, shares = set(), []

    class Watched(Car):
        def simulated(self, x):
            drivers.add(get_ident())
            return super().simulated(x)

    one = car(steering=Noise(0.01, 0.0, TIME), speed=Noise(0.01, 3.0, TIME))
    here = scores_of(one)
    with ThreadPoolExecutor(2) as pool:
        there = scores_of(Watched(one.pieces), where=Engine(pool, 2), report=shares.append)
    assert np.array_equal(there.covariance, here.covariance)
    assert np.array_equal(there.variances, here.variances)
    # this thread has driven with the inputs as they were measured
    assert len(drivers - {get_ident()}) >= 1
    assert shares == pytest.approx(np.arange(1, DRAWS + 1) / DRAWS)


def test_draws_that_cannot_be_driven_do_not_count():
    class Fragile(Car):
        def simulated(self, x):
            return None if np.ptp(self.pieces[0].speed) > 0.0 else super().simulated(x)

    effect = scores_of(Fragile(car(speed=Noise(0.01, 0.0, TIME)).pieces))
    assert effect.drives == 0
    assert not effect.covariance.any()
