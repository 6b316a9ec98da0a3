"""A design as people read it: its gains, its checks with limits, and its other numbers."""

from collections.abc import Iterable, Iterator, Mapping
from math import inf, isfinite
from typing import TYPE_CHECKING

from canroll.gain_gen.calibration.summary import summary
from canroll.gain_gen.models.task import UNITS, Check, Design
from canroll.report.page import PageTable

if TYPE_CHECKING:
    from canroll.gain_gen.monitors.detectability import Detectable
    from canroll.gain_gen.monitors.uncertainty import Uncertainty

LABELS = {
    "spectral_radius": "spectral radius",
    "radius": "spectral radius",
    "gain_margin_db": "gain margin",
    "gain_db": "gain margin",
    "phase_deg": "phase margin",
    "peak_sensitivity": "peak sensitivity",
    "modulus": "distance from −1 (modulus margin)",
    "draws": "cars drawn from the fit",
    "draws_gain_db": "gain margin, worst draw of the fit",
    "draws_phase_deg": "phase margin, worst draw of the fit",
    "draws_peak_sensitivity": "peak sensitivity, worst draw of the fit",
    "fitted_gain_db": "gain margin, fitted car",
    "fitted_phase_deg": "phase margin, fitted car",
    "fitted_peak_sensitivity": "peak sensitivity, fitted car",
    "crossover": "crossover frequency (rad/s)",
    "max_delay_sampled_s": "largest delay, sampled loop",
    "max_delay_s": "largest delay, continuous loop",
    "delay_margin_s": "margin over the longest delay",
    "jitter_small_gain": "small-gain index of a varying delay",
    "roll_rms_ratio_half_delay": "roll RMS ÷ uncontrolled, half the delay",
    "roll_rms_ratio_nominal_delay": "roll RMS ÷ uncontrolled",
    "roll_rms_ratio_double_delay": "roll RMS ÷ uncontrolled, twice the delay",
    "roll_rms_ratio_ideal": "roll RMS ÷ uncontrolled, full-order law without delay",
    "box_spectral_radius": "spectral radius, ±20 %",
    "box_roll_rms_ratio": "roll RMS ÷ uncontrolled, ±20 %",
    "schedule_gain_margin_db": "gain margin between scheduled speeds",
    "schedule_peak_sensitivity": "peak sensitivity between scheduled speeds",
    "least_schedule_factor": "least factor of the speed schedule",
    "checked_speed_rate": "largest acceleration, on a grid (m/s²)",
    "quantised_response": "fixed point: error of the response",
    "quantised_moment_nm": "fixed point: error of the moment",
    "lmi_level": "largest eigenvalue of the inequality",
    "lmi_theorem": "largest eigenvalue, inequality",
    "lmi_p": "largest eigenvalue, −P",
    "gamma_exact": "exact level γ",
    "rightmost_root": "rightmost root (1/s)",
    "event_small_gain": "small-gain index of the trigger",
    "peak_ratio": "peak response ÷ uncontrolled",
    "least_peak_ratio": "least peak response ÷ uncontrolled",
    "certified_peak_ratio": "certified peak response ÷ uncontrolled",
    "largest_gain_with_margins": "largest gain with the margins (N·m·s/rad)",
    "moment_share": "share of the moment's range",
    "moment_weight": "weight of the moment",
    "beta": "feedforward share β",
    "rate_gain": "gain of the roll rate (N·m·s/rad)",
    "horizon_s": "prediction horizon",
    "filter_hz": "corner of the filter",
    "epsilon_squared": "trigger parameter ε²",
    "exact_best_gain": "best gain without the inequality (N·m·s/rad)",
    "exact_best_gamma": "best level γ without the inequality",
    "open_loop_gamma": "level γ without control",
    "theorem_delay_s": "delay of the theorem",
    "solves": "solutions of inequalities",
}
"""Labels of the checks and numbers of the built-in laws."""


def label(name: str) -> str:
    """Return the label of a check or number; that of an extension's is its name in words."""
    return LABELS.get(name, name.replace("_", " "))


def value(name: str, number: float) -> str:
    """Return a number with the unit at the end of its name; "any" if infinite."""
    if number == inf:
        return "any"
    return f"{number:.4g} {UNITS.get(name.rpartition('_')[2], '')}".rstrip().replace("-", "−")


def head(answer: Design) -> Iterator[str]:
    """Yield law, vehicle and conditions, then the gains, line by line."""
    task = answer.task
    yield (
        f"{answer.law} for {task.vehicle.name}, {task.actuator}, tick {1e3 * task.tick:g} ms, "
        f"delay {1e3 * task.delay.nominal:g} ms"
    )
    numbers = summary(answer)
    for name, rows in numbers.get("matrices", {"gain": numbers.get("gain")}).items():
        for row in rows:
            yield f"  {name:<7} {'  '.join(f'{number:.6g}' for number in row)}"


def over_draws(numbers: Mapping[str, float], delay_margin: float) -> Iterator[str]:
    """Yield the lines on the draws of the vehicle's fit, if it has one.

    Args:
        numbers: of :func:`canroll.gain_gen.analysis.fitted_family.margins_of_draws`, among others.
        delay_margin: of all draws over the longest delay, s.
    """
    if "draws" not in numbers:
        return
    delay = f"{1e3 * delay_margin:.3g} ms" if isfinite(delay_margin) else "any"
    draws, alone = (
        f"gain margin {value('gain_db', numbers[f'{of}_gain_db'])}, "
        f"phase margin {value('phase_deg', numbers[f'{of}_phase_deg'])}, "
        f"Ms {numbers[f'{of}_peak_sensitivity']:.3g}"
        for of in ("draws", "fitted")
    )
    count = f"{numbers['draws']:.0f}"
    yield f"worst of {count} draws of the fit: {draws}, delay margin {delay}"
    yield f"the fitted car alone: {alone}"


def checks(verified: Mapping[str, Check]) -> PageTable:
    """Return checks, each with its limit, verdict and worst case."""
    return PageTable(
        title="",
        head=("check", "value", "limit", "", "worst case"),
        rows=[
            (
                label(name),
                value(name, check.value),
                f"{'<' if check.ok == (check.value < check.limit) else '>'} "
                f"{value(name, check.limit)}",
                "ok" if check.ok else "FAILS",
                check.where,
            )
            for name, check in verified.items()
        ],
    )


def others(answer: Design) -> PageTable:
    """Return the numbers without a limit: of the nominal loop, and of the law's own design."""
    numbers = {**answer.margins, **answer.solution.extra}
    rest = {name: number for name, number in numbers.items() if name not in answer.verified}
    return PageTable(
        title="",
        head=("nominal loop", "value"),
        rows=[(label(name), value(name, number)) for name, number in rest.items()],
    )


def allowed_for(box: "Uncertainty") -> str:
    """Return the title of the table of :func:`detectability`."""
    return (
        "Least constant fault that a balance of signals shows within 0.3 s, allowing for mass\n"
        f"±{100 * box.mass:g} %, height ±{100 * box.height:g} %, springs "
        f"±{100 * box.stiffness:g} %, dampers ±{100 * box.damping:g} % and all else not known "
        "of car, sensors\nand road: on a straight, even road; at the worst moment of a slalom "
        "(4 m/s², 0.4 Hz); and\nseparated from other faults there"
    )


def detectability(rows: "Iterable[Detectable]", box: "Uncertainty") -> PageTable:
    """Return the detectable size of each constant fault, and the faults it is confused with."""
    return PageTable(
        title=allowed_for(box),
        head=("least constant fault", "straight", "slalom", "separable", "by", "but not from"),
        rows=[
            (
                row.fault.name,
                size(row.straight, row.fault.unit),
                size(row.slalom, row.fault.unit),
                size(row.isolated, row.fault.unit),
                row.first,
                ", ".join(row.inseparable),
            )
            for row in rows
        ],
    )


def size(number: float, unit: str) -> str:
    """Return the size of a fault; "never" if infinite."""
    if number == inf:
        return "never"
    digits = 0 if number >= 10.0 else 2 if number >= 1.0 else 3
    return f"{number:.{digits}f} {unit}"
