"""``canroll design --compare``: every law designed for one task."""

import argparse
from dataclasses import replace
from math import isfinite
from typing import Any

from canroll.cli import terminal
from canroll.errors import CanrollError
from canroll.gain_gen.analysis.speed_schedule import with_speed_rate
from canroll.gain_gen.calibration.summary import summary
from canroll.gain_gen.design import design
from canroll.gain_gen.laws import LAWS
from canroll.gain_gen.models.task import Design, Task
from canroll.report.page import PageTable


def compare(args: argparse.Namespace, task: Task) -> int:
    """Design every law for one task and print one line or object each."""
    answers = _designed(task)
    fitted = task.vehicle.fit is not None
    known = _designed(replace(task, vehicle=replace(task.vehicle, fit=None))) if fitted else {}
    if args.json:  # rates of speed take long, and are not shown
        data = [_compared(law, answer) for law, answer in answers.items()]
        for entry in data if fitted else ():
            entry["if_known"] = _compared(entry["law"], known[entry["law"]])
        return terminal.emit(args, data, ())
    title = (
        f"{task.vehicle.name}, {task.actuator}, tick {1e3 * task.tick:g} ms, delay "
        f"{1e3 * task.delay.least:.4g} to {1e3 * task.delay.most:.4g} ms from sample to force"
    )
    head = ("law", "roll RMS", "±20 %", "delay (ms)", "gain (dB)", "Ms")
    rows = []
    for law, answer in answers.items():
        if isinstance(answer, Design):
            rows.append(_row(law, answer))
        if_known = known.get(law)
        if isinstance(if_known, Design):
            rows.append(_row(f"{law}, car known", if_known))
    refused = [(law, answer) for law, answer in answers.items() if isinstance(answer, CanrollError)]
    lines = [f"{law} refused: {reason}" for law, reason in refused]
    return terminal.emit(args, None, [title, PageTable("Designs", head, rows), *lines])


def _designed(task: Task) -> dict[str, Design | CanrollError]:
    """Return every law's design for a task, or why there is none."""
    answers: dict[str, Design | CanrollError] = {}
    for law in LAWS:
        if law == "custom":
            continue
        try:
            answers[law] = design(law, task)
        except CanrollError as refused:
            answers[law] = refused
    return answers


def _compared(law: str, answer: Design | CanrollError) -> dict[str, Any]:
    if isinstance(answer, Design):
        return summary(with_speed_rate(answer))
    return {"law": law, "refused": str(answer)}


def _row(name: str, answer: Design) -> tuple[str, ...]:
    """Return one row of the comparison."""

    def number(name: str, digits: int) -> str:
        value = answer.margins.get(name, float("inf"))
        return f"{value:.{digits}f}" if isfinite(value) else "any"

    def worst(name: str, digits: int) -> str:
        check = answer.verified.get(name)
        if check is None:
            return ""
        return f"{check.value:.{digits}f}" if isfinite(check.value) else "any"

    delay = f"{1e3 * answer.max_delay:.0f}" if isfinite(answer.max_delay) else "any"
    return (
        name,
        number("roll_rms_ratio_nominal_delay", 3),
        number("box_roll_rms_ratio", 3),
        delay,
        worst("gain_margin_db", 1),
        worst("peak_sensitivity", 2),
    )
