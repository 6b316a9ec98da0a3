"""Masses, places and velocities of the 14-DOF car's bodies, built from the vehicle's data."""

import numpy as np

from plant_sim.bodies import nonlinear_car as car
from plant_sim.bodies import ports


def pitched(a):
    c, s = np.cos(a), np.sin(a)
    zero = 0 * a
    return np.array([[c, zero, s], [zero, 1 + zero, zero], [-s, zero, c]])


def rolled(a):
    c, s = np.cos(a), np.sin(a)
    zero = 0 * a
    return np.array([[1 + zero, zero, zero], [zero, c, -s], [zero, s, c]])


def vector(*values):
    return np.array(values)


class CarBodies:
    """Masses, places, velocities of all bodies in the heading frame, from the foot of P."""

    def __init__(self, vehicle, state, inputs):
        geometry, mass = vehicle.geometry, vehicle.mass
        bank, grade = inputs[ports.BANK], inputs[ports.GRADE]
        self.up = vector(np.sin(grade), np.sin(bank) * np.cos(grade), np.cos(bank) * np.cos(grade))
        self.turn = state[car.YAW_RATE] * self.up / self.up[2]
        point = vector(0, 0, vehicle.roll_axis_height + state[car.HEAVE])
        velocity = state[[car.VX, car.VY, car.HEAVE_RATE]]
        self.foot = velocity - np.cross(self.turn, point) - vector(0, 0, state[car.HEAVE_RATE])

        pitch, roll = pitched(state[car.PITCH]), rolled(state[car.ROLL])
        body = pitch @ roll
        forward = pitch @ vector(1, 0, 0)
        pitching = self.turn + state[car.PITCH_RATE] * vector(0, 1, 0)
        turning = pitching + state[car.ROLL_RATE] * forward
        arm = body @ vector(0, 0, vehicle.plant.cg_height_above_roll_axis)
        inertia = np.diag(
            [vehicle.plant.inertia_about_cg, mass.pitch_inertia, vehicle.sprung_yaw_inertia]
        )
        self.parts = [
            (
                vehicle.plant.sprung_mass,
                point + arm,
                velocity + np.cross(turning, arm),
                body @ inertia @ body.T @ turning,
                turning,
            )
        ]
        self.rotors, self.hinges, self.hubs = [], [], []
        ahead = geometry.cg_to_front_axle, -geometry.cg_to_rear_axle
        tracks = geometry.half_track_front, geometry.half_track_rear
        heights = geometry.roll_centre_height_front, geometry.roll_centre_height_rear
        masses = mass.unsprung_front, mass.unsprung_rear
        for axle in range(2):
            first = car.TRAVEL + 2 * axle
            left, right = state[first], state[first + 1]
            left_rate, right_rate = state[first + 4], state[first + 5]
            track, height = tracks[axle], heights[axle]
            slide, tilt = -(left + right) / 2, -(left - right) / (2 * track)
            slide_rate, tilt_rate = (
                -(left_rate + right_rate) / 2,
                -(left_rate - right_rate) / (2 * track),
            )
            to_centre = body @ vector(
                ahead[axle] - vehicle.sprung_cg_offset,
                0,
                height - vehicle.roll_axis_height + slide,
            )
            along = body @ vector(0, 0, 1)
            attitude = pitch @ rolled(state[car.ROLL] + tilt)
            to_hubs = attitude @ vector(0, 0, vehicle.tyre.radius - height)
            axle_turning = turning + tilt_rate * forward
            centre_velocity = velocity + np.cross(turning, to_centre) + slide_rate * along
            hub_velocity = centre_velocity + np.cross(axle_turning, to_hubs)
            axle_inertia = masses[axle] * track**2 * np.diag([1.0, 0.0, 1.0])
            self.parts.append(
                (
                    masses[axle],
                    point + to_centre + to_hubs,
                    hub_velocity,
                    attitude @ axle_inertia @ attitude.T @ axle_turning,
                    axle_turning,
                )
            )
            self.hinges.append((point + to_centre, along, forward))
            steer = inputs[ports.STEER] if axle == 0 else 0.0
            axis = attitude @ vector(-np.sin(steer), np.cos(steer), 0)
            for side in range(2):
                out = attitude @ vector(0, track if side == 0 else -track, 0)
                wheel = 2 * axle + side
                self.hubs.append((point + to_centre + to_hubs + out, axis, axle_turning))
                self.rotors.append(
                    (vehicle.tyre.wheel_inertia * state[car.SPIN + wheel], axis, wheel)
                )
                self.hubs[-1] += (hub_velocity + np.cross(axle_turning, out),)

    def momentum(self, parts):
        return sum(m * v for m, _, v, _, _ in parts)

    def moment_of_momentum(self, parts, rotors):
        return sum(np.cross(r, m * v) + h for m, r, v, h, _ in parts) + sum(
            (h * axis for h, axis, _ in rotors), start=np.zeros(3)
        )

    def kinetic_energy(self, state, spin_inertia):
        spins = state[car.SPIN : car.SPIN + 4]
        return (
            sum(0.5 * m * v @ v + 0.5 * h @ w for m, _, v, h, w in self.parts)
            + 0.5 * spin_inertia * spins @ spins
        )

    def height_energy(self, gravity):
        """Potential energy of the weight over a flat road (J)."""
        return sum(gravity * m * r[2] for m, r, *_ in self.parts)
