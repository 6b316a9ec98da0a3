"""Bounds of what steering and a bank of the road do to a condition.

Steering is any angle that changes at ticks, as fast as it likes; what the ECU reads of it, at
whatever age, is a separate input. The bank is a roll moment on the body.
"""

import numpy as np

from firmware.calibration import Q_ACCELERATION
from gain_gen.analysis.family import Member
from gain_gen.certificate.claim import MOMENT, READ, STEERING
from gain_gen.models.controller import Y_LATERAL
from vehicles import GRAVITY, Vehicle

LATERAL = (4.0, 2.0, 1.0, 0.5, 0.25)
"""Steady lateral accelerations by steering that are tried, m/s²."""
BANK = 0.05
"""Bank of the road, rad."""
READ_ROUNDED = 1.01
"""Factor on what the ECU computes from the steering angle, for its resolution."""


def disturbances(member: Member, vehicle: Vehicle, lateral: float) -> dict[int, float]:
    """Return the bound of each input of a condition besides the command.

    Args:
        member: the condition.
        vehicle: of the family.
        lateral: steady lateral acceleration that the steering makes at most, m/s².
    """
    bank = vehicle.design.roll_arm * GRAVITY * BANK
    car, speed = member.plant, member.condition.speed
    steady = -float(car.measured[Y_LATERAL] @ np.linalg.solve(car.a, car.steering)[:, 0])
    if not steady:  # of a roll model, where a_y is a moment
        return {MOMENT: bank + vehicle.design.roll_arm * lateral}
    angle = lateral / abs(steady)
    read = READ_ROUNDED * angle * vehicle.lateral_gain(speed) * (1 << Q_ACCELERATION)
    return {MOMENT: bank, STEERING: angle, READ: read}
