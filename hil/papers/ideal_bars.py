"""Vu 2020: the ideal law on all 26 states beside the compensator that an ECU can run.

The linear car is driven by the steering of the compensator's run; what differs is the law alone.
"""

import numpy as np

from gain_gen.models.full_car import ROLL, STEER, full_car_model, ideal_gain
from gain_gen.models.roll import zero_order_hold
from hil.papers.section import Section, Value
from hil.report.figure import DASHED, DOTTED, SOLID, Figure, Series
from hil.runs.metrics import Vector, peak, rms
from hil.runs.result import Result
from plant_sim.bodies.parameters import suspension_roll_stiffness
from vehicles.full_car import FullCar, from_vehicle

STEP = 0.001
LABELS = ("without control", "ideal, 26 states", "compensator")


def linear_run(
    car: FullCar, steer: Vector, speed: float, *, controlled: bool
) -> tuple[Vector, Vector]:
    """Return roll angle (rad) and valve currents (A), (n,) and (n, 2), each millisecond.

    Args:
        car: with hydraulic bars.
        steer: road-wheel angle each millisecond, rad.
        speed: m/s.
        controlled: u = −K x on all states, in continuous time and without delay.
    """
    model = full_car_model(car, speed)
    gain, columns = ideal_gain(model)
    a = model.a - columns @ gain if controlled else model.a
    ahead, held = zero_order_hold(a, model.b[:, [STEER]], STEP)
    states = np.zeros((len(steer), len(a)))
    for k in range(len(steer) - 1):
        states[k + 1] = ahead @ states[k] + held[:, 0] * steer[k]
    currents = -states @ gain.T if controlled else np.zeros((len(steer), 2))
    return states[:, ROLL], currents


def ideal_beside(paper: str, result: Result) -> tuple[Section, Figure]:
    """Return the table and the roll angles of both laws in one lane change."""
    assert result.controlled is not None
    trace = result.controlled
    steer, time = trace.signals["steer"], trace.signals["time"]
    speed = result.settings.speed
    vehicle = result.settings.vehicle
    car = from_vehicle(
        vehicle, suspension_stiffness=suspension_roll_stiffness(vehicle), hydraulic=True
    )
    outputs = trace.ticks["outputs"] * 1e-3
    runs = (
        linear_run(car, steer, speed, controlled=False),
        linear_run(car, steer, speed, controlled=True),
        (trace.signals["roll"], outputs),
    )
    rows: list[dict[str, Value]] = [
        {
            "law": label,
            "roll_rms_deg": float(np.degrees(rms(roll))),
            "roll_max_deg": float(np.degrees(peak(roll))),
            "roll_rms_change_percent": float(100 * (rms(roll) / rms(runs[0][0]) - 1)),
            "current_rms_a": rms(currents.ravel()),
            "current_max_a": peak(currents.ravel()),
        }
        for label, (roll, currents) in zip(LABELS, runs, strict=True)
    ]
    section = Section(
        "ideal_law",
        "The ideal law and its compensator, lane change at 100 km/h",
        {
            "law": "law",
            "roll_rms_deg": "roll RMS (deg)",
            "roll_max_deg": "roll max (deg)",
            "roll_rms_change_percent": "change (%)",
            "current_rms_a": "current RMS (A)",
            "current_max_a": "current max (A)",
        },
        rows,
        "All under the steering of the compensator's run; without control the hydraulic bars are "
        "in the car and idle. The ideal law is designed on this very car, reads its 26 states at "
        "once and has valves without limits; the compensator runs as fixed-point "
        "firmware over the bus, every 10 ms, on what the ECU's sensors read.",
    )
    dashes = (DASHED, DOTTED, SOLID)
    curves = [
        Series(label, time, np.degrees(roll), colour, dash)
        for colour, (label, (roll, _), dash) in enumerate(zip(LABELS, runs, dashes, strict=True))
    ]
    return section, Figure(
        f"{paper}-ideal", "Ideal law and compensator at 100 km/h: roll angle", "time (s)", "deg",
        curves, unit="s", group=paper, linked=False,
    )  # fmt: skip
