"""The periodic sequence of delays that brings a loop closest to instability, and its simulation.

A sequence τ_0 … τ_{L−1} repeats; command k takes effect at k T + τ_k, in order. Over a period the
state is multiplied by the product of the ticks' matrices: where the product's spectral radius is
one or more, no Lyapunov function can exist.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil

import numpy as np

from canroll.extensions.certify.delay_curve import lacking
from canroll.gain_gen.analysis.family import Member
from canroll.gain_gen.analysis.held_plant import HeldPlant, opened
from canroll.gain_gen.models.controller import LinearController, at_speed, step
from canroll.gain_gen.models.roll import Matrix, zero_order_hold

VALUES = 5
"""Delays that are tried, from the least to the longest."""
LONGEST = 4
"""Period of the sequences that are all tried, ticks."""
RANDOM = 200
"""Longer sequences that are drawn."""
RANDOM_PERIODS = (6, 8, 10, 12)


@dataclass(frozen=True, slots=True)
class DelaySequence:
    """A periodic sequence of delays.

    Attributes:
        delays: of a period, without the sensor's low-pass, s.
        radius: growth of the state in a tick, in the mean over a period.
    """

    delays: tuple[float, ...]
    radius: float


def closest(
    member: Member, controller: LinearController, delay: tuple[float, float], *, seed: int = 0
) -> DelaySequence:
    """Return the sequence of largest growth among those tried."""
    loop = _SwitchedLoop(member, at_speed(controller, member.condition.speed), delay)
    tried = [
        DelaySequence(delays, loop.radius(delays)) for delays in _sequences(delay, loop.tick, seed)
    ]
    return max(tried, key=lambda sequence: (round(sequence.radius, 9), -len(sequence.delays)))


def _sequences(delay: tuple[float, float], tick: float, seed: int) -> Iterator[tuple[float, ...]]:
    """Yield periodic sequences in which no command overtakes another."""
    values = np.unique(np.linspace(*delay, VALUES)).tolist()
    for period in range(1, LONGEST + 1):
        yield from (delays for delays in product(values, repeat=period) if _in_order(delays, tick))
    draw = np.random.default_rng(seed)
    for period in RANDOM_PERIODS:
        for _ in range(RANDOM // len(RANDOM_PERIODS)):
            effect = draw.uniform(*delay, size=2 * period) + tick * np.arange(2 * period)
            # a later command cannot be earlier than the one before it
            delays = np.maximum.accumulate(effect) - tick * np.arange(2 * period)
            drawn = tuple(delays[period:].tolist())
            if max(drawn) <= delay[1] and _in_order(drawn, tick):
                yield drawn


def _in_order(delays: Sequence[float], tick: float) -> bool:
    after = (*delays[1:], delays[0])
    return all(b >= a - tick - 1e-12 for a, b in zip(delays, after, strict=True))


class _SwitchedLoop:
    """The loop's matrix in a tick, by the instants at which the commands take effect in it."""

    def __init__(
        self, member: Member, controller: LinearController, delay: tuple[float, float]
    ) -> None:
        car = member.plant
        self.tick = controller.tick
        self._ages = max(ceil(delay[1] / self.tick - 1e-9), 1)
        self._car, self._n = car, len(car.a)
        phi = zero_order_hold(car.a, car.command, self.tick)[0]
        nothing = np.zeros((self._n, 1))
        plant = HeldPlant(phi, nothing, nothing, self._ages + 1, self.tick)
        # the delay line's entries are the commands, the oldest first; the newest is the output
        self._a, self._b, self._c = opened(plant, controller, car.measured)
        self._lacking: dict[float, Matrix] = {}

    def radius(self, delays: Sequence[float]) -> float:
        """Return the growth in a tick of a periodic sequence."""
        period = len(delays)
        transition = np.eye(len(self._a))
        for k in range(period):
            recent = [delays[(k - j) % period] for j in range(self._ages)]
            transition = self._matrix(recent) @ transition
        return float(np.abs(np.linalg.eigvals(transition)).max() ** (1.0 / period))

    def _matrix(self, recent: Sequence[float]) -> Matrix:
        """Return the closed loop's matrix of a tick; delays of the newest command first."""
        a, b = self._a.copy(), self._b.copy()
        columns = [b[: self._n, 0]] + [
            a[: self._n, self._n + self._ages + 1 - age] for age in range(1, self._ages + 1)
        ]
        ends = [min(max(tau - j * self.tick, 0.0), self.tick) for j, tau in enumerate(recent)]
        lack = [self._at(self.tick), *(self._at(end) for end in ends), self._at(0.0)]
        for column, before, after in zip(columns, lack[:-1], lack[1:], strict=True):
            np.add(column, before - after, out=column)
        return np.asarray(a + b @ self._c)

    def _at(self, instant: float) -> Matrix:
        if instant not in self._lacking:
            command = self._car.command[:, 0]
            at = np.array([instant])
            self._lacking[instant] = lacking(self._car.a, command, self.tick, at)[0]
        return self._lacking[instant]


def simulate(
    member: Member,
    controller: LinearController,
    delays: Sequence[float],
    *,
    roll: float,
    ticks: int,
) -> Matrix:
    """Return the roll angle at each tick, rad, under a periodic sequence of delays.

    The car is integrated from one command's effect to the next; the controller is stepped in
    floating point. Starts at rest with a roll angle of ``roll``, rad.
    """
    car, tick = member.plant, controller.tick
    fixed = at_speed(controller, member.condition.speed)

    def moved(x: Matrix, seconds: float, acting: float) -> Matrix:
        phi, gamma = zero_order_hold(car.a, car.command, seconds)
        return phi @ x + acting * gamma[:, 0]

    x = np.asarray(roll * member.roll / float(member.roll @ member.roll), dtype=float)
    inner: Matrix = np.zeros(fixed.order)
    acting, under_way = 0.0, list[tuple[float, float]]()
    angles = []
    for k in range(ticks):
        angles.append(float(member.roll @ x))
        inner, u = step(fixed, inner, car.measured @ x)
        under_way.append((k * tick + delays[k % len(delays)], float(np.sum(u))))
        now, end = k * tick, (k + 1) * tick
        while under_way and under_way[0][0] < end:
            at, command = under_way.pop(0)
            x = moved(x, max(at - now, 0.0), acting)
            now, acting = max(at, now), command
        x = moved(x, end - now, acting)
    return np.array(angles)
