"""Redondo, Boada, Díaz 2021: delay-aware and delay-unaware H∞ roll-rate feedback of a van."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from canroll.extensions.papers.conditions import (
    IDEAL_SENSORS,
    Chain,
    Figures,
    errata,
    erratum,
    fitted_scale,
    number,
    of_loop,
    of_result,
    unknowns,
    waterfall,
)
from canroll.extensions.papers.linear_roll import chatter, design_numbers
from canroll.extensions.papers.paper_runs import Headline, PaperCase, Recomputed, drive, plots
from canroll.extensions.papers.paper_table import PaperRow, PaperSection, Value, printed
from canroll.extensions.papers.roll_loop import RollLoop
from canroll.gain_gen.analysis.delay_system import largest_delay
from canroll.gain_gen.laws.hinf_delay import PRINTED_DELAY_GAIN
from canroll.gain_gen.laws.roll_rate_feedback import PRINTED_NO_DELAY_GAIN
from canroll.gain_gen.models.roll import ROLL_RATE, moment_input, state_matrix
from canroll.report.figure import Figure
from canroll.runs.result import Result
from canroll.typing import Vector
from canroll.vehicles import GRAVITY, RollModel, Vehicle

PAPER = "redondo2021"
TITLE = "Redondo, Boada, Díaz 2021: H∞ with input and output delays"
COMMON = {
    "vehicle": "van_2021",
    "plant": "nonlinear",
    "bus": "gateway_50ms",
    "gains": "as_printed",
    "unverified": True,
    "trigger": "every",
}
RADIUS = 22.0
TESTS = (
    ("roundabout_30", "roundabout", 30.0, "Tables 2, 3"),
    ("double_lane_change_100", "double_lane_change", 100.0, "Tables 4, 5"),
    ("roundabout_120", "roundabout", 120.0, "Tables 6, 7"),
)
LAWS = {"delay_aware": "hinf_delay", "delay_unaware": "hinf_nodelay"}
READ_GAINS = {"delay_aware": PRINTED_DELAY_GAIN, "delay_unaware": PRINTED_NO_DELAY_GAIN}
"""N·m·s/rad: −84.06 per degree, −1.29e6 per radian."""
QUANTITIES = ("roll_rms", "roll_max", "nlt_front", "nlt_rear")
FITTED_TO = {
    "roundabout_30": ("roll_max",),
    # by the vehicle file's lane offset
    "double_lane_change_100": ("roll_max",),
    "roundabout_120": (),
}
"""Numbers without control that something was fitted to."""
STEPS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("14-DOF car, ECU and bus", {"conditions": IDEAL_SENSORS}),
    ("sensor noise, bias, filter, latency", {}),
)
HEADLINES = tuple(
    Headline(
        f"{table}, {test.replace('_', ' ')} km/h", "passive", row.replace("_", " "), "roll_rms"
    )
    for test, _, _, table in TESTS[:2]
    for row in LAWS
)

GAINS = (
    "The printed −84.06 is interpreted as per degree and −1.29e6 as per radian, since no units "
    "are printed. The printed level is lower than any roll-rate gain can achieve with the delays "
    "of this network."
)


@dataclass(frozen=True, slots=True)
class Redondo:
    """The paper's conditions: Table 1, constant delay, and a fitted scale of the roll moment."""

    vehicle: Vehicle
    scale: float

    @property
    def delay(self) -> float:
        """h + ρ, s."""
        return float(printed(PAPER)["max_delay_s"])

    @property
    def transfer(self) -> dict[str, float]:
        """Load transfer by the paper's formula K_r φ/(t F_z), per degree of roll."""
        geometry, design = self.vehicle.geometry, self.vehicle.design
        moment = design.roll_stiffness * np.radians(1.0)
        weight, front = design.sprung_mass * GRAVITY, geometry.static_front_share
        return {
            "nlt_front": moment / (geometry.half_track_front * weight * front),
            "nlt_rear": moment / (geometry.half_track_rear * weight * (1 - front)),
        }

    def figures(
        self,
        row: str,
        lateral: Vector,
        *,
        delay: float | None = None,
        model: RollModel | None = None,
    ) -> Figures:
        """Return the figures of a row; ``model``: of the calibrated plant, without the scale."""
        gain = READ_GAINS.get(row)
        loop = RollLoop(
            model or self.vehicle.design,
            feedback=None if gain is None else gain * ROLL_RATE,
            delay=self.delay if delay is None else delay,
        )
        scale = self.scale if model is None else 1.0
        return of_loop(loop, scale * lateral, self.transfer)


def recompute() -> Recomputed:
    """Return every number of Tables 2 to 7."""
    rows: list[PaperRow] = []
    figures: list[Figure] = []
    driven: dict[str, Result] = {}
    theirs: Redondo | None = None
    for test, scenario, speed, table in TESTS:
        cases = [PaperCase(f"{test}, {row}", {"law": law}) for row, law in LAWS.items()]
        runs = {
            name: drive(scenario, cases, {**COMMON, "speed_kmh": speed, **more})
            for name, more in STEPS
        }
        ours = runs[STEPS[-1][0]]
        driven |= ours
        first = next(iter(ours.values()))
        if theirs is None:
            vehicle = first.settings.vehicle
            theirs = Redondo(
                vehicle,
                fitted_scale(
                    vehicle.design,
                    first.passive.signals["ay"],
                    printed(PAPER)[test]["passive"]["roll_max"],
                ),
            )
        for row, numbers in printed(PAPER)[test].items():
            title = f"{table}, {test.replace('_', ' ')} km/h"
            rows += _rows(test, title, row, numbers, runs, theirs)
        if scenario == "double_lane_change":
            figures = plots(PAPER, "Lane change at 100 km/h", ours)
    assert theirs is not None
    proofs = [errata(checks(theirs)), unknowns(_unknowns(theirs)), _waterfall(rows)]
    sections = [
        load_transfer(theirs),
        design_numbers(PAPER, COMMON, tuple(LAWS.values()), GAINS),
        chatter(driven),
    ]
    return Recomputed(rows, figures, proofs, sections, HEADLINES)


def _rows(  # noqa: PLR0917
    test: str,
    table: str,
    row: str,
    numbers: Mapping[str, float],
    runs: Mapping[str, Mapping[str, Result]],
    theirs: Redondo,
) -> list[PaperRow]:
    passive = row == "passive"
    results = [
        (name, next(iter(by_name.values())) if passive else by_name[f"{test}, {row}"])
        for name, by_name in runs.items()
    ]
    last = results[-1][1]
    lateral, delay = last.passive.signals["ay"], last.delay.nominal
    plant = theirs.vehicle.plant
    # what the course alone makes of the number: the row without control against its print
    course = theirs.figures("passive", lateral)("roll_max")
    free = course / printed(PAPER)[test]["passive"]["roll_max"] - 1
    chain = Chain(
        theirs.figures(row, lateral),
        [
            ("delay of our network", theirs.figures(row, lateral, delay=delay)),
            ("calibrated plant", theirs.figures(row, lateral, delay=delay, model=plant)),
            *((name, of_result(result, passive=passive)) for name, result in results),
        ],
    )
    return [
        PaperRow(
            paper=PAPER,
            table=table,
            row=row.replace("_", " "),
            quantity=quantity,
            printed=numbers[quantity],
            **chain.columns(quantity),
            group=f"{test}.{quantity}",
            finding=_reason(test, row, quantity, free),
            fitted=passive and quantity in FITTED_TO[test],
        )
        for quantity in QUANTITIES
    ]


def _reason(test: str, row: str, quantity: str, free: float) -> str:
    """Return the check that explains a difference under the paper's conditions.

    Args:
        test: of the row.
        row: its key.
        quantity: of the row.
        free: largest roll without control against the printed one, as share.
    """
    if row == "delay_unaware":
        return "E2: the printed gain is unstable with the printed delay"
    if test == "roundabout_120":
        return "E5: nobody can drive this test; the car leaves the circle"
    if quantity.startswith("nlt"):
        return "E6: the printed formula with the printed stiffness gives less"
    if test == TESTS[0][0]:
        return "E3: no roll rate, no moment"
    return f"course not printed: on ours the largest roll without control is {100 * free:+.0f} %"


def checks(theirs: Redondo) -> list[Mapping[str, Value]]:
    """Return the claims of the paper that its own numbers contradict."""
    tables, model = printed(PAPER), theirs.vehicle.design
    tests = [tables[test] for test, *_ in TESTS]
    ratio = model.roll_arm / model.effective_stiffness
    level = ratio**2 * (1 + GRAVITY**2)
    most = 1e3 * largest_delay(
        state_matrix(model), moment_input(model), PRINTED_NO_DELAY_GAIN * ROLL_RATE
    )
    slow, fast = ((speed / 3.6) ** 2 / RADIUS for speed in (TESTS[0][2], TESTS[2][2]))
    roll = tests[0]["passive"]["roll_max"], tests[0]["delay_aware"]["roll_max"]
    added = -100 * tables["delay_aware_gain"] / model.roll_damping
    front = [
        numbers["nlt_front"] / numbers["roll_max"]
        for test in tests[:2]
        for numbers in test.values()
    ]
    formula = theirs.transfer
    return [
        erratum(
            f"γ² = {tables['gamma_squared']:g} for both gains",
            "γ² ≥ (m h/(K_r − m g h))² (1 + g²), the static gain, where φ' = 0",
            f"{number(level)}: no roll-rate gain reaches the printed level",
        ),
        erratum(
            f"K = −{-1e-6 * PRINTED_NO_DELAY_GAIN:.2f}·10⁶ with a delay of "
            f"{1e3 * theirs.delay:.0f} ms",
            "largest stable delay ≈ π I_xx/(2 |K|)",
            f"{number(most)} ms: unstable in every test, whatever the unit",
        ),
        erratum(
            f"roundabout: roll {roll[0]:g}° to {roll[1]:g}°",
            "φ = m h a_y/(K_r − m g h) in steady cornering: K φ' = 0",
            "0 % for any roll-rate gain; only entry and exit change",
        ),
        erratum(
            f"K = {number(tables['delay_aware_gain'], 4)}",
            "K/C_r in N·m·s/rad",
            f"adds {number(added)} % of damping, without effect; per degree it is "
            f"{number(PRINTED_DELAY_GAIN)} N·m·s/rad, used here",
        ),
        erratum(
            f"120 km/h on a radius of {RADIUS:g} m",
            "a_y = v²/R",
            f"{number(fast)} m/s², {number(fast / GRAVITY, 2)} g: the car leaves the circle",
        ),
        erratum(
            f"NLT {tests[0]['passive']['nlt_front']:g} in front, "
            f"{tests[0]['passive']['nlt_rear']:g} in the rear",
            "K_r φ/(t F_z), with F_zf : F_zr = l_r : l_f",
            f"{number(formula['nlt_front'] * roll[0])} and {number(formula['nlt_rear'] * roll[0])}"
            f"; printed front over roll is {number(min(front))} to {number(max(front))} per "
            "degree, one stiffness gives one ratio",
        ),
        erratum(
            f"Table 1 and {roll[0]:g}° at 30 km/h on {RADIUS:g} m",
            "φ = m h v²/R/(K_r − m g h)",
            f"{number(np.degrees(ratio * slow))}°: the simulated van is not that of Table 1",
        ),
    ]


def load_transfer(theirs: Redondo) -> PaperSection:
    """Return the printed load transfer over the printed roll, and the paper's formula."""
    rows: list[dict[str, Value]] = []
    for test, *_ in TESTS:
        for row, numbers in printed(PAPER)[test].items():
            line: dict[str, Value] = {"row": f"{test}, {row}".replace("_", " ")}
            for axle in ("front", "rear"):
                value = numbers[f"nlt_{axle}"]
                line[f"{axle}_per_degree"] = value / numbers["roll_max"]
                line[f"{axle}_formula"] = theirs.transfer[f"nlt_{axle}"]
            rows.append(line)
    return PaperSection(
        "load_transfer",
        "Load transfer over roll: was it computed from the roll angle?",
        {
            "row": "row",
            "front_per_degree": "front, printed (1/deg)",
            "front_formula": "K_r φ/(t F_z)",
            "rear_per_degree": "rear, printed (1/deg)",
            "rear_formula": "K_r φ/(t F_z)",
        },
        rows,
        "Within a test the printed ratio is the same for every law: the figures follow the roll "
        "angle, not the wheel loads, of which m h a_y stays under any roll control. Between tests "
        "the ratio differs. Wheel loads of the 14-DOF car are in the column of our conditions.",
    )


def _unknowns(theirs: Redondo) -> Sequence[tuple[str, str]]:
    return [
        (
            "lateral acceleration, mass and roll arm of the simulated van",
            f"fitted: {number(theirs.scale)} times m h a_y of our runs without control, from the "
            "passive 4.91° of the roundabout",
        ),
        ("unit of both gains", "N·m·s/deg for −84.06, N·m·s/rad for −1.29e6"),
        (
            "course and driver",
            "ours, of the same names and speeds; the lane offset was fitted to the largest roll "
            "without control at 100 km/h, which does not count either",
        ),
        ("limits and lag of the actuators", "none"),
    ]


def _waterfall(rows: Sequence[PaperRow]) -> PaperSection:
    places = [
        (row.table, row.row, "roll_max")
        for row in rows
        if row.row in ("passive", "delay aware") and "120" not in row.table
    ]
    return waterfall(
        rows,
        places,
        "Each column switches one thing more. Trigger: every tick in all of them; the ECU's "
        "column includes rounding, tick and actuator.",
    )
