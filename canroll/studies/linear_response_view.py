"""A linearised plant as tables and as a figure."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canroll.errors import writing
from canroll.studies.linear_response import (
    EXCITATIONS,
    FREQUENCIES,
    MEASURED,
    LinearResponse,
)
from plant_sim.bodies import ports

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


def lines(answer: LinearResponse, where: str) -> Iterable[str]:
    """Yield the tables as text."""
    trim = answer.trim
    yield where
    yield (
        f"road wheels at {_rounded(np.degrees(trim.inputs[ports.STEER]))}°, "
        f"roll {_rounded(np.degrees(trim.outputs[ports.ROLL]))}°"
    )
    yield from ("", f"{'Hz':>8} {'damping':>8} {'pole 1/s':>16}  motion")
    for mode in answer.modes:
        pole = f"{mode.pole.real:.1f}"
        if mode.pole.imag:
            pole += f" ± {mode.pole.imag:.1f}j"
        named = ", ".join(
            f"{name} {100 * share:.0f} %" for name, share in mode.shares if share > 0.1
        )
        yield f"{mode.frequency:8.2f} {mode.damping:8.2f} {pole:>16}  {named}"
    for name in EXCITATIONS:
        per, unit, units = UNITS[name]
        yield from ("", f"{name}, {per}: gain and phase (°)")
        heads = (f"{NAMES[key]} {u}" for key, u in zip(MEASURED, units, strict=True))
        yield f"{'Hz':>6}" + "".join(f"{head:>18}" for head in heads)
        columns = [
            _scaled(response, unit, u)
            for response, u in zip(answer.plant[name].values(), units, strict=True)
        ]
        for i in range(0, FREQUENCIES.size, SHOWN_EVERY):
            cells = (f"{gain[i]:12.4g}{phase[i]:6.0f}" for gain, phase in columns)
            yield f"{FREQUENCIES[i]:6.2f}" + "".join(cells)
    yield ""
    yield from _distance_lines(answer)


def _distance_lines(answer: LinearResponse) -> Iterable[str]:
    distance = answer.distance
    if distance is None:
        yield f"no design model at this trim: {answer.why_not}"
        return
    yield f"distance to the design model, 0.1 to {FREQUENCIES[-1]:g} Hz, % of the plant's peak"
    yield f"{'':>10}" + "".join(f"{name:>16}" for name in NAMES.values())
    for excitation, row in distance.items():
        cells = ("–" if value is None else f"{100 * value:.2f}" for value in row.values())
        yield f"{excitation:>10}" + "".join(f"{cell:>16}" for cell in cells)


def _rounded(value: float) -> str:
    """Return the number with two decimals, without "-0.00"."""
    return f"{round(float(value), 2) + 0.0:.2f}"


def _scaled(
    response: NDArray[np.complex128], per: float, unit: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
