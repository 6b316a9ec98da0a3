"""A manoeuvre: a plan for a vehicle, a speed and a seed."""

import numpy as np

from canroll.plant_sim.driving.drive import ManeuverKind, ManeuverPlan, steady_steer
from canroll.plant_sim.driving.driver import STEER_TABLE
from canroll.vehicles import Vehicle

TABLE_STEP = 1e-3


def weave(
    vehicle: Vehicle, speed: float, _seed: int, *, lateral: float = 3.0, gates: float = 4.0
) -> ManeuverPlan:
    """Steer to left and right at 0.4 Hz for ``lateral`` (m/s²), once for every two gates."""
    frequency = 0.4
    end = 0.5 + 0.5 * gates / frequency
    time = np.arange(0.0, end + 2.0, TABLE_STEP)
    angle = min(steady_steer(vehicle, speed, lateral), vehicle.steering.angle_limit)
    inside = (time >= 0.5) & (time < end)
    table = np.where(inside, angle * np.sin(2 * np.pi * frequency * (time - 0.5)), 0.0)
    return ManeuverPlan(float(time[-1]), kind=STEER_TABLE, table=table, table_step=TABLE_STEP)


WEAVE = ManeuverKind("weave", 70.0, 120.0, "none", weave)
"""Weaving by a steering robot; options lateral (m/s²) and gates."""
