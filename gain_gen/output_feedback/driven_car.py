"""The exact sampled car with its driver: the design model of dynamic output feedback.

The linear car reduced to eight states, its actuator, the sensors' low-passes, the hold, the
fractional delay and the commands under way. The driver's steering is white noise behind a
second-order low-pass, and the ECU knows the angle. In addition the front wheels turn by a slow
unknown angle, which represents all deviations of tyres, friction and speed from the model. Because
of it the estimate does not rely on steering for slow motion, so that no such error biases the
moment.
"""

from dataclasses import dataclass
from math import degrees, pi, sqrt

import numpy as np

from canroll.gain_gen.analysis.actuated_car import actuated
from canroll.gain_gen.analysis.family import NOMINAL, Family, car_in
from canroll.gain_gen.analysis.held_plant import held
from canroll.gain_gen.analysis.steering_response import STEERING_DAMPING, STEERING_FREQUENCY
from canroll.gain_gen.models.controller import Y_LATERAL, Y_RATE, Y_ROLL
from canroll.gain_gen.models.reduction import reduced
from canroll.gain_gen.models.roll import Matrix, zero_order_hold
from canroll.gain_gen.models.task import Task

CAR_ORDER = 8
"""States of the reduced car: fewer lose the accelerometer, see :func:`reduced`."""
MOMENT_UNIT = 1e3
"""Commands are counted in kN·m, roll angles in degrees: the solvers need numbers near one."""
STEERING = 0.02
"""Standard deviation of the road-wheel angle, rad."""
UNKNOWN_STEERING = 0.02
UNKNOWN_FREQUENCY = 2.0 * pi * 0.1
"""Standard deviation (rad) and corner (rad/s) of the unmeasured steering disturbance."""
DISTURBANCE = 100.0
"""Density of the roll moment on the body from outside, N·m per √Hz."""
LEAST_NOISE = (0.01, 0.1, 0.05)
"""Standard deviations of a sample of roll rate (rad/s), a_y and steering a_y (m/s²), at least:
the road's part in them, and the steering's age."""
RATE_WEIGHT = 0.1
"""Weight of the roll rate relative to the roll angle, s."""


@dataclass(frozen=True, slots=True)
class DrivenCar:
    """x⁺ = A x + B₁ w + B₂ u, z = C₁ x, y = C₂ x + noise.

    The plant's states come first, then steering and its rate, the unknown angle, and the commands
    under way, the oldest first.

    Attributes:
        a: (n, n).
        driven: B₁ of steering, unknown angle and roll moment as unit white noise, (n, 3).
        command: B₂, per kN·m, (n, 1).
        rolled: C₁, roll angle and weighted roll rate, deg, (2, n).
        measured: C₂, roll rate, accelerometer and a_y by steering, SI, (3, n).
        noise: standard deviations of those, (3,).
        tick: s.
    """

    a: Matrix
    driven: Matrix
    command: Matrix
    rolled: Matrix
    measured: Matrix
    noise: Matrix
    tick: float


def driven_car(task: Task, family: Family) -> DrivenCar:
    """Return the nominal car of ``family`` behind its middle delay.

    Raises:
        CanrollError: the data sheet does not define such a car.
    """
    vehicle, tick = task.vehicle, task.tick
    car = reduced(car_in(vehicle, NOMINAL), CAR_ORDER)
    plant = actuated(car, lag=task.lag, sensors=vehicle.sensors)
    n = len(plant.a)
    angle, rate, unknown, size = n, n + 1, n + 2, n + 3
    a, noise = np.zeros((size, size)), np.zeros((size, 3))
    a[:n, :n] = plant.a
    a[:n, angle] = a[:n, unknown] = plant.steering[:, 0]
    a[angle, rate] = 1.0
    a[rate, angle] = -(STEERING_FREQUENCY**2)
    a[rate, rate] = -2.0 * STEERING_DAMPING * STEERING_FREQUENCY
    a[unknown, unknown] = -UNKNOWN_FREQUENCY
    noise[rate, 0] = STEERING * sqrt(4.0 * STEERING_DAMPING * STEERING_FREQUENCY**3)
    noise[unknown, 1] = UNKNOWN_STEERING * sqrt(2.0 * UNKNOWN_FREQUENCY)
    noise[:n, 2] = DISTURBANCE * plant.disturbance[:, 0]
    entering = np.zeros((size, 1))
    entering[:n] = MOMENT_UNIT * plant.command

    pure = max(family.delays[len(family.delays) // 2] - family.members[0].filtered, 0.0)
    sampled = held(a, entering, tick=tick, delay=pure)
    phi, command = sampled.delayed()
    lines = sampled.steps
    driven = np.zeros((size + lines, 3))
    # white noise over a tick acts almost as its mean held: the car moves slowly against the tick
    driven[:size] = zero_order_hold(a, noise, tick)[1] / sqrt(tick)

    rolled, measured = np.zeros((2, size + lines)), np.zeros((3, size + lines))
    rolled[0, :n] = degrees(1.0) * plant.measured[Y_ROLL]
    rolled[1, :n] = degrees(RATE_WEIGHT) * plant.measured[Y_RATE]
    measured[0, :n], measured[1, :n] = plant.measured[Y_RATE], plant.measured[Y_LATERAL]
    measured[2, angle] = vehicle.lateral_gain(NOMINAL.speed)
    known = (task.noise.roll_rate, task.noise.lateral, 0.0)
    return DrivenCar(
        a=phi,
        driven=driven,
        command=command,
        rolled=rolled,
        measured=measured,
        noise=np.maximum(known, LEAST_NOISE),
        tick=tick,
    )
