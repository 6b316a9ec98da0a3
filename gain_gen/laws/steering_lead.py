"""Lateral-acceleration feedforward with steering lead over the delay, and roll-rate feedback.

    u = −β m h [ F a_imu + a_δ(t + τ) − a_δ(t) ] + k_p φ'

The accelerometer, low-passed by F, provides the slow part, so that friction, tyres and speed cannot
bias the moment. The steering model a_δ only adds lead: the change of lateral acceleration over the
horizon τ that follows from the present steering angle. The measured lateral acceleration responds
to the moment, so the law is feedback as well: its parameters are found on the sampled loop over the
family of conditions and delays.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import exp, pi, sqrt

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from canroll.gain_gen.analysis.family import NOMINAL, Family, car_in, family_of
from canroll.gain_gen.analysis.steering_response import SteeringResponse, steering_response
from canroll.gain_gen.laws.compensator import scaled_states
from canroll.gain_gen.laws.declared import law
from canroll.gain_gen.laws.state_feedback import controller_of
from canroll.gain_gen.models.controller import (
    S_LATERAL,
    S_RATE,
    S_STEERING,
    Y_LATERAL,
    Y_RATE,
    Y_ROLL,
    Compensator,
)
from canroll.gain_gen.models.linear_car import INPUTS, OUTPUTS
from canroll.gain_gen.models.roll import Matrix, zero_order_hold
from canroll.gain_gen.models.state_space import Complex, StateSpace, resolvent
from canroll.gain_gen.models.task import Solution, Task
from canroll.vehicles import Vehicle

MOMENT_SHARE = 0.8
"""Default RMS moment over that of the roll moment m h a_y of the car's own lateral acceleration."""
CORNERS = (8.0, 6.0, 5.0, 4.0, 3.0)
"""Of F, Hz: the first with which the loop has its margins. The highest rolls off before the wheels
hop; the lower, the more the steering has to lead."""
CANDIDATES = (
    *((1.0, corner) for corner in CORNERS),
    *((0.9**step, CORNERS[-1]) for step in range(1, 8)),
)
"""Fractions of the requested share, with corners, in the order tried."""
GAIN_MARGIN_DB = 8.5
PEAK_SENSITIVITY = 1.6
"""Margins for their choice, slightly more than required of every design."""
MODEL_ORDER = 4
"""States of the steering model: six are no better."""
RATE_SENSITIVITY = 1.4
"""Largest Ms of the worst loop with the roll-rate gain."""
RATE_STEPS = 40
LONGEST_HORIZON = 0.4
"""s."""


class SteeringModel(StateSpace):
    """Lateral acceleration y from its steady value u at the angle, continuous, one of each."""

    __slots__ = ()

    def lead(self, horizon: float) -> tuple[Matrix, Matrix]:
        """Return c (1, n), d (1, 1) of y(t + τ) − y(t) = c x + d a, the steering held meanwhile."""
        ahead, steered = zero_order_hold(self.a, self.b, horizon)
        return self.c @ ahead - self.c, self.c @ steered

    def leading(self, horizon: float, z: Complex, tick: float) -> Complex:
        """Return the response of that lead at the tick, (len(z),)."""
        phi, gamma = zero_order_hold(self.a, self.b, tick)
        c, d = self.lead(horizon)
        return np.asarray((c @ resolvent(phi, gamma, z) + d)[:, 0, 0], dtype=complex)


def steering_model(vehicle: Vehicle) -> SteeringModel:
    """Return the model at the nominal speed; the ECU's table scales it to other speeds.

    Raises:
        CanrollError: the data sheet does not define such a car.
    """
    steering, lateral = INPUTS.index("steering"), OUTPUTS.index("lateral_acceleration")
    inputs, outputs = np.zeros(len(INPUTS)), np.full(len(OUTPUTS), np.inf)
    inputs[steering], outputs[lateral] = 0.02, 2.0
    balanced = car_in(vehicle, NOMINAL).balanced(inputs, outputs)[0]
    car = balanced.residualised(MODEL_ORDER)
    b, c, d = car.b[:, [steering]], car.c[[lateral]], car.d[[lateral]][:, [steering]]
    steady = float((d - c @ np.linalg.solve(car.a, b))[0, 0])
    return SteeringModel(car.a, b / steady, c, d / steady)


@dataclass(frozen=True, slots=True)
class Tuning:
    """Parameters of the law.

    Attributes:
        carried: β m h, N·m per m/s².
        rate: k_p, N·m·s/rad, not positive.
        horizon: τ, s.
        corner: of F, Hz.
    """

    carried: float
    rate: float
    horizon: float
    corner: float

    def pole(self, tick: float) -> float:
        """Return the pole of F at the tick."""
        return exp(-2.0 * pi * self.corner * tick)

    def feedback(self, z: Complex, tick: float) -> Complex:
        """Return the command per reading, (len(z), 4)."""
        pole = self.pole(tick)
        readings = np.zeros((len(z), 4), dtype=complex)
        readings[:, Y_RATE] = self.rate
        readings[:, Y_LATERAL] = -self.carried * (1.0 - pole) / (1.0 - pole / z)
        return readings


def compensator(model: SteeringModel, tuning: Tuning, tick: float) -> Compensator:
    """Return the law as the ECU's compensator: the model's states, then the filter's."""
    n = len(model.a)
    phi, gamma = zero_order_hold(model.a, model.b, tick)
    lead, direct = model.lead(tuning.horizon)
    pole, carried = tuning.pole(tick), tuning.carried
    a, b = np.zeros((n + 1, n + 1)), np.zeros((n + 1, 4))
    c, d = np.zeros((1, n + 1)), np.zeros((1, 4))
    a[:n, :n], b[:n, S_STEERING] = phi, gamma[:, 0]
    a[n, n], b[n, S_LATERAL] = pole, 1.0 - pole
    c[:, :n], c[:, n] = -carried * lead, -carried * pole
    d[0, S_RATE] = tuning.rate
    d[0, S_LATERAL], d[0, S_STEERING] = -carried * (1.0 - pole), -carried * direct[0, 0]
    return scaled_states(Compensator(a=a, b=b, e=np.zeros((n + 1, 1)), c=c, d=d), tick)


@dataclass(frozen=True, slots=True)
class DisturbedCars:
    """The readings of every member of a family at every delay, by frequency.

    Attributes:
        commanded: per command, (loops, m, 4).
        disturbed: per roll moment on the body, (loops, m, 4).
        z: e^{jωT} of the frequencies, (m,).
        frequencies: rad/s, (m,).
        tick: s.
    """

    commanded: Complex
    disturbed: Complex
    z: Complex
    frequencies: Matrix
    tick: float

    def worst(self, tuning: Tuning) -> tuple[float, float]:
        """Return the worst Ms and the worst roll from a moment on the body relative to no control.

        The roll is an RMS over all frequencies. Both use the frequency response only, so they are
        valid only for gains reached from zero with Ms finite all the way.
        """
        gains = tuning.feedback(self.z, self.tick)
        loop = 1.0 - np.sum(gains * self.commanded, axis=2)
        moment = np.sum(gains * self.disturbed, axis=2) / loop
        free = self.disturbed[:, :, Y_ROLL]
        rolled = free + self.commanded[:, :, Y_ROLL] * moment
        energy = [np.trapezoid(np.abs(roll) ** 2, self.frequencies) for roll in (rolled, free)]
        return 1.0 / float(np.abs(loop).min()), sqrt(float((energy[0] / energy[1]).max()))

    def rate_gain(self, start: Tuning, damping: float) -> float:
        """Return the k_p ≤ 0 that minimises roll from a moment on the body.

        The worst Ms stays below :data:`RATE_SENSITIVITY`, or at its value without such a gain.

        Args:
            start: the other parameters.
            damping: roll damping of the vehicle, N·m·s/rad: the largest gain tried.
        """
        sensitivity, best = self.worst(replace(start, rate=0.0))
        allowed, largest = max(sensitivity, RATE_SENSITIVITY), 0.0
        for gain in -damping * np.arange(1, RATE_STEPS + 1) / RATE_STEPS:
            sensitivity, level = self.worst(replace(start, rate=float(gain)))
            if sensitivity > allowed:
                break
            if level < best:
                best, largest = level, float(gain)
        return largest


def disturbed_cars(family: Family) -> DisturbedCars:
    """Return the readings of ``family``."""
    loops = [(member, delay) for member in family.members for delay in family.delays]
    return DisturbedCars(
        commanded=np.array([member.commanded(delay) for member, delay in loops]),
        disturbed=np.array([member.disturbed for member, _ in loops]),
        z=np.exp(1j * family.frequencies * family.tick),
        frequencies=family.frequencies,
        tick=family.tick,
    )


@dataclass(frozen=True, slots=True)
class SteeredCars:
    """Steering responses of a family's cars running straight at the middle delay, nominal first."""

    responses: tuple[SteeringResponse, ...]
    model: SteeringModel
    z: Complex
    tick: float

    def moments(self, tuning: Tuning, lead: Complex) -> Iterator[tuple[SteeringResponse, Complex]]:
        """Yield each car's responses and its moment per road-wheel angle.

        Args:
            tuning: the law's parameters.
            lead: the steering model's, :meth:`SteeringModel.leading` at the tuning's horizon.
        """
        gains = tuning.feedback(self.z, self.tick)
        for response in self.responses:
            yield response, response.moment(gains, -tuning.carried * lead)

    def with_horizon(self, effort: float, start: Tuning) -> Tuning:
        """Return the horizon, and its β m h, that minimise the cars' roll at a given effort.

        Args:
            effort: RMS moment of the nominal car per RMS lateral acceleration, N·m per m/s².
            start: the other parameters.
        """

        def at(horizon: float) -> tuple[Tuning, Complex]:
            lead = self.model.leading(horizon, self.z, self.tick)

            def excess(carried: float) -> float:
                response, moment = next(self.moments(replace(start, carried=carried), lead))
                return response.rms(moment) - effort

            carried = brentq(excess, 0.0, 2.0 * effort, xtol=1e-3 * effort)
            return replace(start, carried=float(carried), horizon=horizon), lead

        def rolled(horizon: float) -> float:
            return sum(
                response.rms(response.rolled(moment)) ** 2
                for response, moment in self.moments(*at(horizon))
            )

        minimum = minimize_scalar(
            rolled, bounds=(0.0, LONGEST_HORIZON), method="bounded", options={"xatol": 1e-3}
        )
        return at(float(minimum.x))[0]


def steered_cars(task: Task, family: Family, model: SteeringModel) -> SteeredCars:
    """Return the cars of ``family`` in straight running."""
    middle = family.delays[len(family.delays) // 2]
    responses = tuple(
        steering_response(family, task.vehicle, middle, member)
        for member in family.members
        if not member.condition.lateral_acceleration
    )
    z = np.exp(1j * responses[0].frequencies * task.tick)
    return SteeredCars(responses, model, z, task.tick)


@law(share=True)
def design_steering_lead(task: Task) -> Solution:
    """a_y feedforward with steering lead over the delay, and a little roll-rate feedback.

    Raises:
        CanrollError: the vehicle's data sheet does not define such a car.
    """
    family = family_of(task)
    model = steering_model(task.vehicle)
    steered, disturbed = steered_cars(task, family, model), disturbed_cars(family)
    roll = task.vehicle.design
    share = MOMENT_SHARE if task.moment_share is None else task.moment_share
    for reduced_to, corner in CANDIDATES:
        effort = reduced_to * share * roll.roll_arm
        start = Tuning(carried=effort, rate=0.0, horizon=0.0, corner=corner)
        start = replace(start, rate=disturbed.rate_gain(start, roll.roll_damping))
        tuning = steered.with_horizon(effort, start)
        controller = controller_of(task, compensator=compensator(model, tuning, task.tick))
        if family.margins(controller).within(GAIN_MARGIN_DB, PEAK_SENSITIVITY):
            break
    notes = () if reduced_to == 1.0 else (_reduced(share, reduced_to * share),)
    return Solution(
        controller,
        delay_aware=True,
        notes=notes,
        extra={
            "beta": tuning.carried / roll.roll_arm,
            "rate_gain": tuning.rate,
            "horizon_s": tuning.horizon,
            "filter_hz": tuning.corner,
        },
    )


def _reduced(share: float, reduced: float) -> str:
    return (
        f"steering_lead: --moment-share {share:.3g} reduced to {reduced:.3g} for gain margin and "
        "peak sensitivity over the family"
    )
