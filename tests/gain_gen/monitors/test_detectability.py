"""The least sizes of faults, against the firmware's own residuals."""

import pytest

from firmware import calibration as fw
from firmware.calibration import Calibration
from firmware.monitors.residuals import watch_residuals
from firmware.state import FIRST_FRAME, RX_ACTUATOR_STATE, RX_IMU, RX_SUSPENSION_RATE, Ecu
from gain_gen.calibration.record import fill
from gain_gen.calibration.residual_part import residual_fields
from gain_gen.models.task import Delay, Task
from gain_gen.monitors.detectability import FAULTS, TOLERATED, least, limits
from gain_gen.monitors.residuals import bank_of
from gain_gen.monitors.uncertainty import Uncertainty
from vehicles import load

TICK = 0.01
SETTLED = 6000


def designed(name="van_real", actuator="bars"):
    task = Task(load(name), Delay.constant(0.02), tick=TICK, actuator=actuator)
    return task, bank_of(task, Uncertainty(), suspension=True, moments=True)


def moving(cal: Calibration) -> Ecu:
    ecu = Ecu()
    ecu.gain_factor, ecu.motion_lost, ecu.moment_unknown = 1 << 28, 0, 0
    ecu.enabled = ecu.command_held = 1
    ecu.valid[RX_IMU], ecu.valid[RX_SUSPENSION_RATE], ecu.valid[RX_ACTUATOR_STATE] = 7, 15, 3
    return ecu


def raised(cal: Calibration, row: int, fault: str, size: float) -> bool:
    """Whether a residual is raised by a constant fault in straight running, in time."""
    ecu = moving(cal)
    for tick in range(SETTLED + round(TOLERATED / TICK) + 1):
        value = size if tick > SETTLED else 0.0
        ecu.fresh[RX_SUSPENSION_RATE] = FIRST_FRAME
        ecu.rate_sample = tick & 15
        if fault == "lateral acceleration":
            ecu.lateral_acceleration = round(value * 2**fw.Q_ACCELERATION)
        elif fault == "roll rate":
            ecu.roll_rate = round(value * 2**fw.Q_RATE)
        else:
            ecu.delivered[0 if fault == "front moment" else 1] = round(value * 2**fw.Q_MOMENT)
        watch_residuals(ecu, cal, 1)
        if abs(ecu.residual_count[row]) == cal.residual_ticks[row]:
            return True
    return False


@pytest.mark.parametrize("fault", ["front moment", "lateral acceleration", "roll rate"])
def test_a_fault_above_its_limit_is_found_and_one_below_is_not(fault):
    task, bank = designed()
    cal = fill(residual_fields(bank, 0.01))
    cal.timeout_ticks = [5, 10, 5, 5, 0]
    names = [residual.name for residual in bank.residuals]
    seen = [limit for limit in limits(bank, task.vehicle) if limit.fault.name == fault]
    limit = min(seen, key=lambda limit: limit.straight)
    row = names.index(limit.residual)
    # a sample beyond the double counts twice: nothing here is
    assert raised(cal, row, fault, 1.2 * limit.straight)
    assert not raised(cal, row, fault, 0.8 * limit.straight)


@pytest.mark.parametrize("name", ["van_real", "suv_2020", "sedan_320i", "van_2021", "car_2020"])
def test_a_manoeuvre_hides_more_than_a_straight_road(name):
    task, bank = designed(name, "suspension")
    table = limits(bank, task.vehicle)
    for fault in FAULTS:
        straight, slalom = least(table, fault.name)
        assert 0.0 < straight <= slalom


def test_the_signs_of_two_residuals_tell_the_axles_apart():
    task, bank = designed()
    sides = {(limit.fault.name, limit.residual): limit.side for limit in limits(bank, task.vehicle)}
    assert sides["front moment", "body, fast"] == sides["front moment", "axles"]
    assert sides["rear moment", "body, fast"] == -sides["rear moment", "axles"]
    assert ("roll rate", "axles") not in sides
