"""The firmware's controller as a float64 linear system, stage by stage as in the ECU."""

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from canroll.gain_gen.models.observer import Observer
from canroll.gain_gen.models.roll import Matrix
from canroll.vehicles import GRAVITY

INPUTS = ("roll_rate", "lateral_acceleration", "roll", "delivered_moment")
Y_RATE, Y_LATERAL, Y_ROLL, Y_MOMENT = range(4)
S_ROLL, S_RATE, S_LATERAL, S_STEERING = range(4)
"""Inputs of a compensator."""

SPEEDS = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 60.0)
"""Of the ECU's table over speed, m/s; it holds its ends beyond them."""


@dataclass(frozen=True, slots=True)
class Compensator:
    """ξ⁺ = A ξ + B y + E u_saturated, u = C ξ + D y with y = [roll, roll rate, a_y, steering a_y].

    Attributes:
        a: (n, n), n ≤ 8.
        b: (n, 4).
        e: (n, outputs); zero unless the observer form needs the saturated output.
        c: (outputs, n).
        d: (outputs, 4).
    """

    a: Matrix
    b: Matrix
    e: Matrix
    c: Matrix
    d: Matrix


@dataclass(frozen=True, slots=True)
class LinearController:
    """Everything between the received samples and the moment command, in SI units.

    Exactly one of state feedback (``feedback`` with an observer), output feedback and compensator
    is in use.

    Attributes:
        tick: period, s.
        observer: constant-gain observer, or None where the true state is received.
        feedback: K of u = −K x̂ on the five observer states, (5,).
        feedforward: likewise on the disturbance states, (5,).
        output_gain: K of u = K [roll rate, a_y, roll], (3,), or None.
        compensator: or None.
        predict_steps: ticks over which the state is predicted.
        actuator_rate: fraction of a step command that the actuator covers in a tick.
        schedule: factor on the command at each of :data:`SPEEDS`, interpolated by the ECU.
    """

    tick: float
    observer: Observer
    feedback: Matrix
    feedforward: Matrix
    output_gain: Matrix | None = None
    compensator: Compensator | None = None
    predict_steps: int = 0
    actuator_rate: float = 1.0
    schedule: tuple[float, ...] = (1.0,) * len(SPEEDS)

    @property
    def observes(self) -> bool:
        """Whether the command depends on the observer, not only on measurements."""
        if self.compensator is not None:
            return bool(np.any(self.compensator.b[:, 0]) or np.any(self.compensator.d[:, 0]))
        return self.output_gain is None or bool(self.output_gain[Y_ROLL])

    @property
    def reads_roll_rate(self) -> bool:
        """Whether the law reads the roll rate as measured, not as estimated."""
        if self.compensator is not None:
            return bool(
                np.any(self.compensator.b[:, S_RATE]) or np.any(self.compensator.d[:, S_RATE])
            )
        return self.output_gain is not None and bool(self.output_gain[Y_RATE])

    @property
    def commands_axles(self) -> bool:
        """Whether there is a command for each axle instead of one moment."""
        return self.compensator is not None and len(self.compensator.c) > 1

    def factor_at(self, speed: float) -> float:
        """Return the factor of the schedule at ``speed``, m/s."""
        return float(np.interp(speed, SPEEDS, self.schedule))

    @property
    def order(self) -> int:
        """Number of states of :func:`step`: observer, ring of past commands, compensator."""
        compensator = 0 if self.compensator is None else len(self.compensator.a)
        return (5 if self.observes else 0) + self.predict_steps + compensator


def scaled_controller(controller: LinearController, factor: float) -> LinearController:
    """Return the controller with its whole command multiplied."""
    compensator = controller.compensator
    if compensator is not None:
        compensator = replace(compensator, c=factor * compensator.c, d=factor * compensator.d)
    gain = controller.output_gain
    return replace(
        controller,
        feedback=factor * controller.feedback,
        feedforward=factor * controller.feedforward,
        output_gain=None if gain is None else factor * gain,
        compensator=compensator,
    )


def at_speed(controller: LinearController, speed: float) -> LinearController:
    """Return the controller at ``speed``, m/s, with its factor applied and a schedule of ones."""
    fixed = replace(controller, schedule=(1.0,) * len(SPEEDS))
    return scaled_controller(fixed, controller.factor_at(speed))


def correct(observer: Observer, x: Matrix, y: Matrix) -> Matrix:
    """Return the state after the scalar corrections, in the order of the measurements."""
    for row in observer.measurements:
        innovation = y[row] - observer.model.output[row] @ x
        x = x + np.outer(observer.correction[row], innovation).reshape(x.shape)
    return x


def observe(controller: LinearController, x: Matrix, y: Matrix) -> Matrix:
    """Return the estimate after a tick: prediction under the delivered moment, corrections."""
    if controller.observer.bypass:
        # the true lateral acceleration is received: what the accelerometer reads without gravity
        lateral = y[Y_LATERAL] - GRAVITY * y[Y_ROLL]
        nothing = np.zeros_like(lateral)
        return np.stack([y[Y_ROLL], y[Y_RATE], lateral, nothing, nothing])
    model = controller.observer.model
    x = model.phi @ x + np.multiply.outer(model.gamma[:, 0], y[Y_MOMENT])
    return correct(controller.observer, x, y)


def predict(controller: LinearController, x: Matrix, ring: Matrix, moment: Matrix) -> Matrix:
    """Return the state ``predict_steps`` ticks ahead under the past commands, oldest first."""
    model = controller.observer.model
    for command in ring:
        reached = moment + controller.actuator_rate * (command - moment)
        x = model.phi @ x + np.multiply.outer(model.gamma[:, 0], 0.5 * (moment + reached))
        moment = reached
    return x


def step(
    controller: LinearController, state: Matrix, y: Matrix, *, limit: float = inf
) -> tuple[Matrix, Matrix]:
    """Advance by one tick.

    Args:
        controller: gains.
        state: (order,) or (order, columns): columns are independent copies.
        y: the four :data:`INPUTS`, (4,) or (4, columns).
        limit: limit on each output of a compensator, which feeds back the limited output.

    Returns:
        The next state and the moment command; with a compensator its outputs, (outputs, …).
    """
    observed = 5 if controller.observes else 0
    x = observe(controller, state[:5], y) if observed else state[:0]
    lateral = y[Y_LATERAL]
    if controller.observer.bypass:
        lateral = lateral - GRAVITY * y[Y_ROLL]
    ring = state[5 : 5 + controller.predict_steps]
    if controller.compensator is not None:
        c = controller.compensator
        inner = state[observed:]
        nothing = np.zeros_like(y[0])
        inputs = np.stack([x[0] if observed else nothing, y[Y_RATE], lateral, nothing])
        outputs = np.clip(c.c @ inner + c.d @ inputs, -limit, limit)
        inner = c.a @ inner + c.b @ inputs + c.e @ outputs
        return np.concatenate([x, inner]), outputs
    if controller.output_gain is not None:
        roll = x[0] if observed else np.zeros_like(y[0])
        u = controller.output_gain @ np.stack([y[Y_RATE], lateral, roll])
        return np.concatenate([x, ring]), u
    ahead = predict(controller, x, ring, y[Y_MOMENT])
    u = -(controller.feedback + controller.feedforward) @ ahead
    if controller.predict_steps:
        ring = np.concatenate([ring[1:], u[None]])
    return np.concatenate([x, ring]), u


def matrices(
    controller: LinearController, *, summed: bool = True
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return A, B, C, D of the controller from y to u by passing unit vectors through it.

    Args:
        controller: gains.
        summed: return the sum of a compensator's two outputs instead of both.
    """
    n = controller.order
    identity = np.eye(n + 4)
    following, u = step(controller, identity[:n], identity[n:])
    u = np.atleast_2d(u)
    if summed:
        u = u.sum(axis=0, keepdims=True)
    return following[:, :n], following[:, n:], u[:, :n], u[:, n:]
