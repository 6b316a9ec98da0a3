"""Signals of handling that follow from the recorded ones and the vehicle's data.

All but the sideslip are of the single-track model of ISO 8855, at the middle of each axle. A slip
angle is positive where the wheels point to the left of their way, so that its force does too.
"""

import numpy as np

from canroll.report.curves import CurveQuantity
from canroll.typing import Vector
from vehicles import Vehicle


def derived(vehicle: Vehicle) -> dict[str, tuple[CurveQuantity, str]]:
    """Return quantity and SI unit by name.

    No slip angles where tables of the axles turn the wheels by more than the steering's ratio.
    """
    geometry, axles = vehicle.geometry, vehicle.axles

    def sideslip(vx: Vector, vy: Vector) -> Vector:
        return np.arctan2(vy, vx)

    def slip_front(steer: Vector, vx: Vector, vy: Vector, yaw_rate: Vector) -> Vector:
        return steer - np.arctan2(vy + geometry.cg_to_front_axle * yaw_rate, vx)

    def slip_rear(vx: Vector, vy: Vector, yaw_rate: Vector) -> Vector:
        return -np.arctan2(vy - geometry.cg_to_rear_axle * yaw_rate, vx)

    def understeer(steer: Vector, vx: Vector, yaw_rate: Vector) -> Vector:
        return steer - np.arctan2(geometry.wheelbase * yaw_rate, vx)

    def steering_wheel(steer: Vector) -> Vector:
        return steer * vehicle.steering.ratio

    motion = ("vx", "vy", "yaw_rate")
    quantities = {
        "steering_wheel_angle": CurveQuantity(("steer",), steering_wheel),
        "sideslip": CurveQuantity(("vx", "vy"), sideslip),
        "understeer_angle": CurveQuantity(("steer", "vx", "yaw_rate"), understeer),
    }
    if axles is None or not (axles.moves_wheels or axles.front.steering):
        quantities |= {
            "slip_angle_front": CurveQuantity(("steer", *motion), slip_front),
            "slip_angle_rear": CurveQuantity(motion, slip_rear),
        }
    return {name: (quantity, "rad") for name, quantity in quantities.items()}
