"""Momentum, moment of momentum and energy of the 14-DOF car: what acts on them, how they change.

Positions and velocities of all bodies are built here from the vehicle's data by rotation matrices;
their rates of change are complex-step derivatives along the kernel's rates.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from canroll.plant_sim.bodies import nonlinear_car as car
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.bodies.parameters import build_parameters
from canroll.vehicles import GRAVITY as G
from canroll.vehicles import Vehicle
from support.car_bodies import Array, CarBodies

STEP = 1e-30


def vector(*values: float) -> Array:
    return np.array(values)


class Balance:
    """A car in one state: what acts on it, and how its momenta and its energy change."""

    def __init__(
        self,
        vehicle: Vehicle,
        state: Array,
        inputs: Array,
        turned: Array,
    ) -> None:
        """``turned`` is what the wheels turn to the left beside the steering (rad)."""
        self.vehicle, self.state, self.inputs, self.turned = vehicle, state, inputs, turned
        self.parameters = build_parameters(self.vehicle)
        self.rate, self.results = np.zeros(car.N_STATES), np.zeros(car.N_RESULTS)
        car.evaluate(state, inputs, self.parameters, self.rate, self.results)
        self.bodies = CarBodies(vehicle, state, inputs, turned)
        self.weight = -G * self.bodies.up
        self.road = [self._road(wheel) for wheel in range(4)]

    def change(self, of: Callable[[CarBodies], Any]) -> Any:
        """Derivative in time of a function of the bodies, its axes being the heading frame's."""
        shifted = CarBodies(
            self.vehicle, self.state + 1j * STEP * self.rate, self.inputs, self.turned
        )
        return np.imag(of(shifted)) / STEP

    def inertial(self, of: Callable[[CarBodies], Any]) -> Any:
        """The same of a vector, in inertial axes."""
        return self.change(of) + np.cross(self.bodies.turn, of(self.bodies))

    def about_foot(self, *parts: int) -> Any:
        """Moment needed about the foot of P, which moves."""
        change = self.inertial(lambda b: b.moment_of_momentum(parts))
        return change + np.cross(self.bodies.foot, self.bodies.momentum(parts))

    def _road(self, wheel: int) -> dict[str, Any]:
        """Place, force and couple of the road on a wheel, velocities there."""
        hub, velocity, axis, turning, _ = self.bodies.hubs[wheel]
        lean = axis[2]
        above = hub[2] - self.inputs[ports.ROAD_HEIGHT + wheel]
        down = -above / (1 - lean**2) * (vector(0, 0, 1) - lean * axis)
        ahead = np.cross(axis, [0, 0, 1])
        ahead /= np.linalg.norm(ahead)
        load, longitudinal, lateral, couple = (
            self.results[slot + wheel]
            for slot in (car.R_LOAD, car.R_LONGITUDINAL, car.R_LATERAL, car.R_COUPLE)
        )
        force = longitudinal * ahead + lateral * np.cross([0, 0, 1], ahead) + load * vector(0, 0, 1)
        without_spin = turning - (turning @ axis) * axis
        return {
            "at": hub + down,
            "force": force,
            "couple": couple * axis,
            "slip": velocity + np.cross(without_spin, down),
            "about": axis @ np.cross(down, force) + couple,
            "relative": self.state[car.SPIN + wheel] - turning @ axis,
        }

    @property
    def wind(self) -> tuple[Array, Array]:
        """Force of the wind, and its moment about the foot of P."""
        force = vector(0, self.inputs[ports.WIND_FORCE], 0)
        about_cg = vector(self.inputs[ports.WIND_ROLL], 0, self.inputs[ports.WIND_YAW])
        return force, about_cg - np.cross([self.vehicle.sprung_cg_offset, 0, 0], force)

    def force(self) -> Any:
        """Force from outside."""
        on_wheels = sum(road["force"] for road in self.road)
        return on_wheels + self.vehicle.total_mass * self.weight + self.wind[0]

    def moment(self) -> Any:
        """Moment from outside about the foot of P."""
        on_wheels = sum(np.cross(road["at"], road["force"]) + road["couple"] for road in self.road)
        weights = (np.cross(p.place, p.mass * self.weight) for p in self.bodies.parts)
        return on_wheels + sum(weights) + self.wind[1]

    def power(self) -> Any:
        """Power of all forces."""
        spins = self.state[car.SPIN : car.SPIN + 4]
        total = sum(p.mass * self.weight @ p.velocity for p in self.bodies.parts)
        body, (force, moment) = self.bodies.parts[0], self.wind
        at_foot = body.velocity - np.cross(body.turning, body.place)
        total += force @ at_foot + moment @ body.turning
        for wheel, road in enumerate(self.road):
            total += road["force"] @ road["slip"] + road["about"] * spins[wheel]
            total += self.results[car.R_SHAFT + wheel] * road["relative"]
            total += self.results[car.R_CORNER + wheel] * self.state[car.TRAVEL_RATE + wheel]
        return total
