"""A linearised plant as tables and as a figure."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import writing
from canroll.handling.linear_response import (
    EXCITATIONS,
    FREQUENCIES,
    MEASURED,
    LinearResponse,
)
from canroll.report.page import PageTable
from plant_sim.bodies import ports

SHOWN_EVERY = 8
"""Every how many frequencies the printed tables have a row."""

Vector = NDArray[np.float64]
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


def draw(answer: LinearResponse, where: str, path: Path) -> None:
    """Write gains and phases of the plant, and dashed of the design model, as a PNG.

    Raises:
        CanrollError: the file cannot be written.
    """
    import matplotlib.figure  # noqa: PLC0415 - half a second that only a figure needs

    with matplotlib.rc_context({"font.size": 8, "axes.grid": True, "grid.alpha": 0.3}):
        figure = matplotlib.figure.Figure(figsize=(16, 10), layout="constrained")
        axes = figure.subplots(4, len(MEASURED), sharex=True)
        for i, name in enumerate(EXCITATIONS):
            per, unit, units = UNITS[name]
            runs: dict[str, tuple[str, Mapping[str, NDArray[np.complex128]]]] = {
                "plant": ("-", answer.plant[name])
            }
            if answer.design is not None:
                runs["design model"] = ("--", answer.design[name])
            for j, key in enumerate(MEASURED):
                gains, phases = axes[2 * i, j], axes[2 * i + 1, j]
                for label, (style, responses) in runs.items():
                    gain, phase = _scaled(responses[key], unit, units[j])
                    gains.plot(FREQUENCIES, gain, style, label=label)
                    phases.plot(FREQUENCIES, phase, style)
                gains.set(xscale="log", ylim=(0.0, None), ylabel=f"{units[j]} {per}")
                gains.set_title(f"{name} → {NAMES[key]}")
                phases.set_ylabel("phase (°)")
        for axis in axes[-1]:
            axis.set_xlabel("frequency (Hz)")
        axes[0, 0].legend()
        figure.suptitle(where)
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path, dpi=90, metadata={"Software": None})
