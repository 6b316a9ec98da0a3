"""Limits of validity of a vehicle's tyre files, and runs that went beyond them."""

from collections.abc import Iterator
from math import degrees

import numpy as np

from canroll.plant_sim.driving.limit import slip_of
from canroll.plant_sim.driving.standards import Signals
from canroll.vehicles import Vehicle
from canroll.vehicles.axles import Axle, axles
from canroll.vehicles.tyre_files import coefficients, outside

HELD = "forces were held at those of the limit"


def beyond(vehicle: Vehicle, signals: Signals) -> Iterator[str]:
    """Yield what went beyond the vehicle's tyre files in a run, one line each.

    Args:
        vehicle: that was driven.
        signals: of the run, one value per ms, SI units.
    """
    yield from outside(vehicle)
    for axle, file in zip(axles(vehicle), coefficients(vehicle), strict=False):
        wheels = (f"wheel_load_{axle.name}_{side}" for side in ("left", "right"))
        load = max(float(signals[wheel].max()) for wheel in wheels)
        if load > file["FZMAX"]:
            yield f"tyre file, {axle.name}: load up to {load:.0f} N > FZMAX; {HELD}"
        slip = float(slip_of(axle, signals).max(initial=0.0))
        if slip > min(file["ALPMAX"], -file["ALPMIN"]):
            yield (
                f"tyre file, {axle.name}: slip angle up to {degrees(slip):.1f}° > ALPMAX; {HELD}"
            )
        lean = _inclination(axle, signals)
        if lean > min(file["CAMMAX"], -file["CAMMIN"]):
            yield (
                f"tyre file, {axle.name}: inclination up to {degrees(lean):.1f}° > CAMMAX; {HELD}"
            )


def _inclination(axle: Axle, signals: Signals) -> float:
    """Largest inclination (rad) of the axle's wheels by roll and camber over their travel."""
    camber, largest = axle.curves.camber, 0.0
    if camber is None:
        return largest
    for side, inwards in (("left", -1.0), ("right", 1.0)):
        there = np.interp(-signals[f"travel_{axle.name}_{side}"], camber.x, camber.y)
        lean = signals["roll"] + inwards * there
        largest = max(largest, float(np.abs(lean).max(initial=0.0)))
    return largest
