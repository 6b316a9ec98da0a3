"""Figures of many pairs of runs, without their traces."""

from collections.abc import Iterable
from dataclasses import astuple, fields, replace

import numpy as np
from numpy.typing import NDArray

from firmware.state import SAFE
from hil.runs import limit_cycle, metrics
from hil.runs.experiment import drive
from hil.runs.frozen import Controller
from hil.runs.metrics import Metrics
from hil.runs.result import Settings
from plant_sim.bodies.ports import WHEELS
from plant_sim.world.recording import Kept

METRICS = np.dtype([(field.name, "?" if field.type is bool else "f8") for field in fields(Metrics)])
"""The fields of :class:`hil.runs.metrics.Metrics`."""

FIGURES = np.dtype(
    [
        ("passive", METRICS),
        ("controlled", METRICS),
        ("safe", "f8"),
        ("cycle_hz", "f8"),
        ("cycle_nm", "f8"),
    ]
)
"""Figures of a pair of runs: metrics without and with control, fraction of the ticks in SAFE,
frequency and amplitude of a limit cycle of the command (0 and 0: none)."""


NEEDED = Kept(
    (
        *("time", "roll", "roll_rate", "path_error", "rollover", "moment_front", "moment_rear"),
        *(f"wheel_load_{wheel}" for wheel in WHEELS),
    ),
    frames=False,
)
"""What the figures are made from."""


def figures(controller: Controller, settings: Iterable[Settings]) -> NDArray[np.void]:
    """Drive each of ``settings`` without and with control; return one row of FIGURES for each.

    The figures are those of :func:`hil.runs.experiment.simulate`. A row depends on its settings
    and the controller alone, not on the other rows.

    Raises:
        CanrollError: a run that cannot be.
    """
    return np.array([_pair(controller, each) for each in settings], FIGURES)


def _pair(controller: Controller, settings: Settings) -> tuple[object, ...]:
    # as in a run: what faults do is measured against a vehicle whose parts are all right
    whole = replace(settings, faults=())
    passive = drive(whole, controller, enabled=False, kept=NEEDED)
    controlled = drive(settings, controller, enabled=True, kept=NEEDED)
    cycle = limit_cycle.detect(
        controlled.ticks["t"],
        controlled.ticks["moment"],
        passive.signals["time"],
        passive.signals["roll"],
    )
    return (
        astuple(metrics.judge(passive)),
        astuple(metrics.judge(controlled)),
        float(np.mean(controlled.ticks["mode"] == SAFE)),
        *((0.0, 0.0) if cycle is None else (cycle.frequency, cycle.amplitude)),
    )
