"""Vu et al. 2020: LQR of a full car with electro-hydraulic anti-roll bars."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from canroll.extensions.papers.conditions import (
    IDEAL_SENSORS,
    Chain,
    errata,
    erratum,
    number,
    unknowns,
    waterfall,
)
from canroll.extensions.papers.paper_runs import Headline, PaperCase, Recomputed, drive, plots
from canroll.extensions.papers.paper_table import PaperRow, PaperSection, PaperStep, Value, printed
from canroll.extensions.papers.vu2020_ideal import car_of_run, ideal_law, linear_states
from canroll.gain_gen.models.full_car import (
    INPUT_WEIGHT,
    ROLL,
    SPEED,
    full_car_model,
    ideal_gain,
    reductions,
    weights,
)
from canroll.report.figure import DASHED, SOLID, Figure, Series
from canroll.runs.metrics import peak, rms
from canroll.runs.result import Result
from canroll.runs.trace import Trace
from canroll.typing import Vector
from canroll.vehicles import GRAVITY
from canroll.vehicles.full_car import AS_PRINTED, REPAIRED, STATES, FullCar

PAPER = "vu2020"
TITLE = "Vu et al. 2020: LQR of electro-hydraulic anti-roll bars"
COMMON = {
    "vehicle": "car_2020",
    "plant": "linear_car",
    "actuator": "valves",
    "law": "lqr_full_car",
    "trigger": "every",
}
HOPS = {"front_left": "fl", "front_right": "fr", "rear_left": "rl", "rear_right": "rr"}
SIDES = {"front_left": -1.0, "rear_left": -1.0, "front_right": 1.0, "rear_right": 1.0}
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
SAME_TABLE = replace(AS_PRINTED, valves=REPAIRED.valves)
"""Table 2, and Table 1 without those misprints with which the bars are idle."""
STEPS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("compensator, ECU and bus", {"conditions": IDEAL_SENSORS}),
    ("sensor noise, bias, filter, latency", {}),
)
WEIGHT = "weight of the currents"
ROADS = "B = [B1, B2], feedback also on the four road inputs"
BARS = "feedback on the two currents, weight fitted"


def fitted_weight(roll_db: float) -> float:
    """Return the weight of a current squared that gives a reduction of the roll angle, dB."""
    model = full_car_model(REPAIRED, SPEED)

    def off(exponent: float) -> float:
        gain = ideal_gain(model, input_weight=10**exponent)
        return reductions(model, *gain)["roll_db"] - roll_db

    return float(10 ** brentq(off, 2.0, 6.0, xtol=1e-6))


def recompute() -> Recomputed:
    """Return every number of Tables 3, 4 and 5."""
    tables = printed(PAPER)
    weight = fitted_weight(tables["reduction_db_at_1_rad_s"]["roll"])
    rows = frequency_domain(tables["reduction_db_at_1_rad_s"], weight)
    lane_change = tables["double_lane_change"]
    speeds = [float(speed) for speed in lane_change["speed"]]
    cases = [PaperCase(f"{speed:g} km/h", {"speed_kmh": speed}) for speed in speeds]
    runs = {name: drive("double_lane_change", cases, {**COMMON, **more}) for name, more in STEPS}
    ours = runs[STEPS[-1][0]]
    for place, case in enumerate(cases):
        chain = _chain({name: results[case.row] for name, results in runs.items()}, weight)
        rows += _at_speed(lane_change, place, chain)
    at_100 = ours["100 km/h"]
    section, roll = ideal_law(PAPER, at_100)
    figures = [*plots(PAPER, "Lane change", ours), *_at_100(at_100), roll]
    rows.sort(key=lambda row: row.table)
    proofs = [errata(checks(at_100)), unknowns(_unknowns(weight)), _waterfall(rows)]
    headlines = [
        Headline(
            "Table 4, double lane change", f"{case.row}, passive", f"{case.row}, LQR", "roll_rms"
        )
        for case in cases
    ]
    return Recomputed(rows, figures, proofs, [readings(weight), section], headlines)


def of_lane_change(
    passive: Mapping[str, Vector], active: Mapping[str, Vector]
) -> Callable[[str], float]:
    """Return the figures of Tables 4 and 5 from roll angle (deg) and tyre loads, without and with.

    Args:
        passive: "roll", and the change of each tyre's load by wheel.
        active: the same with control.
    """

    def figure(quantity: str) -> float:
        if quantity == "roll_rms_passive":
            return rms(passive["roll"])
        if quantity == "roll_rms_lqr":
            return rms(active["roll"])
        name, kind = quantity.rsplit("_", 3)[0], quantity.rsplit("_", 3)[1]
        signal = FORCES.get(name, name)
        value = peak if kind == "max" else rms
        return 100 * (1 - value(active[signal]) / value(passive[signal]))

    return figure


def _signals(trace: Trace) -> dict[str, Vector]:
    signals = trace.signals
    loads = {wheel: signals[f"wheel_load_{wheel}"] for wheel in FORCES.values()}
    return {
        "roll": np.degrees(signals["roll"]),
        **{wheel: load - load[0] for wheel, load in loads.items()},
    }


def _linear(car: FullCar, steer: Vector, speed: float, weight: float | None) -> dict[str, Vector]:
    states, _ = linear_states(car, steer, speed, weight)
    return {
        "roll": np.degrees(states[:, ROLL]),
        **{
            wheel: car.tyre_stiffness * states[:, STATES.index(f"hop_{short}")]
            for wheel, short in HOPS.items()
        },
    }


def _chain(runs: Mapping[str, Result], weight: float) -> Chain:
    """Return one speed under the paper's conditions, with our weight, and through the ECU."""
    settings, passive = next((run.settings, run.passive) for run in runs.values())
    car, steer = car_of_run(settings.vehicle), passive.signals["steer"]
    free = _linear(car, steer, settings.speed, None)
    ideal = [
        of_lane_change(free, _linear(car, steer, settings.speed, value))
        for value in (weight, INPUT_WEIGHT)
    ]
    through_ecu = []
    for name, run in runs.items():
        assert run.controlled is not None
        figures = of_lane_change(_signals(run.passive), _signals(run.controlled))
        through_ecu.append((name, figures))
    return Chain(ideal[0], [(WEIGHT, ideal[1]), *through_ecu])


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


def _reductions(car: FullCar, weight: float, *, roads: bool = False) -> dict[str, float]:
    model = full_car_model(car, SPEED)
    return reductions(model, *ideal_gain(model, input_weight=weight, roads=roads))


def frequency_domain(numbers: Mapping[str, float], weight: float) -> list[PaperRow]:
    """Table 3: the ideal 26-state law on the linear car, from the steering at 1 rad/s.

    No reading of the paper gives all of it: roll by the fitted ``weight`` of the currents, the
    wheels by feedback on the road inputs as (13) to (15) are printed.
    """
    bars = _reductions(REPAIRED, weight)
    ours = _reductions(REPAIRED, INPUT_WEIGHT)
    roads = _reductions(SAME_TABLE, 1.0, roads=True)
    rows = []
    for quantity, value in numbers.items():
        name = BODE[quantity]
        internal = name.startswith("hop")
        steps = [PaperStep("feedback on the currents alone", bars[name])] if internal else []
        rows.append(
            PaperRow(
                PAPER,
                "Table 3, from the steering at 1 rad/s",
                "LQR",
                f"{quantity}_db",
                value,
                roads[name] if internal else bars[name],
                ours[name],
                finding="E1 and E2: only with actuators in the road" if internal else "E3",
                fitted=quantity == "roll",
                reading=ROADS if internal else BARS,
                attribution=(*steps, PaperStep(WEIGHT, ours[name])),
            )
        )
    return rows


def _at_speed(lane_change: Mapping[str, Any], place: int, chain: Chain) -> list[PaperRow]:
    """Tables 4 and 5, and the largest roll angle of figure 9, at one speed."""
    speed = f"{lane_change['speed'][place]:g} km/h"
    table = "Table 4, double lane change"
    course = "course, driver and CarSim car not printed"
    rows = [
        PaperRow(
            PAPER, table, f"{speed}, {words}", "roll_rms", lane_change[key][place],
            **chain.columns(key), group=f"roll_rms.{speed}", finding=course,
            fitted=(speed, words) == ("100 km/h", "passive"),
        )
        for words, key in (("passive", "roll_rms_passive"), ("LQR", "roll_rms_lqr"))
    ]  # fmt: skip
    lone = [(table, "roll_rms_reduction_percent", lane_change["roll_rms_reduction_percent"][place])]
    lone += [
        ("Table 5, double lane change", f"{force}_rms_reduction_percent", values[place])
        for force, values in lane_change["force_rms_reduction_percent"].items()
    ]
    if speed == "100 km/h":
        value = float(lane_change["roll_max_reduction_percent_at_100"])
        lone.append(("Figure 9, double lane change", "roll_max_reduction_percent", value))
    rows += [
        PaperRow(
            PAPER, table, speed, quantity, value, **chain.columns(quantity),
            finding="E1: the bars are inside the car" if quantity.startswith("fz") else course,
        )
        for table, quantity, value in lone
    ]  # fmt: skip
    return rows


def checks(result: Result) -> list[Mapping[str, Value]]:
    """Return the claims of the paper that its own numbers contradict.

    Args:
        result: lane change at 100 km/h.
    """
    signals = result.passive.signals
    geometry = result.settings.vehicle.geometry
    half = geometry.half_track_front
    assert result.controlled is not None
    moments = []
    for trace in (result.passive, result.controlled):
        loads = _signals(trace)
        moments.append(rms(half * np.sum([y * loads[wheel] for wheel, y in SIDES.items()], axis=0)))
    _, currents = linear_states(REPAIRED, signals["steer"], result.settings.speed, 1.0)
    roads, printed_tyre = _reductions(SAME_TABLE, 1.0, roads=True), AS_PRINTED.tyre_stiffness
    static = AS_PRINTED.mass * GRAVITY / 4 / printed_tyre
    inertia = AS_PRINTED.roll_inertia + AS_PRINTED.pitch_inertia
    return [
        erratum(
            "tyre loads fall by 28 to 30 dB (Table 3), 33 to 38 % (Table 5)",
            "t Σ ± F_z = m a_y h + m_s g h φ: a bar's torque is internal and cancels",
            f"RMS moment of all tyre loads at 100 km/h: {number(moments[0])} N·m without, "
            f"{number(moments[1])} with control",
        ),
        erratum(
            "B = [B1, B2] in (13) to (15)",
            "LQR with the four road heights as inputs, Table 2, printed weights",
            f"wheels {number(roads['hop_fl_db'])} and {number(roads['hop_rl_db'])} dB "
            f"(printed 27.8, 30.5), but roll {number(roads['roll_db'])} instead of 4.3 dB; the "
            "road is no actuator",
        ),
        erratum(
            "ρ = 1 for every current and pressure",
            "unit of the pressure in Q",
            f"in Pa the bars go slack and roll rises by {number(-_pascal()['roll_db'])} dB; in "
            f"MPa it falls by {number(_reductions(REPAIRED, 1.0)['roll_db'])} dB with "
            f"up to {number(peak(currents.ravel()))} A in the lane change at 100 km/h",
        ),
        erratum(
            f"tyre {printed_tyre:g} N/m",
            "m g/(4 k_t)",
            f"{number(100 * static)} cm of static deflection",
        ),
        erratum(
            f"I_xx, I_yy, I_zz = {AS_PRINTED.roll_inertia:g}, {AS_PRINTED.pitch_inertia:g}, "
            f"{AS_PRINTED.yaw_inertia:g} kg·m²",
            "I_xx + I_yy ≥ I_zz of any rigid body",
            f"{inertia:g} < {AS_PRINTED.yaw_inertia:g}",
        ),
    ]


def _pascal() -> dict[str, float]:
    """Return the reductions with the printed weight of 1 on pressures in Pa."""
    model = full_car_model(REPAIRED, SPEED)
    pressures = [i for i, name in enumerate(STATES) if name.startswith("pressure")]
    cost = weights()
    cost[pressures] *= 1e12
    return reductions(model, *ideal_gain(model, input_weight=1.0, state_weights=cost))


def readings(weight: float) -> PaperSection:
    """Return Table 3 under every reading of weights and inputs."""
    cases = (
        (f"currents, weight {number(weight)} (fitted to 4.3 dB)", _reductions(REPAIRED, weight)),
        ("currents, weight 1, pressures in MPa", _reductions(REPAIRED, 1.0)),
        ("currents, weight 1, pressures in Pa", _pascal()),
        ("currents and roads, weight 1, Table 2", _reductions(SAME_TABLE, 1.0, roads=True)),
        ("currents and roads, corrected car", _reductions(REPAIRED, 1.0, roads=True)),
    )
    numbers = printed(PAPER)["reduction_db_at_1_rad_s"]
    as_printed = {"roll_db": numbers["roll"], "roll_rate_db": numbers["roll_rate"]}
    as_printed |= {"hop_fl_db": numbers["z1"], "hop_rl_db": numbers["z2"]}
    columns = {
        "reading": "feedback on",
        "roll_db": "roll (dB)",
        "roll_rate_db": "roll rate (dB)",
        "hop_fl_db": "front wheel (dB)",
        "hop_rl_db": "rear wheel (dB)",
    }
    return PaperSection(
        "readings_of_b",
        "Table 3 by reading",
        columns,
        [{"reading": name, **reductions} for name, reductions in (*cases, ("printed", as_printed))],
        "No reading gives roll and wheels together.",
    )


def _unknowns(weight: float) -> Sequence[tuple[str, str]]:
    return [
        (
            "units of the weights",
            f"pressures in MPa; currents fitted to the 4.3 dB of roll: {number(weight)} per A²",
        ),
        ("stiffness of the bar in series with the motor", "150 N·m/rad"),
        (
            "CarSim car, driver",
            "linear car of 26 states; driver tuned to the passive 1.39° at 100 km/h, which does "
            "not count",
        ),
        ("inputs that the feedback closes", "currents; for the wheels of Table 3 B = [B1, B2]"),
    ]


def _waterfall(rows: Sequence[PaperRow]) -> PaperSection:
    places = [
        (row.table, row.row, row.quantity)
        for row in rows
        if row.table.startswith("Table 4") and row.quantity.startswith("roll_rms")
    ]
    return waterfall(
        rows,
        [place for place in places if "passive" not in place[1]],
        "Each column switches one thing more. The ECU's column includes rounding, tick, sensors "
        "instead of 26 states, and limits of the valves.",
    )
