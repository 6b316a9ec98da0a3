"""The front axle's share of the anti-roll moment, as yaw control.

The moment carried by an axle's bar transfers load there, and an axle's tyres give less lateral
force the more their loads differ: a larger front share makes a car understeer, a larger rear share
oversteer. Split like the roll stiffness of the suspension, the moment leaves the balance unchanged.
A larger front share reduces sideslip in manoeuvres at the limit but also the available moment, as
the front bar saturates first. The share is the largest with which the car, laden or empty,
understeers at most :data:`BAND` more than without control.
"""

from collections.abc import Iterator
from functools import lru_cache
from math import radians

from scipy.optimize import brentq

from canroll.errors import CanrollError
from canroll.gain_gen.models.trim import most_lateral_acceleration, slip_angles
from canroll.vehicles import Vehicle
from canroll.vehicles.axles import axles
from canroll.vehicles.roll_stiffness import axle_roll_shares
from canroll.vehicles.unladen import unladen

BAND = 0.05
"""Permitted increase of understeer with control, relative to the understeer angle without."""
LEAST_BAND = radians(0.02)
"""Width of the band of a car that hardly understeers, rad."""
CARRIED = 0.5
"""Share of m h a_y that the actuators carry in the curves in which the band holds."""
ACCELERATIONS = tuple(0.5 * half for half in range(2, 15))
"""Lateral accelerations of these curves, as far as the car holds them: 1 to 7 m/s²."""
MOST = 0.65
"""Largest share; beyond it the rear bar is hardly used."""


@lru_cache(maxsize=64)
def front_share(vehicle: Vehicle) -> float:
    """Return the front axle's share of the anti-roll moment."""
    neutral = axle_roll_shares(vehicle)[0]
    if neutral >= MOST or not sensitive(vehicle):
        return neutral
    cars = [(car, _angles(car, (0.0, 0.0))) for car in (vehicle, unladen(vehicle))]

    def surplus(share: float) -> float:
        return max(
            with_control - without - max(BAND * abs(without), LEAST_BAND)
            for car, angles in cars
            for without, with_control in zip(
                angles, _angles(car, carried(car, share)), strict=False
            )
        )

    if surplus(MOST) <= 0.0:
        return MOST
    return float(brentq(surplus, neutral, MOST, xtol=1e-4)) if surplus(neutral) < 0.0 else neutral


def sensitive(vehicle: Vehicle) -> bool:
    """Return whether unequal loads reduce the tyres' force; else the share does not affect yaw."""
    return any(axle.tyre.load_sensitive for axle in axles(vehicle))


def understeer(vehicle: Vehicle, share: float) -> Iterator[tuple[float, float]]:
    """Yield the understeer angle in each curve, without and with control, rad.

    Front less rear slip angle, on a dry road. Curves beyond grip or wheel lift
    are left out.
    """
    with_control = _angles(vehicle, carried(vehicle, share))
    return zip(_angles(vehicle, (0.0, 0.0)), with_control, strict=False)


def carried(vehicle: Vehicle, share: float) -> tuple[float, float]:
    """Return the actuators' moment of each axle per lateral acceleration, N·m/(m/s²)."""
    moment = CARRIED * vehicle.plant.roll_arm
    return share * moment, (1.0 - share) * moment


def _angles(vehicle: Vehicle, moments: tuple[float, float]) -> list[float]:
    """The understeer angle in each curve that the car holds with these moments."""
    most = most_lateral_acceleration(vehicle, 1.0)
    found: list[float] = []
    for lateral in ACCELERATIONS:
        if lateral > most:
            break
        try:
            front, rear = slip_angles(vehicle, lateral, 1.0, moments)
        except CanrollError:
            break
        found.append(front - rear)
    return found
