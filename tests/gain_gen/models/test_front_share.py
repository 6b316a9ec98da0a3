"""The front share: what is neutral, the band it keeps, and what the calibration says of it."""

from dataclasses import replace

import pytest

from canroll import vehicles
from canroll.gain_gen.calibration.freeze import calibrate
from canroll.gain_gen.calibration.options import QuantiseOptions
from canroll.gain_gen.calibration.vehicle_part import share_of
from canroll.gain_gen.design import design
from canroll.gain_gen.models.front_share import BAND, LEAST_BAND, MOST, front_share, understeer
from canroll.gain_gen.models.task import Delay, Task
from canroll.vehicles.unladen import unladen

VAN = vehicles.load("van_real")
PRESETS = ("van_real", "suv_2020", "van_2021", "car_2020")


@pytest.mark.parametrize("car", [VAN, unladen(VAN)], ids=["laden", "empty"])
def test_split_as_the_roll_stiffness_the_moment_does_not_steer(car):
    angles = list(understeer(car, VAN.suspension.roll_stiffness_front_share))
    assert len(angles) == 13
    for without, with_control in angles:
        assert with_control == pytest.approx(without, rel=0.006)


@pytest.mark.parametrize("name", PRESETS)
def test_understeer_stays_in_the_band(name):
    car = vehicles.load(name)
    share = front_share(car)
    assert car.suspension.roll_stiffness_front_share <= share <= MOST
    more = []
    for load in (car, unladen(car)):
        for without, with_control in understeer(load, share):
            band = max(BAND * abs(without), LEAST_BAND)
            assert -0.01 * band <= with_control - without <= 1.01 * band
            more.append((with_control - without) / band)
    # it is the largest such share
    assert share == MOST or max(more) == pytest.approx(1.0, abs=0.01)


def test_tyres_that_unequal_loads_do_not_matter_to_get_the_neutral_share():
    tyre = replace(VAN.tyre, cornering_load_slope=0.0, friction_load_slope=0.0)
    car = replace(VAN, tyre=tyre)
    assert front_share(car) == VAN.suspension.roll_stiffness_front_share


def test_the_calibration_states_it_and_printed_gains_come_with_their_own():
    task = Task(vehicle=VAN, delay=Delay.constant(0.02), actuator="bars")
    record, tables = calibrate(design("plain_feedforward", task), QuantiseOptions())
    share = tables["design"]["front_share"]
    assert share == pytest.approx(front_share(VAN), abs=1e-8)
    assert record.schedule_front_share == [round(share_of(task) * 2**30)] * 8
    printed = share_of(replace(task, gains="as_printed"))
    assert printed == VAN.geometry.static_front_share
