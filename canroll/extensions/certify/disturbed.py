"""Bounds of what steering and a bank of the road do to a condition.

Steering is any angle that changes at ticks, as fast as it likes; what the ECU reads of it, at
whatever age, is a separate input. The bank is a roll moment on the body.
"""

import numpy as np

from canroll.extensions.certify.claim import MOMENT, READ, STEERING
from canroll.firmware.calibration import Q_ACCELERATION, Q_SPEED, Calibration
from canroll.firmware.schedule import schedule
from canroll.firmware.state import RX_VEHICLE_MOTION, Ecu
from canroll.gain_gen.analysis.family import Member
from canroll.gain_gen.models.controller import Y_LATERAL
from canroll.gain_gen.models.task import Task
from canroll.vehicles import GRAVITY

LATERAL = (4.0, 2.0, 1.0, 0.5, 0.25)
"""Steady lateral accelerations by steering that are tried, m/s²."""
BANK = 0.05
"""Bank of the road, rad."""
UNIT = 1 << 20
"""Steering angle of which the ECU computes the gain of its schedule, with so many fractions."""


def disturbances(
    member: Member, task: Task, record: Calibration, lateral: float
) -> dict[int, float]:
    """Return the bound of each input of a condition besides the command.

    Args:
        member: the condition.
        task: its vehicle and the resolution of the bus.
        record: the calibration, with the schedule that the ECU computes its reading by.
        lateral: steady lateral acceleration that the steering makes at most, m/s².
    """
    vehicle = task.vehicle
    bank = vehicle.design.roll_arm * GRAVITY * BANK
    car, speed = member.plant, member.condition.speed
    steady = -float(car.measured[Y_LATERAL] @ np.linalg.solve(car.a, car.steering)[:, 0])
    if not steady:  # of a roll model, where a_y is a moment
        return {MOMENT: bank + vehicle.design.roll_arm * lateral}
    angle = lateral / abs(steady)
    step = task.resolution.steering if task.resolution else 0.0
    wheel = (angle * vehicle.steering.ratio + 0.5 * step) * (1 << Q_ACCELERATION) + 1.0
    read = abs(steering_gain(record, speed)) * wheel + 1.0
    return {MOMENT: bank, STEERING: angle, READ: read}


def steering_gain(record: Calibration, speed: float) -> float:
    """Return what the ECU multiplies a steering-wheel angle by at a speed (m/s), m/s²/rad."""
    ecu = Ecu()
    ecu.speed = round(speed * (1 << Q_SPEED))
    ecu.steering = UNIT
    ecu.fresh[RX_VEHICLE_MOTION] = 1
    schedule(ecu, record)
    return ecu.steering_acceleration / UNIT
