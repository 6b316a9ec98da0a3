"""A linearised plant as tables, and as panels of a figure."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from canroll.handling.linear_response import (
    EXCITATIONS,
    FREQUENCIES,
    MEASURED,
    LinearResponse,
)
from canroll.handling.response_figure import Panel
from canroll.plant_sim.bodies import ports
from canroll.report.page import PageTable
from canroll.typing import Vector

SHOWN_EVERY = 8
"""Every how many frequencies the printed tables have a row."""

NAMES = {
    "roll_rate": "roll rate",
    "roll": "roll",
    "lateral_acceleration": "a_y",
    "imu_lateral": "IMU a_y",
    "yaw_rate": "yaw rate",
}
UNITS = {
    "moment": ("per kN·m", 1e3, ("°/s", "°", "m/s²", "m/s²", "°/s")),
    "steering": (
        "per degree of the road wheels",
        np.radians(1.0),
        ("°/s", "°") + 2 * ("m/s²",) + ("°/s",),
    ),
}


def tables(answer: LinearResponse) -> Iterable[PageTable]:
    """Yield the modes, gain and phase (°) for each excitation, and the distance to the design."""
    yield PageTable("modes", ("Hz", "damping", "pole (1/s)", "motion"), _modes(answer))
    for name in EXCITATIONS:
        per, unit, units = UNITS[name]
        heads = (f"{NAMES[key]} ({u})" for key, u in zip(MEASURED, units, strict=True))
        columns = [
            _scaled(response, unit, u)
            for response, u in zip(answer.plant[name].values(), units, strict=True)
        ]
        rows = [
            (
                f"{FREQUENCIES[i]:.2f}",
                *(text for column in columns for text in _point(column, i)),
            )
            for i in range(0, FREQUENCIES.size, SHOWN_EVERY)
        ]
        head = ("Hz", *(text for head in heads for text in (head, "phase (°)")))
        yield PageTable(f"{name}, {per}: gain and phase", head, rows)
    if answer.distance is not None:
        yield PageTable(
            f"distance to the design model, 0.1 to {FREQUENCIES[-1]:g} Hz, % of the plant's peak",
            ("", *NAMES.values()),
            [
                (name, *("–" if v is None else f"{100 * v:.2f}" for v in row.values()))
                for name, row in answer.distance.items()
            ],
        )


def trim_of(answer: LinearResponse) -> str:
    """Return the trim in words."""
    trim = answer.trim
    return (
        f"road wheels at {_rounded(np.degrees(trim.inputs[ports.STEER]))}°, "
        f"roll {_rounded(np.degrees(trim.outputs[ports.ROLL]))}°"
    )


def _point(column: tuple[Vector, Vector], i: int) -> tuple[str, str]:
    gain, phase = column
    return f"{gain[i]:.4g}", f"{phase[i]:.0f}"


def _modes(answer: LinearResponse) -> Sequence[tuple[str, ...]]:
    rows = []
    for mode in answer.modes:
        pole = f"{mode.pole.real:.1f}"
        if mode.pole.imag:
            pole += f" ± {mode.pole.imag:.1f}j"
        named = ", ".join(
            f"{name} {100 * share:.0f} %" for name, share in mode.shares if share > 0.1
        )
        rows.append((f"{mode.frequency:.2f}", f"{mode.damping:.2f}", pole, named))
    return rows


def _rounded(value: float) -> str:
    """Return the number with two decimals, without "-0.00"."""
    return f"{round(float(value), 2) + 0.0:.2f}"


def _scaled(response: NDArray[np.complex128], per: float, unit: str) -> tuple[Vector, Vector]:
    """Return gain in table units and phase in degrees; no phase without a response."""
    gain = np.abs(response) * per
    phase = np.degrees(np.unwrap(np.angle(response)))
    return (np.degrees(gain) if "°" in unit else gain), phase


def panels(answer: LinearResponse) -> list[list[Panel]]:
    """Return the responses of the plant, and dashed those of the design model, to be drawn."""
    both = {"plant": ("-", answer.plant), "design model": ("--", answer.design)}
    return [
        [
            Panel(
                f"{name} → {NAMES[key]}",
                f"{unit} {per}",
                {
                    label: (style, *_scaled(responses[name][key], factor, unit))
                    for label, (style, responses) in both.items()
                    if responses is not None
                },
            )
            for key, unit in zip(MEASURED, units, strict=True)
        ]
        for name, (per, factor, units) in ((name, UNITS[name]) for name in EXCITATIONS)
    ]
