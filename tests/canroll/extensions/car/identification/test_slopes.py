"""Derivatives of a car near its limit, of which the log tells numbers to thousandths."""

import numpy as np
import pytest
from support import fit_truth

from canroll.extensions.car.identification.output_error import Model, Simulator
from canroll.extensions.car.identification.pieces import EVERYTHING, pieces
from canroll.extensions.car.identification.unknowns import unknowns

CENTRAL = 1e-6


def test_they_are_those_of_a_step_far_below_the_deviation_that_is_left():
    """A step as long as that makes deviations of tyres and of roll half as large as they are."""
    case = fit_truth.truth(13)
    parts, _ = pieces(fit_truth.log_of(case), EVERYTHING)
    sought = unknowns(case.start, fit_truth.NAMES)
    model = Model(case.start, parts, "body", EVERYTHING, sought)
    x = np.array([unknown.coordinate(case.numbers[unknown.key]) for unknown in sought])
    noise = np.array(list(fit_truth.NOISE.values()))

    def deviations(slopes):
        flat = (np.where(model.compared[:, :, None], slopes, 0.0) / noise[:, None]).reshape(
            -1, x.size
        )
        return np.sqrt(np.diag(np.linalg.inv(flat.T @ flat + np.eye(x.size))))

    steps = CENTRAL * np.eye(x.size)
    central = [(model.simulated(x + s) - model.simulated(x - s)) / (2 * CENTRAL) for s in steps]
    expected = deviations(np.stack(central, axis=2))
    assert expected.min() < 3e-3
    assert deviations(Simulator(model).slopes(x)) == pytest.approx(expected, rel=0.01)
