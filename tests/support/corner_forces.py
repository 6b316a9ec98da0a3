"""Forces at a car's corners, written from their definitions and not from the plant's code."""

from math import atan, sin

import numpy as np

from canroll.vehicles import GRAVITY, Vehicle
from canroll.vehicles.roll_stiffness import axle_roll_shares, suspension_roll_stiffness

SLOWEST = 4.0
"""Speed (m/s) that slips are at least referred to."""

SLOWEST_ROLLING = 8.0
"""Speed (m/s) with which a tyre relaxes at least."""


def static_loads(vehicle: Vehicle) -> np.ndarray:
    """Loads of the front and the rear wheels (N, each) of the car at rest on a flat road."""
    geometry = vehicle.geometry
    levers = np.array([geometry.cg_to_rear_axle, geometry.cg_to_front_axle])
    return vehicle.total_mass * GRAVITY * levers / (2 * geometry.wheelbase)


class Suspension:
    """Springs, dampers, stops and anti-roll bar of one axle."""

    def __init__(self, vehicle: Vehicle, axle: int) -> None:
        data, mass = vehicle.suspension, vehicle.mass
        self.data = data
        self.half_track = (vehicle.geometry.half_track_front, vehicle.geometry.half_track_rear)[
            axle
        ]
        unsprung = (mass.unsprung_front, mass.unsprung_rear)[axle]
        self.preload = static_loads(vehicle)[axle] - unsprung / 2 * GRAVITY
        self.spring = (data.spring_rate_front, data.spring_rate_rear)[axle]
        roll_stiffness = axle_roll_shares(vehicle)[axle] * suspension_roll_stiffness(vehicle)
        self.bar = roll_stiffness - 2 * self.spring * self.half_track**2
        share = data.roll_damping_front_share
        share = share if axle == 0 else 1 - share
        mean = share * vehicle.plant.roll_damping / (2 * self.half_track**2)
        # bump and rebound have the mean of the linear damper and the ratio of the file
        self.bump = 2 * mean / (1 + data.rebound_bump_ratio)
        self.rebound = self.bump * data.rebound_bump_ratio

    def damping(self, rate: float) -> float:
        """Force (N) against the travel's ``rate`` (m/s), linear up to the knee and beyond it."""
        slope = self.rebound if rate > 0 else self.bump
        knee = self.data.knee_speed
        slow = np.clip(rate, -knee, knee)
        return slope * float(slow + self.data.high_speed_ratio * (rate - slow))

    def stops(self, travel: float) -> float:
        """Force (N) of the stops, pushing body and axle apart where > 0."""
        into_bump = max(-travel - self.data.bump_clearance, 0.0)
        into_rebound = max(travel - self.data.rebound_clearance, 0.0)
        return self.data.bump_stop_rate * (into_bump**2 - into_rebound**2)

    def forces(
        self, travel: np.ndarray, rate: np.ndarray, actuators: np.ndarray, bar_moment: float
    ) -> np.ndarray:
        """Forces (N) that push body and axle apart, left and right."""
        track = 2 * self.half_track
        bar = (bar_moment - self.bar * (travel[0] - travel[1]) / track) / track
        return np.array(
            [
                self.preload
                - self.spring * travel[side]
                - self.damping(rate[side])
                + self.stops(travel[side])
                + (bar, -bar)[side]
                + actuators[side]
                for side in range(2)
            ]
        )


class Tyre:
    """One tyre of an axle."""

    def __init__(self, vehicle: Vehicle, axle: int) -> None:
        self.data = vehicle.tyre
        self.static = float(static_loads(vehicle)[axle])
        cornering = (self.data.cornering_stiffness_front, self.data.cornering_stiffness_rear)
        self.cornering = cornering[axle] / 2
        self.free_radius = self.data.radius + self.static / self.data.vertical_stiffness

    def normal(self, loaded_radius: float, rate: float, slant: float) -> float:
        """Force (N) along the road's normal; ``slant`` is the cosine of the camber."""
        squeeze = self.free_radius - loaded_radius
        if squeeze <= 0:
            return 0.0
        radial = self.data.vertical_stiffness * squeeze - self.data.vertical_damping * rate
        return max(radial / slant, 0.0)

    def horizontal(
        self, load: float, friction: float, along: float, spin: float, side_slip: float
    ) -> tuple[float, float]:
        """Longitudinal and lateral force (N): magic formula by similarity (Pacejka, 4.2)."""
        if load <= 0:
            return 0.0, 0.0
        tyre, overload = self.data, load / self.static - 1
        peak = friction * tyre.friction * max(1 - tyre.friction_load_slope * overload, 0.25) * load
        softening = max(1 - tyre.cornering_load_slope * overload, 0.25)
        slip = (spin * tyre.radius - along) / max(abs(along), SLOWEST)
        linear = np.array([tyre.longitudinal_stiffness * slip, self.cornering * side_slip])
        linear *= load / self.static
        linear[1] *= softening
        demand = float(np.hypot(*linear))
        if demand == 0 or peak == 0:
            return 0.0, 0.0
        stretched = demand / peak / tyre.shape
        bent = stretched - tyre.curvature * (stretched - atan(stretched))
        force = peak * sin(tyre.shape * atan(bent)) * linear / demand
        return float(force[0]), float(force[1])

    def relaxation(self, along: float, across: float, side_slip: float) -> float:
        """Rate of the lateral slip (1/s), which follows the steady one over a length."""
        steady = -across / max(abs(along), SLOWEST)
        return max(abs(along), SLOWEST_ROLLING) * (steady - side_slip) / self.data.relaxation_length
