"""Frequency responses as a picture: gains over phases, a column for each response."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from canroll.errors import writing
from canroll.typing import Vector

PICTURE = "response.png"
TICKS = (0.2, 0.5, 1, 2, 4)
"""Frequencies named on the axis, Hz."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One response: of each curve, by its name, its style, gain and phase (°)."""

    title: str
    unit: str
    curves: Mapping[str, tuple[str, Vector, Vector]]


def draw(frequency: Vector, rows: Sequence[Sequence[Panel]], where: str, folder: Path) -> Path:
    """Write the picture to a folder, and return its path.

    Args:
        frequency: Hz.
        rows: responses, one row of panels below the other.
        where: what was driven, for its title.
        folder: made if it is missing.

    Raises:
        CanrollError: the file cannot be written.
    """
    import matplotlib.figure  # noqa: PLC0415 - half a second that only a figure needs

    with matplotlib.rc_context({"font.size": 8, "axes.grid": True, "grid.alpha": 0.3}):
        size = (4 + 2.5 * len(rows[0]), 2 + 4 * len(rows))
        figure = matplotlib.figure.Figure(figsize=size, layout="constrained")
        axes = figure.subplots(2 * len(rows), len(rows[0]), sharex=True, squeeze=False)
        for i, row in enumerate(rows):
            for j, panel in enumerate(row):
                gains, phases = axes[2 * i, j], axes[2 * i + 1, j]
                for name, (style, gain, phase) in panel.curves.items():
                    gains.plot(frequency, gain, style, label=name)
                    phases.plot(frequency, phase, style)
                gains.set(xscale="log", ylim=(0.0, None), title=panel.title, ylabel=panel.unit)
                gains.set_xticks(TICKS, map(str, TICKS))
                gains.set_xticks([], minor=True)
                phases.set_ylabel("phase (°)")
        for axis in axes[-1]:
            axis.set_xlabel("frequency (Hz)")
        axes[0, 0].legend()
        figure.suptitle(where)
        path = folder / PICTURE
        with writing(path):
            folder.mkdir(parents=True, exist_ok=True)
            figure.savefig(path, dpi=90, metadata={"Software": None})
    return path
