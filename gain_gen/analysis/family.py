"""Exact loop on the linear car over a family of conditions and delays: margins, worst case.

Car, actuator lag, sensor low-passes, hold, fractional delay, delay line and the ECU's arithmetic.
The command from a measured lateral acceleration is feedback like any other: the moment moves the
car sideways and tilts the accelerometer.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from math import inf, pi

import numpy as np

from canroll.errors import CanrollError
from canroll.gain_gen.analysis.actuated_car import ActuatedCar, actuated, roll_car
from canroll.gain_gen.analysis.held_plant import (
    HeldPlant,
    aliased,
    command_response,
    held,
    opened,
    padded,
)
from canroll.gain_gen.analysis.margins import (
    Margins,
    jitter_level,
    largest_delay_from,
    nyquist_margins,
)
from canroll.gain_gen.analysis.sampled_loop import SampledLoop, spectral_radius
from canroll.gain_gen.models.controller import LinearController, at_speed, matrices
from canroll.gain_gen.models.linear_car import linear_car
from canroll.gain_gen.models.roll import Matrix, zero_order_hold
from canroll.gain_gen.models.state_space import Complex, StateSpace, resolvent_rows
from canroll.gain_gen.models.task import Delay, Task
from canroll.gain_gen.models.trim import most_lateral_acceleration
from canroll.vehicles import Vehicle
from canroll.vehicles.unladen import unladen

KMH = 1.0 / 3.6
LINEAR_SHARE = 0.9
"""Fraction of its hardest steady curve for a vehicle that cannot take the family's."""


@dataclass(frozen=True, slots=True)
class Condition:
    """Operating condition of a vehicle.

    Attributes:
        load: "laden" or "empty"; another name for a model that is not a car.
        speed: m/s; zero for such a model.
        lateral_acceleration: of a steady curve, m/s²; zero for straight running.
        friction: of the road.
        draw: number of the car drawn from the vehicle's fit; 0 for the vehicle itself.
    """

    load: str
    speed: float
    lateral_acceleration: float = 0.0
    friction: float = 1.0
    draw: int = 0

    def __str__(self) -> str:
        text = f"draw {self.draw} of the fit, {self.load}" if self.draw else self.load
        if not self.speed:
            return text
        text += f", {self.speed / KMH:.0f} km/h"
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
"""Conditions on which every design is checked. Low friction changes the car only in a curve."""


def car_in(vehicle: Vehicle, condition: Condition) -> StateSpace:
    """Return the linear car of ``vehicle`` in ``condition``; a curve beyond its grip is relaxed.

    Raises:
        CanrollError: the data sheet does not define such a car.
    """
    loaded = unladen(vehicle) if condition.load == "empty" else vehicle
    curve = condition.lateral_acceleration
    if curve:
        most = most_lateral_acceleration(loaded, condition.friction)
        curve = min(curve, LINEAR_SHARE * most)
    return linear_car(
        loaded, condition.speed, lateral_acceleration=curve, friction=condition.friction
    )


@dataclass(frozen=True)
class Member:
    """One condition of the family at all delays.

    Attributes:
        condition: of the car.
        plant: with actuator and sensors.
        held: the plant sampled at the tick, by delay in s.
        frequencies: of the responses, rad/s.
        filtered: part of each delay already modelled by the sensor's low-pass in ``plant``, s.
    """

    condition: Condition
    plant: ActuatedCar
    held: dict[float, HeldPlant]
    frequencies: Matrix
    filtered: float

    @property
    def roll(self) -> Matrix:
        """The roll angle as row on the plant's states, (n,)."""
        return np.asarray(self.plant.measured[2])

    @cached_property
    def _rows(self) -> Complex:
        plant = next(iter(self.held.values()))
        return resolvent_rows(plant.phi, self.plant.measured, self._z(plant))

    def _z(self, plant: HeldPlant) -> Complex:
        return np.asarray(np.exp(1j * self.frequencies * plant.tick), dtype=complex)

    def commanded(self, delay: float) -> Complex:
        """Return the controller's readings per command, (frequencies, 4)."""
        plant = self.held[delay]
        return command_response(plant, self._rows, self._z(plant))

    @cached_property
    def aliased(self) -> Complex:
        """Products of the readings per command, summed over all aliases, (frequencies, 4, 4)."""
        car, sampled = self.plant, next(iter(self.held.values()))
        z = self._z(sampled)
        return aliased(car.a, car.command, car.measured, tick=sampled.tick, rows=self._rows, z=z)

    @cached_property
    def disturbed(self) -> Complex:
        """The controller's readings per roll moment on the body, held, (frequencies, 4)."""
        return np.asarray((self._rows @ self._held_disturbance)[:, :, 0])

    @cached_property
    def _held_disturbance(self) -> Matrix:
        tick = next(iter(self.held.values())).tick
        return zero_order_hold(self.plant.a, self.plant.disturbance, tick)[1]

    def loop(self, controller: LinearController, delay: float) -> SampledLoop:
        """Return the loop at any delay in s as matrices, cut at the command, at this speed."""
        plant = self.held.get(delay)
        if plant is None:
            pure = max(delay - self.filtered, 0.0)
            plant = held(self.plant.a, self.plant.command, tick=controller.tick, delay=pure)
        fixed = at_speed(controller, self.condition.speed)
        a, b, c = opened(plant, fixed, self.plant.measured)
        return SampledLoop(a, b, c, padded(self._held_disturbance.T, len(a)).T, plant.tick)


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
    def least_stable(self) -> FamilyRow:
        """The row of greatest spectral radius."""
        return max(self.rows, key=lambda row: row.margins.radius)

    @property
    def nominal(self) -> FamilyRow:
        """The first member's row at the middle delay."""
        first = [row for row in self.rows if row.condition == self.rows[0].condition]
        return first[len(first) // 2]

    @property
    def stable(self) -> bool:
        """Whether every loop is stable."""
        return self.worst_sensitivity.margins.sensitivity < inf

    def within(self, gain_db: float, sensitivity: float) -> bool:
        """Whether every gain margin is more and every Ms less than these."""
        least, most = self.worst_gain.margins.gain_db, self.worst_sensitivity.margins.sensitivity
        return least > gain_db and most < sensitivity


@dataclass(frozen=True, slots=True)
class Family:
    """Cars in several conditions behind the delays of a task, with their responses.

    Attributes:
        members: by condition, the nominal one first.
        delays: least, middle and longest from sample to force, s, the sensor's low-pass included.
        frequencies: of all responses, rad/s.
        tick: s.
        note: reason why it is the roll model alone, or empty.
    """

    members: tuple[Member, ...]
    delays: tuple[float, ...]
    frequencies: Matrix
    tick: float
    note: str = ""

    @property
    def span(self) -> float:
        """Longest less least delay, s."""
        return self.delays[-1] - self.delays[0]

    def controller_response(self, controller: LinearController) -> Complex:
        """Return the command per reading, (frequencies, 4)."""
        return StateSpace(*matrices(controller), self.tick).response(self.frequencies)[:, 0]

    def margins(self, controller: LinearController) -> FamilyMargins:
        """Return gain margin, phase margin and Ms of every member at every delay."""
        return FamilyMargins(tuple(self.rows(controller)))

    def rows(
        self, controller: LinearController, *, first: FamilyRow | None = None
    ) -> Iterator[FamilyRow]:
        """Yield the margins one by one, starting at the member and delay of ``first``.

        A caller that only needs to know whether all hold can stop at the first failure.
        """
        response = self.controller_response(controller)
        places = [(member, delay) for member in self.members for delay in self.delays]
        if first is not None:
            at = (first.condition, first.delay)
            places.sort(key=lambda place: (place[0].condition, place[1]) != at)
        for member, delay in places:
            factor = controller.factor_at(member.condition.speed)
            gain = -factor * np.sum(response * member.commanded(delay), axis=1)
            margins = nyquist_margins(self.frequencies, gain, member.loop(controller, delay))
            yield FamilyRow(member.condition, delay, margins)

    def jitter(self, controller: LinearController) -> tuple[float, Condition]:
        """Return the greatest :func:`jitter_level` of all members and where it is.

        Below one every member is stable for any sequence of delays between the bounds.
        """
        response = self.controller_response(controller)
        middle = self.delays[len(self.delays) // 2]
        levels = []
        for member in self.members:
            factor = controller.factor_at(member.condition.speed)
            gain = -factor * np.sum(response * member.commanded(middle), axis=1)
            if spectral_radius(member.loop(controller, middle)) >= 1.0:
                return inf, member.condition
            power = np.einsum("fi,fij,fj->f", response, member.aliased, response.conj()).real
            level = jitter_level(
                self.frequencies,
                gain,
                abs(factor) * np.sqrt(power),
                tick=self.tick,
                jitter=self.span,
            )
            levels.append((level, member.condition))
        return max(levels, key=lambda entry: entry[0])

    def largest_delay(
        self, controller: LinearController, margins: FamilyMargins, *, limit: float
    ) -> float:
        """Return the largest constant delay, from the least on, at which all members are stable, s.

        Searched on the members with the least margins, then confirmed on all. If no loop gain
        reaches one, no delay destabilises: that is only confirmed at the limit.

        Args:
            controller: controller of the loops.
            margins: those of this controller.
            limit: return infinity if all are stable up to this delay, s.
        """
        if not any(row.margins.crossover for row in margins.rows) and _all_stable(
            self.members, controller, limit
        ):
            return inf
        worst = {margins.worst_gain.condition, margins.worst_sensitivity.condition}
        searched = [member for member in self.members if member.condition in worst]
        while True:
            stable = partial(_all_stable, searched, controller)
            edge = largest_delay_from(self.delays[0], stable, self.tick, limit=limit)
            at = min(edge, limit)
            unsafe = [m for m in self.members if not _all_stable([m], controller, at)]
            if not unsafe or edge == 0.0:
                return edge
            searched += unsafe


def _all_stable(members: Sequence[Member], controller: LinearController, delay: float) -> bool:
    return all(spectral_radius(member.loop(controller, delay)) < 1.0 for member in members)


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
        delay: from motion to force including the low-pass of the roll-rate sensor, whose time
            constant is subtracted, as it is modelled separately here.
        tick: of the controller, s.
        lag: time constant of the actuator, s.
        conditions: conditions of its members.

    Raises:
        CanrollError: the data sheet does not define such a car.
    """
    return _built(vehicle, delay, tick, lag, tuple(conditions))


@lru_cache(maxsize=128)
def _built(
    vehicle: Vehicle, delay: Delay, tick: float, lag: float, conditions: tuple[Condition, ...]
) -> Family:
    """The family, shared by all laws for the same task."""
    cars = {condition: car_in(vehicle, condition) for condition in conditions}
    return _family(vehicle, delay, cars, tick=tick, lag=lag)


def _family(
    vehicle: Vehicle,
    delay: Delay,
    cars: Mapping[Condition, StateSpace],
    *,
    tick: float,
    lag: float,
    note: str = "",
) -> Family:
    """Return the family of ``cars`` behind ``delay``."""
    filtered = 1.0 / (2.0 * pi * vehicle.sensors.roll_rate.bandwidth)
    delays = sorted({delay.least, 0.5 * (delay.least + delay.most), delay.most})
    frequencies = grid(tick)
    members = []
    for condition, car in cars.items():
        plant = actuated(car, lag=lag, sensors=vehicle.sensors)
        behind = {
            seconds: held(plant.a, plant.command, tick=tick, delay=max(seconds - filtered, 0.0))
            for seconds in delays
        }
        members.append(Member(condition, plant, behind, frequencies, filtered))
    return Family(tuple(members), tuple(delays), frequencies, tick, note)


def family_of(task: Task) -> Family:
    """Return the family on which a task's controller is verified.

    If the data sheet does not define a linear car, it is the 1-DOF roll model alone, and the
    family's ``note`` gives the reason.
    """
    try:
        return family(task.vehicle, task.delay, tick=task.tick, lag=task.lag)
    except CanrollError as error:
        cars = {Condition("1-DOF roll model", 0.0): roll_car(task.vehicle.design)}
        note = f"margins are those of the 1-DOF roll model alone: {error}"
        return _family(task.vehicle, task.delay, cars, tick=task.tick, lag=task.lag, note=note)
