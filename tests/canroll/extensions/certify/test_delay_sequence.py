"""Sequences of delays: products against constant delays and simulation."""

import numpy as np
import pytest

from canroll.extensions.certify.delay_sequence import closest, simulate
from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.analysis.sampled_loop import spectral_radius
from canroll.gain_gen.calibration.dequantise import dequantise
from canroll.gain_gen.margin_report import task_of
from canroll.gain_gen.models.controller import scaled_controller


@pytest.fixture(scope="module")
def loop(calibrated):
    calibration = calibrated("hinf_delay")
    task = task_of(calibration)
    member = family_of(task).members[3]
    return task, member, dequantise(calibration.record)


def test_a_constant_delay_is_that_of_the_margins(loop):
    task, member, controller = loop
    for delay in (task.delay.least, task.delay.nominal, task.delay.most):
        pure = delay - member.filtered
        expected = spectral_radius(member.loop(controller, delay))
        assert closest(member, controller, (pure, pure)).radius == pytest.approx(expected, rel=1e-9)


def test_a_simulation_grows_as_the_closest_sequence_does(loop):
    task, member, controller = loop
    bounds = (task.delay.least - member.filtered, task.delay.most - member.filtered)
    assert closest(member, controller, bounds).radius < 0.97
    loud = scaled_controller(controller, 4.0)
    found = closest(member, loud, bounds)
    assert found.radius > 1.01
    angles = np.abs(simulate(member, loud, found.delays, roll=0.01, ticks=500))
    growth = (angles[400:].max() / angles[200:300].max()) ** (1.0 / 200.0)
    assert growth == pytest.approx(found.radius, rel=1e-3)
