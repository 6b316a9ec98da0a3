"""Logs of a multi-body car that is not ours: as our plant with its numbers would give them."""

import numpy as np
import pytest

pytest.importorskip("vehiclemodels", reason="needs commonroad-vehicle-models")

from tools.validation import fit_foreign
from tools.validation.fit_truth import NAMES, Outcome, Row

pytestmark = pytest.mark.slow

SEED = 2


def test_both_cars_move_alike_with_the_same_numbers():
    logs = [fit_foreign.truth(car, SEED, duration=3.0) for car in ("completed", "plant")]
    assert logs[0].numbers == logs[1].numbers
    foreign, own = (log.columns for log in logs)
    assert (foreign["steering_wheel_rad"] == own["steering_wheel_rad"]).all()
    assert (foreign["speed_m_s"] == own["speed_m_s"]).all()
    # the sensors' noise is the same too; relaxation of our tyres lags by a millisecond
    for name in NAMES:
        away = np.sqrt(np.mean((foreign[name] - own[name]) ** 2)) / np.std(own[name])
        assert 0.0 < away < 0.05, name


def test_the_table_is_of_errors_in_the_units_of_the_numbers():
    """Deviations of the priors become per cent and metres."""
    keys = ("tyre.friction", "sensors.imu_position.0", "log.roll_delay")
    rows = tuple(Row(key, 1.0, 0.4, 0.4, "identified") for key in keys)
    _, _, friction, place, total = fit_foreign.table([Outcome(rows, 1.0)])
    assert friction == "| friction | 0 of 1 | +11 | 8.2 | % |"
    assert place == "| inertial unit ahead of CG | 0 of 1 | +0.4 | 0.31 | m |"
    assert total == "| all | 0 of 2 | | | |"
