"""Tyre forces: magic formula with similarity, load-sensitive grip and cornering stiffness.

Both slips are scaled by their stiffness and by the grip, their resultant goes through one curve,
and the force points along it (Pacejka, Tire and Vehicle Dynamics, section 4.2): at small slip the
tyre is linear in each direction, at large slip the resultant is the friction circle's.
"""

from math import atan, sin, sqrt

from plant_sim.kernels.jit import inlined

LEAST = 0.25
"""Share of grip and of stiffness per load that is left at any overload."""


@inlined
def falling(ratio: float, slope: float) -> float:
    """Factor that falls by ``slope`` for each unit of ``ratio`` = load over static load above 1."""
    return max(1.0 - slope * (ratio - 1.0), LEAST)


@inlined
def curve(slip: float, shape: float, curvature: float) -> float:
    """Magic formula with unit peak and unit slope at the origin; ``slip`` >= 0."""
    x = slip / shape
    return sin(shape * atan(x - curvature * (x - atan(x))))


@inlined
def resultant(linear_x: float, linear_y: float, limit: float) -> float:
    """Resultant slip: 1 where the unlimited tyre's force is ``limit``; 0 without grip."""
    demand = sqrt(linear_x * linear_x + linear_y * linear_y)
    return demand / limit if limit > 0.0 else 0.0


@inlined
def share(slip: float, shape: float, curvature: float) -> float:
    """Share of an unlimited tyre's force that is left at this resultant slip."""
    return curve(slip, shape, curvature) / slip if slip > 0.0 else 0.0


@inlined
def forces(
    linear_x: float, linear_y: float, limit: float, shape: float, curvature: float
) -> tuple[float, float]:
    """Longitudinal and lateral force (N).

    ``linear_x`` and ``linear_y`` are the forces of an unlimited tyre, stiffness times slip (N);
    ``limit`` is the peak of the resultant, μ F_z (N).
    """
    part = share(resultant(linear_x, linear_y, limit), shape, curvature)
    return part * linear_x, part * linear_y
