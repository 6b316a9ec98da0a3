"""Known truth without a search."""

import numpy as np
import pytest

from canroll.extensions.car.identification import input_noise
from tools.validation import fit_linear


def test_of_good_sensors_the_noise_of_the_inputs_widens_the_intervals(monkeypatch):
    result = fit_linear.outcome(3, 0.1)
    assert 0.5 < result.distance < 2.0
    monkeypatch.setattr(input_noise, "effects", lambda simulator, x, simulated: iter(()))
    without = fit_linear.outcome(3, 0.1)
    assert [row.error for row in without.rows] == [row.error for row in result.rows]
    wider = np.array([row.deviation for row in result.rows]) / [r.deviation for r in without.rows]
    keys = [row.key for row in result.rows]
    assert wider[keys.index("log.lateral_acceleration_offset")] > 1.2
    assert wider.min() > 0.99


def test_of_the_usual_sensors_they_hardly_do():
    result = fit_linear.outcome(3, 1.0)
    assert [row.deviation / row.least for row in result.rows] == pytest.approx(
        [1.0] * len(result.rows), abs=0.2
    )


def test_other_arguments_are_refused():
    assert fit_linear.main([]) == 2
