"""Signals of handling that follow from the recorded ones and the vehicle's data.

All but the sideslip are of the single-track model of ISO 8855, at the middle of each axle. A slip
angle is positive where the wheels point to the left of their way, so that its force does too.
"""

import numpy as np

from canroll.report.curves import CurveQuantity, signal
from vehicles import Vehicle


def derived(vehicle: Vehicle) -> dict[str, tuple[CurveQuantity, str]]:
    """Return quantity and SI unit by name.

    No slip angles where tables of the axles turn the wheels by more than the steering's ratio.
    """
    ahead, behind = vehicle.geometry.cg_to_front_axle, vehicle.geometry.cg_to_rear_axle
    axles, motion = vehicle.axles, ("vx", "vy", "yaw_rate")
    quantities = {
        "steering_wheel_angle": signal("steer", vehicle.steering.ratio),
        "sideslip": CurveQuantity(("vx", "vy"), lambda vx, vy: np.arctan2(vy, vx)),
        "understeer_angle": CurveQuantity(
            ("steer", "vx", "yaw_rate"),
            lambda steer, vx, rate: steer - np.arctan2((ahead + behind) * rate, vx),
        ),
    }
    if axles is None or not (axles.moves_wheels or axles.front.steering):
        quantities["slip_angle_front"] = CurveQuantity(
            ("steer", *motion),
            lambda steer, vx, vy, rate: steer - np.arctan2(vy + ahead * rate, vx),
        )
        quantities["slip_angle_rear"] = CurveQuantity(
            motion, lambda vx, vy, rate: np.arctan2(behind * rate - vy, vx)
        )
    return {name: (quantity, "rad") for name, quantity in quantities.items()}
