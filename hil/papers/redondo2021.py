"""Redondo, Boada, Díaz 2021: delay-aware and delay-unaware H∞ roll-rate feedback of a van."""

from canroll.typing import Progress
from gain_gen.laws.hinf_delay import PRINTED_DELAY_GAIN
from gain_gen.models.roll import ROLL_RATE
from hil.papers.linear_roll import chatter, design_numbers, motion
from hil.papers.paper_runs import Case, Recomputed, cycle_reason, drive, plots
from hil.papers.paper_table import Row, printed
from hil.report.figure import Figure
from hil.runs.metrics import peak, rms
from hil.runs.result import Result

PAPER = "redondo2021"
TITLE = "Redondo, Boada, Díaz 2021: H∞ with input and output delays"
COMMON = {
    "vehicle": "van_2021",
    "plant": "nonlinear",
    "bus": "gateway_50ms",
    "gains": "as_printed",
    "trigger": "every",
}
TESTS = (
    ("roundabout_30", "roundabout", 30.0, "Tables 2, 3"),
    ("double_lane_change_100", "double_lane_change", 100.0, "Tables 4, 5"),
    ("roundabout_120", "roundabout", 120.0, "Tables 6, 7"),
)
LAWS = {"delay_aware": "hinf_delay", "delay_unaware": "hinf_nodelay"}
FIGURES = {
    "roll_rms": "roll_rms_deg",
    "roll_max": "roll_max_deg",
    "nlt_front": "nlt_front_max",
    "nlt_rear": "nlt_rear_max",
}
STEADY = (
    "in steady cornering the roll rate is zero, so roll-rate feedback of any gain leaves the "
    "roll angle unchanged; the printed reduction cannot come from the printed law"
)
FAST = (
    "120 km/h on a radius of 22 m requires 50 m/s², five times what tyres can provide: the car "
    "leaves the circle, and how depends on tyres and driver, which are not printed"
)
TRANSFER = (
    "the tyres must carry m h a_y in any case; control affects only the part m g h φ, so load "
    "transfer cannot fall in proportion to the roll angle as it does in the paper"
)
DELAYED = (
    "on the paper's 1-DOF model with only its 100 ms delay, the printed gain reduces RMS roll by "
    "{rms:.0f} % and maximum roll by {max:.0f} % in this lane change; tick, actuator, tyres and "
    "a bus delay of up to {bus:.0f} ms reduce the benefit"
)

GAINS = (
    "The printed −84.06 is interpreted as per degree and −1.29e6 as per radian, since no units "
    "are printed. The printed level is lower than any roll-rate gain can achieve with the delays "
    "of this network."
)


def recompute(report: Progress) -> Recomputed:
    """Return every number of Tables 2 to 7."""
    found: list[Row] = []
    figures: list[Figure] = []
    driven: dict[str, Result] = {}
    for test, scenario, speed, table in TESTS:
        results = drive(
            scenario,
            [Case(f"{test}, {row}", {"law": law}) for row, law in LAWS.items()],
            {**COMMON, "speed_kmh": speed},
            report,
        )
        driven |= results
        by_row = {row: results[f"{test}, {row}"] for row in LAWS}
        for row, numbers in printed(PAPER)[test].items():
            found += _table(test, table, row, numbers, by_row)
        if scenario == "double_lane_change":
            figures = plots(PAPER, "Lane change at 100 km/h", results)
    designed = design_numbers(PAPER, COMMON, tuple(LAWS.values()), GAINS)
    return Recomputed(found, figures, [designed, chatter(driven)])


def _table(
    test: str, table: str, row: str, numbers: dict[str, float], results: dict[str, Result]
) -> list[Row]:
    result = results.get(row) or next(iter(results.values()))
    metrics = result.passive_metrics if row == "passive" else result.controlled_metrics
    return [
        Row(
            paper=PAPER,
            table=f"{table}, {test.replace('_', ' ')} km/h",
            row=row.replace("_", " "),
            quantity=quantity,
            printed=numbers[quantity],
            ours=getattr(metrics, figure),
            group=f"{test}.{quantity}",
            finding=_reason(test, row, quantity, result),
            calibrated=row == "passive" and test != "roundabout_120",
        )
        for quantity, figure in FIGURES.items()
    ]


def _reason(test: str, row: str, quantity: str, result: Result) -> str:
    if row != "passive" and (reason := cycle_reason(result)):
        return reason
    if test == "roundabout_120":
        return FAST
    if row == "passive":
        return (
            "the plant is calibrated with the 1-DOF model; the nonlinear car deviates by this much"
        )
    if quantity.startswith("nlt"):
        return TRANSFER
    return STEADY if test == "roundabout_30" else _delayed(result)


def _delayed(result: Result) -> str:
    """Return the effect of the printed gain on this lane change with its delay alone."""
    model = result.settings.vehicle.design
    gain = PRINTED_DELAY_GAIN * ROLL_RATE
    lateral = result.passive.signals["ay"]
    free = motion(model, None, lateral)[:, 0]
    held = motion(model, gain, lateral, delay=printed(PAPER)["max_delay_s"])[:, 0]
    less = {name: 100 * (1 - of(held) / of(free)) for name, of in (("rms", rms), ("max", peak))}
    return DELAYED.format(**less, bus=1e3 * result.delay.most)
