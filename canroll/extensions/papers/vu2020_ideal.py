"""Vu et al. 2020: the ideal law on all states of a linear car, and its compensator."""

import numpy as np

from canroll.extensions.papers.paper_table import PaperSection, Value
from canroll.gain_gen.models.full_car import INPUT_WEIGHT, ROLL, STEER, full_car_model, ideal_gain
from canroll.gain_gen.models.roll import zero_order_hold
from canroll.report.figure import DASHED, DOTTED, SOLID, Figure, Series
from canroll.runs.metrics import peak, rms
from canroll.runs.result import Result
from canroll.typing import Vector
from canroll.vehicles import Vehicle
from canroll.vehicles.full_car import FullCar, from_vehicle
from canroll.vehicles.roll_stiffness import suspension_roll_stiffness

STEP = 0.001
LAWS = ("without control", "ideal, 26 states", "compensator")


def linear_states(
    car: FullCar, steer: Vector, speed: float, weight: float | None
) -> tuple[Vector, Vector]:
    """Return the scaled states (n, 26) and the valve currents (A), (n, 2), each millisecond.

    Args:
        car: with hydraulic bars.
        steer: road-wheel angle each millisecond, rad.
        speed: m/s.
        weight: of the currents, for u = −K x on all states, in continuous time and without
            delay; None: without control.
    """
    model = full_car_model(car, speed)
    gain, columns = ideal_gain(model, input_weight=weight or INPUT_WEIGHT)
    a = model.a - columns @ gain if weight else model.a
    ahead, held = zero_order_hold(a, model.b[:, [STEER]], STEP)
    states = np.zeros((len(steer), len(a)))
    for k in range(len(steer) - 1):
        states[k + 1] = ahead @ states[k] + held[:, 0] * steer[k]
    currents = -states @ gain.T.astype(np.float64) if weight else np.zeros((len(steer), 2))
    return states, currents


def car_of_run(vehicle: Vehicle) -> FullCar:
    """Return the linear car with hydraulic bars that corresponds to a vehicle of a run."""
    stiffness = suspension_roll_stiffness(vehicle)
    return from_vehicle(vehicle, suspension_stiffness=stiffness, hydraulic=True)


def ideal_law(paper: str, result: Result) -> tuple[PaperSection, Figure]:
    """Return the table and the roll angles of both laws in one lane change."""
    assert result.controlled is not None
    trace = result.controlled
    steer, time = trace.signals["steer"], trace.signals["time"]
    speed = result.settings.speed
    car = car_of_run(result.settings.vehicle)
    outputs = trace.ticks["outputs"] * 1e-3
    ideal = [linear_states(car, steer, speed, weight) for weight in (None, INPUT_WEIGHT)]
    runs = [(states[:, ROLL], currents) for states, currents in ideal]
    runs.append((trace.signals["roll"], outputs))
    rows: list[dict[str, Value]] = [
        {
            "law": label,
            "roll_rms_deg": float(np.degrees(rms(roll))),
            "roll_max_deg": float(np.degrees(peak(roll))),
            "roll_rms_change_percent": float(100 * (rms(roll) / rms(runs[0][0]) - 1)),
            "current_rms_a": rms(currents.ravel()),
            "current_max_a": peak(currents.ravel()),
        }
        for label, (roll, currents) in zip(LAWS, runs, strict=True)
    ]
    section = PaperSection(
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
        "All runs use the steering of the compensator's run; without control the hydraulic bars "
        "are installed but idle. The ideal law is designed for this very car, reads its 26 "
        "states without delay and has unlimited valves; the compensator runs as fixed-point "
        "firmware over the bus, every 10 ms, with the ECU's sensors.",
    )
    dashes = (DASHED, DOTTED, SOLID)
    curves = [
        Series(label, time, np.degrees(roll), colour, dash)
        for colour, (label, (roll, _), dash) in enumerate(zip(LAWS, runs, dashes, strict=True))
    ]
    return section, Figure(
        f"{paper}-ideal", "Ideal law and compensator at 100 km/h: roll angle", "time (s)", "deg",
        curves, unit="s", group=paper, linked=False,
    )  # fmt: skip
