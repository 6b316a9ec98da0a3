"""Lower bound of roll for a moment of given effort: noncausal, with full information.

A controller that knows the whole manoeuvre in advance chooses the moment m, held 10 ms at a time,

    min |φ + H m|²  subject to  |m|² <= N M²

with φ the passive roll angle at the N ends of those intervals, H the plant's response to such a
moment and M the RMS moment. On a linear plant no law, whatever it measures or predicts, achieves a
lower RMS roll at that effort. H is the plant's linearisation about straight running and the passive
run's lateral acceleration is kept, so that on a nonlinear plant the bound is good to about two
percent.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.optimize import brentq

from canroll.plant_sim import bodies
from canroll.plant_sim.world.open_loop import moment_response
from canroll.runs.metrics import rms
from canroll.runs.result import Run
from canroll.setup.controller import Controller
from canroll.typing import Vector

HELD = 0.010
"""How long a moment is held, s; half of it lowers the bound by a thousandth."""
SMALLEST, LARGEST = 1e-12, 1e12
"""Multipliers, as share of the largest squared singular value, between which the effort's lies."""


@dataclass(frozen=True, slots=True)
class EffortBound:
    """The problem in the principal directions of H.

    Attributes:
        roll: passive roll angle along each left singular vector, rad.
        gain: singular values of H, rad per N·m, descending.
    """

    roll: Vector
    gain: Vector

    @classmethod
    def of(cls, roll: Vector, response: Vector) -> Self:
        """Return the bound for a passive ``roll`` angle.

        Args:
            roll: at the end of each interval, rad.
            response: roll angle at the same instants in response to 1 N·m held over the first
                interval, rad.
        """
        lower: NDArray[np.float64] = toeplitz(response, np.zeros(len(response)))
        left, gain, _ = np.linalg.svd(lower)
        return cls(left.T @ roll, gain)

    def at(self, effort: float) -> float:
        """Return the least RMS roll angle at an RMS moment up to ``effort`` (N·m), rad."""
        count = len(self.roll)
        if effort <= 0.0:
            return rms(self.roll)
        scale = self.gain[0] ** 2

        def surplus(exponent: float) -> float:
            moment = self.gain * self.roll / (self.gain**2 + scale * 10.0**exponent)
            return float(np.log(np.sum(moment**2) / (count * effort**2)))

        low, high = np.log10(SMALLEST), np.log10(LARGEST)
        if surplus(low) <= 0.0:
            return 0.0
        multiplier = scale * 10.0 ** brentq(surplus, low, high)
        left = self.roll * multiplier / (self.gain**2 + multiplier)
        return sqrt(float(np.mean(left**2)))


def bound_of(settings: Run, controller: Controller, time: Vector, roll: Vector) -> EffortBound:
    """Return the bound of a run.

    Args:
        settings: the run's settings; vehicle, plant and speed are used.
        controller: controller whose front share splits the moment.
        time: of the passive run, s.
        roll: roll angle of the passive run, rad.
    """
    count = int(time[-1] / HELD + 1e-9)
    ends = HELD * np.arange(1, count + 1)
    response = moment_response(
        settings.vehicle,
        bodies.own_body(settings.plant, "the bound of roll control"),
        settings.speed,
        front_share=controller.front_share(settings.speed),
        held=HELD,
        count=count,
    )
    return EffortBound.of(np.interp(ends, time, roll), response)
