"""Masses, places and velocities of the 14-DOF car's bodies, built from the vehicle's data."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import nonlinear_car as car
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.world import open_loop
from canroll.vehicles import Vehicle

Array = NDArray[Any]
NOT_TURNED = (0.0, 0.0, 0.0, 0.0)


class Part(NamedTuple):
    """A rigid body: mass, place and velocity of its CG, moment of momentum about that, rate."""

    mass: float
    place: Array
    velocity: Array
    spin: Array
    turning: Array


class Hub(NamedTuple):
    """A wheel: place and velocity of its centre, its axis, rate of its carrier, own momentum."""

    place: Array
    velocity: Array
    axis: Array
    turning: Array
    momentum: Any


class Hinge(NamedTuple):
    """An axle's joint: roll centre, directions of the slide and of the turn."""

    centre: Array
    slide: Array
    turn: Array


def steered(vehicle: Vehicle, steer: float, seconds: float, speed: float = 20.0) -> Any:
    """State and outputs of the 14-DOF car some time after it began to steer, within half a second.

    Steer in rad, speed at first in m/s.
    """
    body = bodies.body("nonlinear")
    state, numbers = body.build(vehicle, speed)
    inputs, outputs = ports.initial_inputs(), np.zeros(ports.N_OUTPUTS)
    for k in range(round(seconds * 1e3)):
        inputs[ports.STEER] = steer * min(k * 2e-3, 1.0)
        open_loop.advance(body.step, state, inputs, numbers, outputs, 1e-3)
    return state, outputs


def pitched(angle: Any) -> Array:
    """Rotation about y; the angle may be complex."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0 * c, s], [0 * c, 1, 0 * c], [-s, 0 * c, c]])


def rolled(angle: Any) -> Array:
    """Rotation about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0 * c, 0 * c], [0 * c, c, -s], [0 * c, s, c]])


def axles_of(vehicle: Vehicle) -> tuple[tuple[float, float, float, float], ...]:
    """Of front and rear axle: place ahead of the CG, half track, roll centre, unsprung mass."""
    geometry, mass = vehicle.geometry, vehicle.mass
    return (
        (
            geometry.cg_to_front_axle,
            geometry.half_track_front,
            geometry.roll_centre_height_front,
            mass.unsprung_front,
        ),
        (
            -geometry.cg_to_rear_axle,
            geometry.half_track_rear,
            geometry.roll_centre_height_rear,
            mass.unsprung_rear,
        ),
    )


class CarBodies:
    """All bodies in a state, real or complex: in the heading frame, from the foot of P."""

    def __init__(
        self,
        vehicle: Vehicle,
        state: Array,
        inputs: Array,
        turned: Sequence[float] | Array = NOT_TURNED,
    ) -> None:
        """``turned`` is what the wheels turn to the left beside the steering (rad)."""
        mass, offset = vehicle.mass, vehicle.sprung_cg_offset
        bank, grade = inputs[ports.BANK], inputs[ports.GRADE]
        self.up = np.array(
            [np.sin(grade), np.sin(bank) * np.cos(grade), np.cos(bank) * np.cos(grade)]
        )
        self.turn = state[car.YAW_RATE] * self.up / self.up[2]
        velocity = state[[car.VX, car.VY, car.HEAVE_RATE]]
        point = np.array([0, 0, vehicle.roll_axis_height + state[car.HEAVE]])
        self.foot = velocity - np.cross(self.turn, point)
        self.foot = self.foot - np.array([0, 0, state[car.HEAVE_RATE]])

        pitch = pitched(state[car.PITCH])
        body = pitch @ rolled(state[car.ROLL])
        forward, upward = pitch @ np.array([1, 0, 0]), body @ np.array([0, 0, 1])
        turning = self.turn + state[car.PITCH_RATE] * np.array([0, 1, 0])
        turning = turning + state[car.ROLL_RATE] * forward
        arm = vehicle.plant.cg_height_above_roll_axis * upward
        inertia = np.diag(
            [vehicle.plant.inertia_about_cg, mass.pitch_inertia, vehicle.sprung_yaw_inertia]
        )
        self.parts = [
            Part(
                vehicle.plant.sprung_mass,
                point + arm,
                velocity + np.cross(turning, arm),
                body @ inertia @ body.T @ turning,
                turning,
            )
        ]
        self.hinges: list[Hinge] = []
        self.hubs: list[Hub] = []
        for axle, (ahead, track, height, unsprung) in enumerate(axles_of(vehicle)):
            first = car.TRAVEL + 2 * axle
            left, right, left_rate, right_rate = state[[first, first + 1, first + 4, first + 5]]
            tilt, tilt_rate = -(left - right) / (2 * track), -(left_rate - right_rate) / (2 * track)
            down = height - vehicle.roll_axis_height - (left + right) / 2
            to_centre = body @ np.array([ahead - offset, 0, down])
            moved = np.cross(turning, to_centre) - (left_rate + right_rate) / 2 * upward
            attitude = pitch @ rolled(state[car.ROLL] + tilt)
            axle_turning = turning + tilt_rate * forward
            to_hubs = attitude @ np.array([0, 0, vehicle.tyre.radius - height])
            middle = point + to_centre + to_hubs
            middle_velocity = velocity + moved + np.cross(axle_turning, to_hubs)
            axle_inertia = unsprung * track**2 * np.diag([1.0, 0.0, 1.0])
            spin = attitude @ axle_inertia @ attitude.T @ axle_turning
            self.parts.append(Part(unsprung, middle, middle_velocity, spin, axle_turning))
            self.hinges.append(Hinge(point + to_centre, upward, forward))
            steer = inputs[ports.STEER] if axle == 0 else 0.0
            for side in range(2):
                angle = steer + turned[2 * axle + side]
                axis = attitude @ np.array([-np.sin(angle), np.cos(angle), 0])
                out = attitude @ np.array([0, track if side == 0 else -track, 0])
                own = vehicle.tyre.wheel_inertia * state[car.SPIN + 2 * axle + side]
                hub_velocity = middle_velocity + np.cross(axle_turning, out)
                self.hubs.append(Hub(middle + out, hub_velocity, axis, axle_turning, own))

    def momentum(self, parts: Sequence[int] = (0, 1, 2)) -> Array:
        """Momentum of the body (0) and the axles (1, 2)."""
        moved: Array = sum(
            (self.parts[i].mass * self.parts[i].velocity for i in parts), start=np.zeros(3)
        )
        return moved

    def moment_of_momentum(self, parts: Sequence[int] = (0, 1, 2)) -> Array:
        """The same about the foot of P, that of an axle with its wheels."""
        total: Array = np.zeros(3)
        for i in parts:
            part = self.parts[i]
            total = total + np.cross(part.place, part.mass * part.velocity) + part.spin
            for hub in self.hubs[2 * i - 2 : 2 * i] if i else ():
                total = total + hub.momentum * hub.axis
        return total

    def kinetic_energy(self, wheel_inertia: float) -> Any:
        """Kinetic energy of all (J)."""
        moving = sum(
            0.5 * part.mass * part.velocity @ part.velocity + 0.5 * part.spin @ part.turning
            for part in self.parts
        )
        return moving + sum(0.5 * hub.momentum**2 / wheel_inertia for hub in self.hubs)

    def height_energy(self, gravity: float) -> float:
        """Potential energy of the weight over a flat road (J)."""
        return float(sum(gravity * part.mass * part.place[2] for part in self.parts))
