"""Limits of validity of a vehicle's tyre files, and runs that went beyond them."""

from collections.abc import Iterator
from math import degrees

from plant_sim.driving.limit import slip_of
from plant_sim.driving.standards import Signals
from vehicles import Vehicle
from vehicles.axles import axles
from vehicles.tyre_files import coefficients, outside

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
