"""The loop on the linear car, exactly, over a family of conditions and delays: margins, worst.

Car, actuator lag, sensor low-passes, hold, fractional delay, delay line and the ECU's own
arithmetic. What the controller makes of a measured lateral acceleration is feedback like any other:
the moment moves the car sideways, and rolls the accelerometer.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, pi

import numpy as np

from gain_gen.analysis.held_plant import (
    Complex,
    HeldPlant,
    command_response,
    held,
    opened,
    resolvent_rows,
)
from gain_gen.analysis.margins import Margins, nyquist_margins
from gain_gen.analysis.sampled_loop import Loop
from gain_gen.models.controller import Controller, matrices
from gain_gen.models.linear_car import INPUTS, OUTPUTS, LinearModel, linear_car
from gain_gen.models.roll import Matrix, zero_order_hold
from gain_gen.models.task import Delay, Task
from gain_gen.models.trim import most_lateral_acceleration
from vehicles import Vehicle
from vehicles.equipment import Sensors
from vehicles.unladen import unladen

KMH = 1.0 / 3.6
LINEAR_SHARE = 0.9
"""Of the hardest steady curve: a vehicle that cannot take the family's curve is tested in this."""
SETTLED = 1e-4
"""Least time constant of an actuator, s."""


@dataclass(frozen=True, slots=True)
class Condition:
    """How a vehicle drives.

    Attributes:
        load: "laden" or "empty".
        speed: m/s.
        lateral_acceleration: of a steady curve, m/s²; zero is straight running.
        friction: of the road.
    """

    load: str
    speed: float
    lateral_acceleration: float = 0.0
    friction: float = 1.0

    def __str__(self) -> str:
        text = f"{self.load}, {self.speed / KMH:.0f} km/h"
        if self.lateral_acceleration:
            text += f", curve of {self.lateral_acceleration:.2g} m/s²"
        return text if self.friction == 1.0 else f"{text}, friction {self.friction:g}"


NOMINAL = Condition("laden", 80 * KMH)
CONDITIONS = (
    NOMINAL,
    Condition("laden", 40 * KMH),
    Condition("laden", 120 * KMH),
    Condition("empty", 40 * KMH),
    Condition("empty", 80 * KMH),
    Condition("empty", 120 * KMH),
    Condition("laden", 80 * KMH, 4.0),
    Condition("laden", 80 * KMH, 6.0),
    Condition("laden", 80 * KMH, 3.2, 0.5),
    Condition("empty", 80 * KMH, 3.2, 0.5),
)
"""What every design is checked on. Low friction changes the car only in a curve."""


def car_in(vehicle: Vehicle, condition: Condition) -> LinearModel:
    """Return the linear car of ``vehicle`` in ``condition``; a curve beyond its grip is cut back.

    Raises:
        CanrollError: the data sheet makes no such car.
    """
    loaded = unladen(vehicle) if condition.load == "empty" else vehicle
    curve = condition.lateral_acceleration
    if curve:
        most = most_lateral_acceleration(loaded, condition.friction)
        curve = min(curve, LINEAR_SHARE * most)
    return linear_car(
        loaded, condition.speed, lateral_acceleration=curve, friction=condition.friction
    )


@dataclass(frozen=True, slots=True)
class ActuatedCar:
    """The car with actuator and sensors, continuous: [car, moment, roll rate, a_y as filtered].

    Attributes:
        a: (n, n).
        command: (n, 1).
        steering: (n, 1), the accelerometer's feedthrough to it neglected by none of the states.
        disturbance: roll moment from outside, (n, 1).
        measured: roll rate, a_y, roll, delivered moment as the controller reads them, (4, n).
    """

    a: Matrix
    command: Matrix
    steering: Matrix
    disturbance: Matrix
    measured: Matrix


def actuated(car: LinearModel, *, lag: float, sensors: Sensors) -> ActuatedCar:
    """Return ``car`` with a first-order actuator and the low-passes of its two inertial sensors.

    Args:
        car: of any order.
        lag: of the actuator, s.
        sensors: for their bandwidths.
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


@dataclass(frozen=True)
class Member:
    """One condition of the family at all delays.

    Attributes:
        condition: of the car.
        plant: with actuator and sensors.
        held: the plant at the tick, by delay in s.
        frequencies: of the responses, rad/s.
    """

    condition: Condition
    plant: ActuatedCar
    held: dict[float, HeldPlant]
    frequencies: Matrix

    @cached_property
    def _rows(self) -> Complex:
        plant = next(iter(self.held.values()))
        return resolvent_rows(plant.phi, self.plant.measured, self._z(plant))

    def _z(self, plant: HeldPlant) -> Complex:
        return np.asarray(np.exp(1j * self.frequencies * plant.tick), dtype=complex)

    def commanded(self, delay: float) -> Complex:
        """Return what the controller reads per command, (frequencies, 4)."""
        plant = self.held[delay]
        return command_response(plant, self._rows, self._z(plant))

    @cached_property
    def disturbed(self) -> Complex:
        """What the controller reads per roll moment on the body, held, (frequencies, 4)."""
        plant = next(iter(self.held.values()))
        column = zero_order_hold(self.plant.a, self.plant.disturbance, plant.tick)[1]
        return np.asarray((self._rows @ column)[:, :, 0])

    def loop(self, controller: Controller, delay: float) -> Loop:
        """Return the loop as matrices, cut at the command."""
        plant = self.held[delay]
        a, b, c = opened(plant, controller, self.plant.measured)
        noise = np.zeros((len(a), 1))
        noise[: len(plant.phi)] = zero_order_hold(self.plant.a, self.plant.disturbance, plant.tick)[
            1
        ]
        return Loop(a, b, c, noise, plant.tick)


@dataclass(frozen=True, slots=True)
class FamilyRow:
    """Margins of one member at one delay (s)."""

    condition: Condition
    delay: float
    margins: Margins

    def __str__(self) -> str:
        return f"{self.condition}, delay {1e3 * self.delay:.4g} ms"


@dataclass(frozen=True, slots=True)
class FamilyMargins:
    """Margins over the family: every member at every delay."""

    rows: tuple[FamilyRow, ...]

    @property
    def worst_gain(self) -> FamilyRow:
        """The row of least gain margin."""
        return min(self.rows, key=lambda row: row.margins.gain_db)

    @property
    def worst_sensitivity(self) -> FamilyRow:
        """The row of greatest Ms; among unstable ones that of least gain margin."""
        return max(self.rows, key=lambda row: (row.margins.sensitivity, -row.margins.gain_db))

    @property
    def stable(self) -> bool:
        """Whether every loop is."""
        return self.worst_sensitivity.margins.sensitivity < inf


@dataclass(frozen=True, slots=True)
class Family:
    """Cars in several conditions behind the delays of a task, with their responses.

    Attributes:
        members: by condition, the nominal one first.
        delays: least, middle and longest from sample to force, s, the sensor's low-pass included.
        frequencies: of all responses, rad/s.
        tick: s.
    """

    members: tuple[Member, ...]
    delays: tuple[float, ...]
    frequencies: Matrix
    tick: float

    def controller_response(self, controller: Controller) -> Complex:
        """Return the command per reading, (frequencies, 4)."""
        a, b, c, d = matrices(controller)
        if not len(a):
            return np.broadcast_to(d.astype(complex), (len(self.frequencies), 4))
        z = np.exp(1j * self.frequencies * self.tick)
        return np.asarray((resolvent_rows(a, c, z) @ b + d)[:, 0], dtype=complex)

    def margins(self, controller: Controller) -> FamilyMargins:
        """Return gain margin, phase margin and Ms of every member at every delay."""
        response = self.controller_response(controller)
        rows = []
        for member in self.members:
            for delay in self.delays:
                gain = -np.sum(response * member.commanded(delay), axis=1)
                loop = member.loop(controller, delay)
                found = nyquist_margins(self.frequencies, gain, loop)
                rows.append(FamilyRow(member.condition, delay, found))
        return FamilyMargins(tuple(rows))


def grid(tick: float) -> Matrix:
    """Return frequencies to the Nyquist frequency, rad/s: dense where a delay line turns."""
    slow = np.geomspace(1e-2, 10.0, 160, endpoint=False)
    return np.concatenate([slow, np.linspace(10.0, pi / tick, round((pi / tick - 10.0) / 0.5))])


def family(
    vehicle: Vehicle,
    delay: Delay,
    *,
    tick: float,
    lag: float,
    conditions: Sequence[Condition] = CONDITIONS,
) -> Family:
    """Return the family of ``vehicle`` behind ``delay``.

    Args:
        vehicle: its data sheet.
        delay: from motion to force with the low-pass of the roll-rate sensor, which is modelled
            apart here: its time constant is taken off.
        tick: of the controller, s.
        lag: of the actuator, s.
        conditions: to build it from.

    Raises:
        CanrollError: the data sheet makes no such car.
    """
    filtered = 1.0 / (2.0 * pi * vehicle.sensors.roll_rate.bandwidth)
    delays = sorted({delay.least, 0.5 * (delay.least + delay.most), delay.most})
    frequencies = grid(tick)
    members = []
    for condition in conditions:
        plant = actuated(car_in(vehicle, condition), lag=lag, sensors=vehicle.sensors)
        behind = {
            seconds: held(plant.a, plant.command, tick=tick, delay=max(seconds - filtered, 0.0))
            for seconds in delays
        }
        members.append(Member(condition, plant, behind, frequencies))
    return Family(tuple(members), tuple(delays), frequencies, tick)


def family_of(task: Task, *, conditions: Sequence[Condition] = CONDITIONS) -> Family:
    """Return the family that a task's controller has to hold on; see :func:`family`."""
    return family(task.vehicle, task.delay, tick=task.tick, lag=task.lag, conditions=conditions)
