"""Response of the loop to the driver's steering: moment and roll, by frequency and as RMS."""

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from canroll import dbc
from canroll.gain_gen.analysis.family import Family, Member, car_in
from canroll.gain_gen.models.linear_car import INPUTS, OUTPUTS
from canroll.gain_gen.models.roll import Matrix
from canroll.gain_gen.models.state_space import Complex, resolvent
from canroll.vehicles import Vehicle

STEERING_FREQUENCY = 2.0 * pi * 0.5
STEERING_DAMPING = 0.7
"""The driver's steering is white noise behind a second-order low-pass: that of a lane change."""
FASTEST_STEERING = 2.0 * pi * 4.0
"""Upper limit of a driver's steering, rad/s, far below the Nyquist frequency of every tick."""
STEERING_AGE = 0.5 * (dbc.period("VehicleMotion") - dbc.period("Imu"))
"""Mean additional age of the steering angle relative to the inertial sample, s."""

_ROLL = 2


@dataclass(frozen=True, slots=True)
class SteeringResponse:
    """Responses of one car and delay to the road-wheel angle and to the command.

    Attributes:
        frequencies: rad/s, (m,).
        weights: weights of the squared magnitudes in a mean square, (m,), normalised to an RMS
            lateral acceleration of 1 m/s² without control.
        readings: controller inputs per road-wheel angle, (m, 4).
        from_steering: steady lateral acceleration per angle as the ECU computes it, (m,).
        commanded: controller inputs per command, (m, 4).
    """

    frequencies: Matrix
    weights: Matrix
    readings: Complex
    from_steering: Complex
    commanded: Complex

    def moment(self, feedback: Complex, steering: Complex) -> Complex:
        """Return the command per angle.

        Args:
            feedback: command per reading, (m, 4).
            steering: command per lateral acceleration from steering, (m,).
        """
        loop = 1.0 - np.sum(feedback * self.commanded, axis=1)
        driven = np.sum(feedback * self.readings, axis=1) + steering * self.from_steering
        return np.asarray(driven / loop)

    def rolled(self, moment: Complex) -> Complex:
        """Return the roll angle per road-wheel angle, given the command per road-wheel angle."""
        return np.asarray(self.readings[:, _ROLL] + self.commanded[:, _ROLL] * moment)

    def rms(self, response: Complex) -> float:
        """Return the RMS of a response per m/s² of lateral acceleration."""
        return sqrt(float(np.sum(self.weights * np.abs(response) ** 2)))


def steering_response(
    family: Family, vehicle: Vehicle, delay: float, member: Member | None = None
) -> SteeringResponse:
    """Return the responses of a member of the family, the nominal one if none is given.

    Args:
        family: of ``vehicle``.
        vehicle: vehicle with the steering gain known to the ECU.
        delay: one of the family's, s.
        member: of the family.
    """
    member = member or family.members[0]
    slow = family.frequencies <= FASTEST_STEERING
    frequencies = family.frequencies[slow]
    plant = member.plant
    steered = resolvent(plant.a, plant.steering, 1j * frequencies)
    readings = np.asarray(plant.measured @ steered)[:, :, 0]
    speed = member.condition.speed
    lateral = car_in(vehicle, member.condition).response(frequencies)[
        :, OUTPUTS.index("lateral_acceleration"), INPUTS.index("steering")
    ]
    s = 1j * frequencies
    shape = STEERING_FREQUENCY**2 / (
        s**2 + 2.0 * STEERING_DAMPING * STEERING_FREQUENCY * s + STEERING_FREQUENCY**2
    )
    weights = np.abs(shape) ** 2 * np.gradient(frequencies)
    weights = weights / np.sum(weights * np.abs(lateral) ** 2)
    from_steering = vehicle.lateral_gain(speed) * np.exp(-s * STEERING_AGE)
    commanded = member.commanded(delay)[slow]
    return SteeringResponse(frequencies, weights, readings, from_steering, commanded)
