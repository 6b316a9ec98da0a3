"""Handling tests of one vehicle without and with control: both over the bus, evaluated alike.

The firmware runs on the simulated bus as in any run. Without control its actuators are disabled,
and the vehicle moves as the plant alone.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from canroll.firmware.calibration import Q_MOMENT, VALVES, Calibration
from canroll.firmware.state import ACTIVE
from canroll.plant_sim.bodies.ports import WHEELS
from canroll.plant_sim.driving.maneuvers import Maneuver
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.world.handling import EVALUATED, Drive
from canroll.plant_sim.world.recording import Kept
from canroll.runs.experiment import drive
from canroll.runs.result import Run
from canroll.runs.trace import Trace
from canroll.setup.controller import Controller
from canroll.typing import Progress

Test = TypeVar("Test")

AXLES = ("moment_front", "moment_rear")
STATUS = tuple(f"status_{wheel}" for wheel in WHEELS)
NEEDED = Kept(("time", *EVALUATED, *AXLES, *STATUS), frames=False)
"""What the tests and :class:`Control` are made from."""


@dataclass(frozen=True, slots=True)
class Control:
    """What control did while a handling test evaluated the car.

    Attributes:
        at_limit: share of the ticks whose command was at its limit.
        actuators_limited: share of the time in which an actuator could not follow its command.
        inactive: share of the ticks in which the ECU was not in mode ACTIVE.
        moment: RMS roll moment of front and rear axle on the body, N·m.
    """

    at_limit: float
    actuators_limited: float
    inactive: float
    moment: tuple[float, float]

    @property
    def limited(self) -> bool:
        """Whether anything limited control."""
        return max(self.at_limit, self.actuators_limited, self.inactive) > 0.0

    @property
    def front_share(self) -> float | None:
        """The front axle's share of the moment; None without any."""
        total = sum(self.moment)
        return self.moment[0] / total if total > 0.0 else None


@dataclass(frozen=True, slots=True)
class Pair(Generic[Test]):
    """One test without control, and with it unless there is none.

    ``control``: of each manoeuvre driven with it, in order.
    """

    passive: Test
    controlled: Test | None = None
    control: tuple[Control, ...] = ()

    @property
    def runs(self) -> dict[str, Test]:
        """The results by their names."""
        with_it = {} if self.controlled is None else {"controlled": self.controlled}
        return {"passive": self.passive, **with_it}


def compared(
    settings: Run,
    controller: Controller,
    test: Callable[[Drive], Test],
    progress: Progress | None = None,
) -> Pair[Test]:
    """Return a test of :mod:`canroll.plant_sim.world.handling` without and with control.

    Args:
        settings: of the runs but manoeuvre and speed, which are those of the test.
        controller: the calibration that the ECU runs.
        test: evaluates what the drive that it is given returns.
        progress: called with "passive" or "controlled" and the fraction done of each manoeuvre.

    Raises:
        VerdictError: one of the vehicles cannot be driven so.
    """
    control: list[Control] = []

    def driven(*, enabled: bool) -> Drive:
        def run(maneuver: Maneuver, last: int) -> Mapping[str, NDArray[np.float64]]:
            trace = drive(
                settings,
                controller,
                enabled=enabled,
                maneuver=maneuver,
                kept=NEEDED,
                progress=progress,
            )
            if enabled:
                control.append(_control(trace, last, controller.record))
            return {name: trace.signals[name][-last:] for name in EVALUATED}

        return run

    passive = test(driven(enabled=False))
    return Pair(passive, test(driven(enabled=True)), tuple(control))


def _control(trace: Trace, last: int, record: Calibration) -> Control:
    """Return what control did in the ``last`` steps of a run."""
    since = trace.signals["time"][-1] - last * STEP_NS * 1e-9
    ticks = trace.ticks[:]
    ticks = ticks[ticks["t"] > since]
    status = np.column_stack([trace.signals[name][-last:] for name in STATUS])
    moment = [float(np.sqrt(np.mean(trace.signals[name][-last:] ** 2))) for name in AXLES]
    return Control(
        at_limit=float(np.mean(np.abs(ticks["outputs"]).max(axis=1) >= limit_of(record))),
        actuators_limited=float(np.mean(status.max(axis=1) > 0.0)),
        inactive=float(np.mean(ticks["mode"] != ACTIVE)),
        moment=(moment[0], moment[1]),
    )


def limit_of(record: Calibration) -> float:
    """Return the largest output of the law that the ECU commands, N·m, of valves mA."""
    most = record.moment_max
    if record.actuator == VALVES:
        most = min(most, record.current_max)
    return float(most / 2**Q_MOMENT)
