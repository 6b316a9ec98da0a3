"""A lateral acceleration that reverses at the limit: held and lost, and nobody is accused."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.firmware.plausibility import FAULT_ACCELERATION, FAULT_ACTUATOR_CONTRADICTED
from canroll.firmware.state import ACTIVE, DEGRADED, INIT, RX_IMU
from canroll.runs import experiment

AT = 1.33


def codes(trace, fault):
    """The ticks with a fault code."""
    return (trace.ticks["fault_codes"] >> fault & 1) == 1


@pytest.mark.slow
@pytest.mark.parametrize("tick_ms", [2.0, 5.0, 10.0])
def test_one_that_reverses_in_a_j_turn_rolls_no_car(tick_ms):
    settings, controller = experiment.plan(
        "j_turn", law="lqr", actuator="suspension", tick_ms=tick_ms
    )
    faults = (f"Imu.LateralAcceleration=reversed@{AT}",)
    trace = experiment.drive(replace(settings, faults=faults), controller, enabled=True)
    lost = trace.ticks["t"][codes(trace, FAULT_ACCELERATION)][0]
    timeout = controller.record.timeout_ticks[RX_IMU] * tick_ms * 1e-3
    assert timeout < lost - AT < timeout + 0.03
    assert not codes(trace, FAULT_ACTUATOR_CONTRADICTED).any()
    assert set(trace.ticks["mode"]) == {INIT, ACTIVE, DEGRADED}
    assert not trace.signals["envelope"].any()
    assert np.degrees(abs(trace.signals["roll"])).max() < 7.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "manoeuvre"), [("suv_2020", "j_turn"), ("car_2020", "fishhook")]
)
def test_the_quickest_of_manoeuvres_are_within_the_bound(vehicle, manoeuvre):
    settings, controller = experiment.plan(
        manoeuvre, vehicle=vehicle, law="lqr", actuator="suspension"
    )
    trace = experiment.drive(settings, controller, enabled=True)
    assert not codes(trace, FAULT_ACCELERATION).any()
    lateral, record = trace.signals["ay"], controller.record
    for ticks in range(1, record.timeout_ticks[RX_IMU] + 2):
        most = record.acceleration_noise + ticks * record.acceleration_change
        later = 10 * ticks
        assert abs(lateral[later:] - lateral[:-later]).max() < most / 2**24
