"""A picture of a run for a README or a mail: roll, moment and load transfer over time."""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from canroll.arguments import checked
from canroll.report.curves import MOMENT, signal, transfer
from canroll.report.run_page import shown
from canroll.runs.metrics import has_wheel_loads
from canroll.runs.result import Result

COLOURS = ("#4d4d4d", "#0072b2")
STYLES = ("--", "-")
POINTS = 60_000
"""The most points of a curve, 60 for each of the picture's columns: all of a minute."""


@checked
def plot(result: Result) -> Figure:
    """Return a figure of roll angle, moment and front load transfer of both runs over time."""
    panels = [
        ("roll angle (deg)", signal("roll", float(np.degrees(1)))),
        ("anti-roll moment (N·m)", MOMENT),
    ]
    if has_wheel_loads(result.passive):
        panels.append(("load transfer, front axle", transfer("front")))
    with matplotlib.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = Figure(figsize=(8, 6.5), layout="constrained")
        axes = figure.subplots(len(panels), 1, sharex=True)
        for axis, (label, quantity) in zip(axes, panels, strict=True):
            for run, colour, style in zip(shown(result), COLOURS, STYLES, strict=False):
                curve = quantity.curve(run.trace, POINTS)
                axis.plot(*curve, style, color=colour, label=run.name)
            axis.set_ylabel(label)
        axes[0].set_title(result.verdict, fontsize=10, loc="left", wrap=True)
        axes[0].legend(loc="upper right")
        axes[-1].set_xlabel("time (s)")
    return figure
