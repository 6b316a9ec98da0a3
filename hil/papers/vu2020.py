"""Vu et al. 2020: LQR of a full car with electro-hydraulic anti-roll bars."""

import numpy as np

from canroll.typing import Progress, Vector
from gain_gen.models.full_car import (
    INPUT_WEIGHT,
    ROLL,
    SPEED,
    STEER,
    full_car_model,
    ideal_gain,
    reductions,
)
from gain_gen.models.roll import zero_order_hold
from hil.papers.paper_runs import Case, Recomputed, cycle_reason, drive, force_rms, plots
from hil.papers.paper_table import Row, Section, Value, printed
from hil.report.figure import DASHED, DOTTED, SOLID, Figure, Series
from hil.runs.metrics import peak, rms
from hil.runs.result import Result
from vehicles.full_car import AS_PRINTED, REPAIRED, FullCar, from_vehicle
from vehicles.roll_stiffness import suspension_roll_stiffness

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
        "All runs use the steering of the compensator's run; without control the hydraulic bars "
        "are installed but idle. The ideal law is designed for this very car, reads its 26 "
        "states without delay and has unlimited valves; the compensator runs as fixed-point "
        "firmware over the bus, every 10 ms, with the ECU's sensors.",
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


PAPER = "vu2020"
TITLE = "Vu et al. 2020: LQR of electro-hydraulic anti-roll bars"
COMMON = {
    "vehicle": "car_2020",
    "plant": "linear_car",
    "actuator": "valves",
    "law": "lqr_full_car",
    "trigger": "every",
}
FORCES = {"fz1": "front_left", "fz2": "rear_left", "fz3": "rear_right", "fz4": "front_right"}
BODE = {
    "roll": "roll_db",
    "roll_rate": "roll_rate_db",
    "z1": "hop_fl_db",
    "z2": "hop_rl_db",
    "force_front_left": "hop_fl_db",
    "force_rear_left": "hop_rl_db",
    "force_front_right": "hop_fl_db",
    "force_rear_right": "hop_rl_db",
}
INTERNAL = (
    "the torque of a bar is internal to the car: the moment balance determines the total load "
    "transfer of both axles, and bars only shift it between them; a reduction like the printed "
    "one would need a torque without reaction. For the car as printed, the closest result, "
    "{roads:.1f} dB, is obtained with feedback on the four road inputs as well, as the paper's B "
    "= [B1, B2] suggests and no actuator can provide"
)
WEIGHTS = (
    "units are not printed: with pressures in Pa the weights leave the bars idle; with MPa and "
    "the printed current weight of 1, roll falls by {printed:.1f} dB and the valves would need "
    "hundreds of amperes; the weight used here is {weight:g}"
)
BARS = (
    "the compensator uses the inertial sensors, not 26 measured states; the units of the paper's "
    "weights are not printed: pressures are in MPa here, and the weight of the currents is "
    f"{INPUT_WEIGHT:g}"
)
DRIVER = (
    "one driver and course for all speeds, calibrated at 100 km/h; those of the paper are not "
    "printed"
)
TRANSFER = (
    "the moment balance determines the total load transfer: bars can only shift it between the "
    "axles; the printed reduction would need a torque without reaction"
)


def recompute(report: Progress) -> Recomputed:
    """Return every number of Tables 3, 4 and 5."""
    tables = printed(PAPER)
    found = frequency_domain(tables["reduction_db_at_1_rad_s"])
    lane_change = tables["double_lane_change"]
    speeds = [float(speed) for speed in lane_change["speed"]]
    results = drive(
        "double_lane_change",
        [Case(f"{speed:g} km/h", {"speed_kmh": speed}) for speed in speeds],
        COMMON,
        report,
    )
    for place, speed in enumerate(speeds):
        found += _at_speed(lane_change, place, results[f"{speed:g} km/h"])
    at_100 = results["100 km/h"]
    assert at_100.reduction is not None
    found.append(
        Row(
            PAPER,
            "Figure 6, double lane change",
            "100 km/h",
            "roll_max_reduction_percent",
            float(lane_change["roll_max_reduction_percent_at_100"]),
            100 * at_100.reduction,
            finding=cycle_reason(at_100) or BARS,
        )
    )
    section, roll = ideal_beside(PAPER, at_100)
    figures = [*plots(PAPER, "Lane change", results), *_at_100(at_100), roll]
    return Recomputed(sorted(found, key=lambda row: row.table), figures, [section])


def _at_100(result: Result) -> list[Figure]:
    """Figures 5, 7 and 8 of the paper: valve currents, path and steering at 100 km/h."""
    assert result.controlled is not None
    passive, active = result.passive.signals, result.controlled.signals
    ticks = result.controlled.ticks
    currents = [
        Series(
            f"{axle} axle", ticks["t"], ticks["outputs"][:, place] * 1e-3, 1 + place, kind="step"
        )
        for place, axle in enumerate(("front", "rear"))
    ]
    runs = (("without control", passive, 0, DASHED), ("LQR", active, 1, SOLID))
    paths = [Series(name, s["x"], s["y"], colour, dash) for name, s, colour, dash in runs]
    steering = [
        Series(name, s["time"], np.degrees(s["steer"]), colour, dash)
        for name, s, colour, dash in runs
    ]
    return [
        Figure(f"{PAPER}-currents", "Valve currents at 100 km/h", "time (s)", "A", currents,
               unit="s", group=PAPER, linked=False),
        Figure(f"{PAPER}-path", "Path at 100 km/h", "forward (m)", "left (m)", paths,
               unit="m", group=PAPER, linked=False, equal=True),
        Figure(f"{PAPER}-steering", "Steering at 100 km/h", "time (s)", "deg at the wheels",
               steering, unit="s", group=PAPER, linked=False),
    ]  # fmt: skip


def frequency_domain(numbers: dict[str, float]) -> list[Row]:
    """Table 3: the ideal 26-state law on the linear car, from the steering at 1 rad/s."""
    model = full_car_model(REPAIRED, SPEED)
    ours = reductions(model, *ideal_gain(model))
    unweighted = reductions(model, *ideal_gain(model, input_weight=1.0))
    as_printed = full_car_model(AS_PRINTED, SPEED)
    roads = reductions(as_printed, *ideal_gain(as_printed, input_weight=1.0, roads=True))
    found = []
    for quantity, value in numbers.items():
        name = BODE[quantity]
        internal = name.startswith("hop")
        reason = (
            INTERNAL.format(roads=roads[name])
            if internal
            else WEIGHTS.format(printed=unweighted[name], weight=INPUT_WEIGHT)
        )
        found.append(
            Row(
                PAPER,
                "Table 3, from the steering at 1 rad/s",
                "LQR",
                f"{quantity}_db",
                value,
                ours[name],
                finding=reason,
            )
        )
    return found


def _at_speed(lane_change: dict[str, list[float]], place: int, result: Result) -> list[Row]:
    """Tables 4 and 5 at one speed."""
    row = f"{lane_change['speed'][place]:g} km/h"
    metrics = result.controlled_metrics
    assert metrics is not None and result.controlled is not None
    passive, active = result.passive_metrics.roll_rms_deg, metrics.roll_rms_deg
    reason = cycle_reason(result)
    found = [
        Row(
            PAPER, "Table 4, double lane change", f"{row}, passive", "roll_rms",
            lane_change["roll_rms_passive"][place], passive, f"roll_rms.{row}", DRIVER,
            calibrated=row == "100 km/h",
        ),
        Row(
            PAPER, "Table 4, double lane change", f"{row}, LQR", "roll_rms",
            lane_change["roll_rms_lqr"][place], active, f"roll_rms.{row}", reason or BARS,
        ),
        Row(
            PAPER, "Table 4, double lane change", row, "roll_rms_reduction_percent",
            lane_change["roll_rms_reduction_percent"][place], 100 * (1 - active / passive),
            finding=reason or BARS,
        ),
    ]  # fmt: skip
    before, after = force_rms(result.passive), force_rms(result.controlled)
    for force, wheel in FORCES.items():
        ours = 100 * (1 - after[wheel] / before[wheel])
        value = lane_change["force_rms_reduction_percent"][force][place]  # type: ignore[call-overload]
        found.append(
            Row(
                PAPER,
                "Table 5, double lane change",
                row,
                f"{force}_rms_reduction_percent",
                value,
                ours,
                finding=TRANSFER,
            )
        )
    return found
