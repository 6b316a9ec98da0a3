"""Tyre forces: magic formula with similarity, load-sensitive grip and cornering stiffness.

Both slips are scaled by their stiffness and by the grip, their resultant goes through one curve,
and the force points along it (Pacejka, Tire and Vehicle Dynamics, section 4.2): at small slip the
tyre is linear in each direction, at large slip the resultant is the friction circle's.
"""

from math import atan, sin, sqrt

from plant_sim.kernels.jit import njit

LEAST = 0.25
"""Share of grip and of stiffness per load that is left at any overload."""


@njit
def falling(ratio: float, slope: float) -> float:
    """Factor that falls by ``slope`` for each unit of ``ratio`` = load over static load above 1."""
    return max(1.0 - slope * (ratio - 1.0), LEAST)


@njit
def curve(slip: float, shape: float, curvature: float) -> float:
    """Magic formula with unit peak and unit slope at the origin; ``slip`` >= 0."""
    x = slip / shape
    return sin(shape * atan(x - curvature * (x - atan(x))))


@njit
def forces(
    linear_x: float, linear_y: float, limit: float, shape: float, curvature: float
) -> tuple[float, float]:
    """Longitudinal and lateral force (N).

    ``linear_x`` and ``linear_y`` are the forces of an unlimited tyre, stiffness times slip (N);
    ``limit`` is the peak of the resultant, μ F_z (N).
    """
    demand = sqrt(linear_x * linear_x + linear_y * linear_y)
    if limit <= 0.0 or demand == 0.0:
        return 0.0, 0.0
    share = limit * curve(demand / limit, shape, curvature) / demand
    return share * linear_x, share * linear_y
