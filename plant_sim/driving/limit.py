"""Car or driver: what a failed run was limited by."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.driving.drive import slip_limit
from canroll.plant_sim.driving.standards import Signals, two_wheel_lift
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.axles import Axle, axles

NEAR = 0.98
"""Share of a limit from which it counts as reached."""

LASTING = 0.05
"""Time at a limit (s), all in all, from which it counts."""

SLOWEST = 3.0
"""Speed (m/s) below which slip angles are not judged."""


class Limited(NamedTuple):
    """``by`` "car" or "driver", and the ``reason`` in words."""

    by: str
    reason: str


def limited_by(vehicle: Vehicle, signals: Signals, friction: float) -> Limited:
    """Return whether the car could have done more in a run of those signals.

    The car is the limit if it lifts its wheels, slides, or its steering is at its stop or as fast
    as it goes; otherwise grip is left that the driver did not use.

    Args:
        vehicle: that was driven.
        signals: of the run, one value per ms, SI units.
        friction: of the road.
    """
    if signals["rollover"].max() > 0:
        return Limited("car", "it rolls over")
    if any(not verdict.passed for verdict in two_wheel_lift(signals)):
        return Limited("car", "both wheels of a side lift")
    grip = friction * vehicle.tyre.friction * GRAVITY
    used = f"{np.abs(signals['ay']).max() / grip:.0%} of the grip used".replace("%", " %")
    for axle in axles(vehicle):
        slip = slip_of(axle, signals)
        if _lasts(slip >= NEAR * slip_limit(axle, friction)):
            return Limited("car", f"the {axle.name} tyres are near their peak, {used}")
    steer, step = np.abs(signals["steer"]), STEP_NS * 1e-9
    if _lasts(steer >= NEAR * vehicle.steering.angle_limit):
        return Limited("car", "the steering is at its stop")
    if _lasts(np.abs(np.diff(signals["steer"])) >= NEAR * vehicle.steering.rate_limit * step):
        return Limited("car", "the steering is as fast as it goes")
    return Limited("driver", f"no tyre and no steering at its limit, {used}")


def slip_of(axle: Axle, signals: Signals) -> NDArray[np.float64]:
    """Return the magnitude of the axle's slip angle (rad) while the car moves."""
    moving = signals["vx"] > SLOWEST
    vx, vy, rate, steer = (signals[name][moving] for name in ("vx", "vy", "yaw_rate", "steer"))
    course = np.arctan((vy + axle.ahead * rate) / vx)
    return np.abs(steer - course if axle.name == "front" else course)


def _lasts(reached: NDArray[np.bool_]) -> bool:
    return float(np.count_nonzero(reached)) * STEP_NS * 1e-9 >= LASTING
