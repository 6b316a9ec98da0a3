"""A run on a network with floating-point signals gives the figures of that with integers."""

from dataclasses import asdict

import pytest
from support import float_bus

from canroll.runs import experiment

SHORT = {"actuator": "bars", "duration": 2.0}


def run(dbc, map_file):
    return experiment.run("double_lane_change", dbc=str(dbc), map=str(map_file), **SHORT)


@pytest.mark.slow
def test_the_figures_are_those_of_integers(tmp_path):
    real = run(*float_bus.write(tmp_path))
    own = run(float_bus.OWN / "own.dbc", float_bus.OWN / "own.toml")
    assert not real.warnings
    # the integers' steps are coarser: 0.005 deg/s, 0.001 m/s2, 0.25 N m
    # and what stays far below such a step (a ride of 0.009 m/s2) within a tenth of it
    figures = asdict(real.controlled_metrics)
    assert figures == pytest.approx(asdict(own.controlled_metrics), rel=3e-3, abs=1e-4)
    assert figures["moment_max_nm"] > 100.0
