"""Quantities of a recorded run as curves, read and reduced a piece at a time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from canroll.typing import Vector
from hil.report.figure import POINTS_MAX, thin_pieces
from hil.runs.metrics import MOMENTS, load_transfer, loads_of
from hil.runs.trace import Trace
from plant_sim.world.spool import pieces, row_count
from vehicles import GRAVITY


@dataclass(frozen=True, slots=True)
class Quantity:
    """What is plotted: a function of recorded ``signals`` that takes each instant by itself."""

    signals: tuple[str, ...]
    of: Callable[..., Vector]

    def curve(self, trace: Trace, points: int = POINTS_MAX) -> tuple[Vector, Vector]:
        """Return times (s) and values of a run as :func:`hil.report.figure.thin` reduces them."""
        recorded = pieces(trace.signals, "time", *self.signals)
        values = ((time, self.of(*columns)) for time, *columns in recorded)
        return thin_pieces(values, row_count(trace.signals), points)


def signal(name: str, scale: float = 1.0) -> Quantity:
    """Return a recorded signal, times ``scale``."""
    return Quantity((name,), lambda values: values * scale)


def transfer(axle: str) -> Quantity:
    """Return the load transfer of an axle."""
    return Quantity(loads_of(axle), load_transfer)


MOMENT = Quantity(MOMENTS, np.add)
"""Anti-roll moment on the body from the actuators, N·m."""
EFFECTIVE = Quantity(("ay", "bank"), lambda ay, bank: ay + GRAVITY * np.sin(bank))
"""Lateral acceleration as an accelerometer in the upright body measures it, m/s²."""
