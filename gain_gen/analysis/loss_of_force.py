"""From which lateral acceleration on a car tips when it loses all its roll moment at once.

The body, held at a roll that a moment M keeps smaller, goes to the roll of the car without control,
φ = m h a / (k − m g h), and overshoots by o M / (k − m g h), o = exp(−π ζ / √(1 − ζ²)). At that
peak its tyres carry the centrifugal moment, the weight beside the middle and what brings the body
back: both inner wheels lift where

    m_t H a + m h g (m h a + o M) / (k − m g h) + o M = m_t g s,

with the total mass m_t, the height H of its centre of gravity and the mean half track s.
"""

from math import exp, pi, sqrt

from canroll.vehicles import Vehicle
from canroll.vehicles.model import GRAVITY


def overshoot(damping_ratio: float) -> float:
    """Return by how much of its way a step of the moment makes the body overshoot."""
    if damping_ratio >= 1.0:
        return 0.0
    return exp(-pi * damping_ratio / sqrt(1.0 - damping_ratio**2))


def tipping_acceleration(vehicle: Vehicle, moment: float) -> float:
    """Return the lateral acceleration (m/s²) from which on both inner wheels lift.

    Args:
        vehicle: whose design model is taken.
        moment: roll moment that is lost at once, N·m; 0: of the car without control.
    """
    roll = vehicle.design
    lean = roll.roll_arm * GRAVITY / roll.effective_stiffness
    lost = overshoot(roll.damping_ratio) * abs(moment)
    half_track = vehicle.static_stability_factor * vehicle.cg_height
    left = vehicle.total_mass * GRAVITY * half_track - lost * (1.0 + lean)
    return left / (vehicle.total_mass * vehicle.cg_height + roll.roll_arm * lean)


def warnings(vehicle: Vehicle, largest: float) -> tuple[str, ...]:
    """Return the warning of losing at once the moment of a curve at the tyres' limit.

    Args:
        vehicle: whose design model is taken.
        largest: moment of its actuators, N·m.

    Returns:
        One line; none where the tyres do not hold so much, or the car tips without control too.
    """
    held = vehicle.tyre.friction * GRAVITY
    moment = min(largest, vehicle.design.roll_arm * held)
    with_it, alone = tipping_acceleration(vehicle, moment), tipping_acceleration(vehicle, 0.0)
    if with_it >= min(held, alone):
        return ()
    return (
        f"{moment:.0f} N·m of roll moment lost at once lift both inner wheels from "
        f"{with_it:.1f} m/s² on; without control {alone:.1f}, tyres hold {held:.1f}",
    )
