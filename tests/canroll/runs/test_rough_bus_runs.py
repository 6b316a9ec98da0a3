"""A run on a network with the defects of real cars' files is that on one without them."""

import numpy as np
import pytest
from support import rough_bus

from canroll.runs import experiment

SHORT = {"actuator": "suspension", "duration": 1.5}


def run(dbc, map_file):
    return experiment.run("double_lane_change", dbc=str(dbc), map=str(map_file), **SHORT)


@pytest.mark.slow
def test_every_frame_is_that_of_the_network_without_defects(tmp_path):
    rough = run(*rough_bus.write(tmp_path))
    own = run(rough_bus.OWN / "own.dbc", rough_bus.OWN / "own.toml")
    assert np.array_equal(rough.controlled.frames, own.controlled.frames)
    assert len(own.controlled.frames) > 500
    assert sum("read leniently" in warning for warning in rough.warnings) == 1
