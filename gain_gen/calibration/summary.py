"""A design as one JSON object, and the lines at the top of its header."""

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from canroll.gain_gen.models.task import Design

Tables = dict[str, Any]


def summary(design: Design) -> Tables:
    """Return the design as one JSON object, SI units."""
    controller, solution, task = design.controller, design.solution, design.task
    if controller.output_gain is not None:
        gain = [plain(controller.output_gain[:1])]
        if np.any(controller.output_gain[1:]):
            gain = [plain(controller.output_gain)]
    elif controller.compensator is not None:
        gain = plain(controller.compensator.c)
    else:
        gain = [plain(controller.feedback + controller.feedforward)]
    given = {name: plain(matrix) for name, matrix in solution.given.items()}
    return {
        "law": design.law,
        "vehicle": task.vehicle.name,
        "delay_s": task.delay.nominal,
        "tick_s": task.tick,
        **({"matrices": given} if given else {"gain": gain}),
        "gamma": solution.gamma,
        "gamma_bound": solution.gamma_bound,
        "gamma_channel": solution.gamma_channel or None,
        "max_delay_s": _finite(design.max_delay),
        "rightmost_root": solution.rightmost_root,
        "margins": {name: _finite(value) for name, value in design.margins.items()}
        | {name: _finite(value) for name, value in solution.extra.items()},
        "verified": {
            name: c._asdict() | {"value": _finite(c.value), "limit": _finite(c.limit)}
            for name, c in design.verified.items()
        },
        "solve_s": solution.solve_seconds,
        "warnings": list(design.warnings),
    }


def plain(values: ArrayLike) -> list[Any]:
    """Return a matrix as lists of numbers."""
    rows: list[Any] = np.asarray(values, dtype=float).tolist()
    return rows


def _finite(value: float) -> float | None:
    """JSON has no infinity: null stands for it."""
    return float(value) if np.isfinite(value) else None


def title(design: Design) -> list[str]:
    """Return the lines at the top of the header."""
    task = design.task
    verdict = "every check of the design passes"
    if not design.is_verified:
        failing = f"fails {', '.join(sorted(design.failures))}"
        verdict = f"NOT VERIFIED: {failing if design.failures else 'gains as printed'}"
    admitted = f"{1e3 * design.max_delay:.4g}" if isfinite(design.max_delay) else "any number of"
    return [
        f"canroll gains: {design.law} for {task.vehicle.name} ({task.actuator}), {task.gains}",
        f"tick {1e3 * task.tick:g} ms, designed for {1e3 * task.delay.nominal:g} ms from sample "
        f"to force, stable up to {admitted} ms",
        verdict,
    ]
