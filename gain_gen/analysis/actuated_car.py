"""A linear car with its actuator and the sensors of the loop, continuous."""

from dataclasses import dataclass
from math import pi

import numpy as np

from canroll.gain_gen.models.linear_car import INPUTS, OUTPUTS
from canroll.gain_gen.models.roll import Matrix, moment_input, state_matrix
from canroll.gain_gen.models.state_space import StateSpace
from canroll.vehicles import GRAVITY, RollModel
from canroll.vehicles.equipment import Sensors

SETTLED = 1e-4
"""Least time constant of an actuator, s."""


@dataclass(frozen=True, slots=True)
class ActuatedCar:
    """The car with actuator and sensors, continuous: [car, moment, roll rate, a_y as filtered].

    Attributes:
        a: (n, n).
        command: (n, 1).
        steering: (n, 1), steering-angle input.
        disturbance: roll moment from outside, (n, 1).
        measured: rows of roll rate, a_y, roll, delivered moment as read by the controller, (4, n).
    """

    a: Matrix
    command: Matrix
    steering: Matrix
    disturbance: Matrix
    measured: Matrix


def actuated(car: StateSpace, *, lag: float, sensors: Sensors) -> ActuatedCar:
    """Return ``car`` with a first-order actuator and the low-passes of its two inertial sensors.

    Args:
        car: of any order.
        lag: time constant of the actuator, s.
        sensors: sensors, for their bandwidths.
    """
    n = len(car.a)
    moment, rate, lateral = n, n + 1, n + 2
    a, inputs = np.zeros((n + 3, n + 3)), np.zeros((n + 3, 3))
    a[:n, :n], a[:n, moment] = car.a, car.b[:, 0]
    inputs[:n, 1:] = car.b[:, 1:]
    lag = max(lag, SETTLED)
    a[moment, moment], inputs[moment, 0] = -1.0 / lag, 1.0 / lag
    for state, output, channel in (
        (rate, "roll_rate", sensors.roll_rate),
        (lateral, "imu_lateral", sensors.lateral_acceleration),
    ):
        row, pole = OUTPUTS.index(output), 2.0 * pi * channel.bandwidth
        a[state, :n] = pole * car.c[row]
        a[state, moment] = pole * car.d[row, 0]
        a[state, state] = -pole
        inputs[state, 1:] = pole * car.d[row, 1:]
    measured = np.zeros((4, n + 3))
    measured[0, rate] = measured[1, lateral] = measured[3, moment] = 1.0
    measured[2, :n] = car.c[OUTPUTS.index("roll")]
    steering, disturbance = (inputs[:, INPUTS.index(name)][:, None] for name in INPUTS[1:])
    return ActuatedCar(a, inputs[:, :1], steering, disturbance, measured)


def roll_car(roll: RollModel) -> StateSpace:
    """Return the 1-DOF roll model with the inputs and outputs of a car without lateral motion."""
    b = np.hstack([moment_input(roll), np.zeros((2, 1)), moment_input(roll)])
    c = np.zeros((len(OUTPUTS), 2))
    c[OUTPUTS.index("roll"), 0] = c[OUTPUTS.index("roll_rate"), 1] = 1.0
    c[OUTPUTS.index("imu_lateral"), 0] = GRAVITY
    return StateSpace(state_matrix(roll), b, c, np.zeros((len(OUTPUTS), 3)))
