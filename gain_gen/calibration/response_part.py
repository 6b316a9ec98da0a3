"""Calibration of the response monitor: the body's roll by what acts on it, suspension measured.

Numbers come from fault-free runs, as those of :mod:`gain_gen.calibration.monitor_part`.
"""

from math import pi

from firmware import calibration as fw
from gain_gen.calibration.rows import quantise
from gain_gen.models.task import Task
from vehicles.roll_stiffness import axle_roll_shares, suspension_roll_stiffness

LEAST = 0.8
"""What may always be left over: the roll moment m h a_y of this lateral acceleration, m/s²."""
LASTING = 0.2
"""How long too much is left over without a break, s."""
LOW_PASS = 0.05
"""Time constant of the low-pass, s."""
WASHOUT = 0.2
"""Corner of the washout, Hz."""


def response_fields(task: Task) -> dict[str, int | list[int]]:
    """Return the fields of the response monitor, of bars or of corner forces.

    Springs and dampers of both axles count by the springs' shares, with one time constant.

    Raises:
        CanrollError: a coefficient is outside its field's range; the message names it.
    """
    vehicle, roll = task.vehicle, task.vehicle.design
    stiffness = suspension_roll_stiffness(vehicle)
    tracks = 2.0 * vehicle.geometry.half_track_front, 2.0 * vehicle.geometry.half_track_rear

    def coefficient(value: float, name: str) -> int:
        return quantise(value, 10, 0, fw.COEFFICIENT, name=name)

    return {
        "response_min": round(LEAST * roll.roll_arm * 2.0**fw.Q_MOMENT),
        "response_ticks": max(2, round(LASTING / task.tick)),
        "response_stroke": [
            coefficient(share * roll.roll_damping / track, "response_stroke")
            for share, track in zip(axle_roll_shares(vehicle), tracks, strict=True)
        ],
        "response_stretch": quantise(
            task.tick * stiffness / roll.roll_damping, 30, 0, fw.ONE, name="response_stretch"
        ),
        "response_lateral": coefficient(roll.roll_arm, "response_lateral"),
        "response_inertia": coefficient(roll.roll_inertia / LOW_PASS, "response_inertia"),
        "response_pass": round(task.tick / LOW_PASS * fw.ONE),
        "response_wash": round(2.0 * pi * WASHOUT * task.tick * fw.ONE),
    }
