"""Weightings of ISO 2631-1 against the standard's table, and the actuators' work."""

import numpy as np
import pytest
from scipy.signal import sosfreqz

import canroll
from canroll.runs import ride

FREQUENCIES = (0.5, 0.8, 1, 1.6, 2, 2.5, 3.15, 4, 5, 6.3, 8, 10, 12.5, 16, 20, 31.5, 40)
"""Third octaves (Hz), nominal."""
# ISO 2631-1:1997, table 3, factors times 1000
TABLE = {
    "W_K": (418, 477, 482, 494, 531, 631, 804, 967, 1039, 1054, 1036, 988, 902, 768, 636, 405, 314),
    "W_D": (853, 992, 1011, 968, 890, 776, 642, 512, 409, 323, 253, 212, 161, 125, 100, 63.2, 49.4),
}


# the table's W_D at 10 Hz is 5 % off the line of its neighbours, all others are within 1 %
@pytest.mark.parametrize(("name", "tolerance"), [("W_K", 0.02), ("W_D", 0.05)])
def test_weightings_are_those_of_the_standard_s_table(name, tolerance):
    exact = 10 ** (np.round(10 * np.log10(FREQUENCIES)) / 10)
    _, response = sosfreqz(getattr(ride, name).sections, exact, fs=1000.0)
    np.testing.assert_allclose(np.abs(response), np.array(TABLE[name]) / 1000, rtol=tolerance)


def test_a_signal_in_parts_has_the_weighted_rms_of_the_whole():
    time = np.arange(0.0, 60.0, ride.SAMPLE)
    sine = np.sin(2 * np.pi * 8.0 * time)
    in_one = ride.weighted_rms(ride.W_K, [sine])
    assert in_one == pytest.approx(1.036 / np.sqrt(2), rel=0.02)
    assert ride.weighted_rms(ride.W_K, [sine[:777], sine[777:]]) == pytest.approx(in_one, rel=1e-12)
    assert ride.weighted_rms(ride.W_K, []) == 0.0


@pytest.mark.parametrize("actuator", ["bars", "dampers"])
def test_the_actuators_work_is_that_of_their_forces_along_the_travels(actuator):
    """Forces times differences of the travels, which no rate of the plant enters."""
    result = canroll.run("double_lane_change", vehicle="van_real", actuator=actuator, duration=3.0)
    signals, vehicle = result.controlled.signals, result.settings.vehicle
    geometry = vehicle.geometry
    work = 0.0
    for axle, track in (("front", geometry.half_track_front), ("rear", geometry.half_track_rear)):
        moved = []
        for side in ("left", "right"):
            moved.append(np.diff(signals[f"travel_{axle}_{side}"]))
            work += np.sum(signals[f"corner_force_{axle}_{side}"][1:] * moved[-1])
        work += np.sum(signals[f"bar_moment_{axle}"][1:] * (moved[0] - moved[1])) / (2 * track)
    metrics = result.controlled_metrics
    size = ride.SAMPLE * sum(
        np.abs(signals[f"actuator_power_{axle}"]).sum() for axle in ("front", "rear")
    )
    assert metrics.actuator_work_j == pytest.approx(work, abs=0.01 * size)
    assert metrics.actuator_power_max_w > 10.0
    assert (metrics.actuator_work_j < 0.0) or actuator == "bars"
    assert result.passive_metrics.ride_lateral_ms2 > 0.0
