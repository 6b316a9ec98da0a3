"""The papers' own loop: the 1-DOF roll model with sampled, delayed feedback, and nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, inf

import numpy as np

from canroll.gain_gen.models.roll import (
    Matrix,
    lateral_input,
    moment_input,
    state_matrix,
    zero_order_hold,
)
from canroll.plant_sim.nodes.actuator_models import semi_active_setting, span
from canroll.runs.metrics import peak, rms
from canroll.typing import Vector
from canroll.vehicles import RollModel

STEP = 0.001
"""Step of the simulation, s."""
RUNAWAY = 10.0
"""Roll angle from which on a loop counts as unstable, rad."""


@dataclass(frozen=True, slots=True)
class Kalman:
    """Filter for [φ, φ', a_y] from the roll rate alone (Yim 2020, (30) to (35)).

    ``model`` is the filter's; ``process`` (3) and ``measurement`` are variances added a sample.
    """

    model: RollModel
    process: Sequence[float]
    measurement: float


@dataclass(frozen=True, slots=True)
class RollLoop:
    """u = K [φ, φ'] − F a_y around a roll model.

    Attributes:
        model: plant.
        feedback: K; none: without control.
        feedforward: F, kg·m.
        sampling: period of the controller, s.
        delay: from sample to moment, s.
        lag: time constant of the actuator, s.
        limit: of the moment command, N·m.
        observer: none: the true states.
        noise: standard deviation of a sample of the roll rate, rad/s.
        epsilon_squared: threshold of the relative trigger at the sensor; none: every sample.
        curve: rates (m/s), soft and firm forces (N) of each of four dampers, (3, n); none: the
            actuator gives any moment.
        half_track: lever of the dampers, m.
    """

    model: RollModel
    feedback: Matrix | None = None
    feedforward: float = 0.0
    sampling: float = STEP
    delay: float = 0.0
    lag: float = 0.0
    limit: float = inf
    observer: Kalman | None = None
    noise: float = 0.0
    epsilon_squared: float | None = None
    curve: Vector | None = None
    half_track: float = 0.0


@dataclass(frozen=True, slots=True)
class Motion:
    """What the loop did, every millisecond: rad, rad/s, N·m commanded; errors per sample."""

    roll: Vector
    rate: Vector
    moment: Vector
    roll_error: Vector
    lateral_error: Vector
    sent: int
    samples: int

    @property
    def stable(self) -> bool:
        """Whether the roll angle stayed below any that a car could have."""
        return peak(self.roll) < RUNAWAY

    def figure(self, quantity: str) -> float:
        """Return a figure by its name in the papers' tables; no number if the loop ran away."""
        if not self.stable:
            return float("nan")
        if quantity == "transmission_rate":
            return self.sent / self.samples
        name, _, kind = quantity.rpartition("_")
        values, unit = {
            "roll": (self.roll, np.degrees(1)),
            "roll_rate": (self.rate, np.degrees(1)),
            "moment": (self.moment, 1.0),
            "roll_error": (self.roll_error, np.degrees(1)),
            "lateral_error": (self.lateral_error, 1.0),
        }[name]
        return float(unit * (rms if kind == "rms" else peak)(values))


class _Filter:
    """The Kalman filter while it runs: its state, its covariance, the moment since the sample."""

    def __init__(self, kalman: Kalman, sampling: float) -> None:
        a = np.zeros((3, 3))
        a[:2, :2] = state_matrix(kalman.model)
        a[:2, 2:] = lateral_input(kalman.model)
        b = np.vstack([moment_input(kalman.model), [[0.0]]])
        self._ahead, self._held = zero_order_hold(a, b, sampling)
        self._process = np.diag(kalman.process)
        self._measurement = kalman.measurement
        self._covariance = np.zeros((3, 3))
        self.state = np.zeros(3)

    def update(self, rate: float, moment: float) -> Vector:
        """Return [φ, φ', a_y] after a sample; ``moment``: mean delivered since the last one."""
        ahead = self._ahead
        state = ahead @ self.state + self._held[:, 0] * moment
        covariance = ahead @ self._covariance @ ahead.T + self._process
        gain = covariance[:, 1] / (covariance[1, 1] + self._measurement)
        self.state = state + gain * (rate - state[1])
        self._covariance = covariance - np.outer(gain, covariance[1])
        return self.state


def motion(loop: RollLoop, lateral: Vector, *, seed: int = 0) -> Motion:
    """Return the motion of ``loop`` under a lateral acceleration given each millisecond, m/s²."""
    inputs = np.hstack([lateral_input(loop.model), moment_input(loop.model)])
    a, b = zero_order_hold(state_matrix(loop.model), inputs, STEP)
    (a11, a12), (a21, a22) = a.tolist()
    (b11, b12), (b21, b22) = b.tolist()
    angle_gain, rate_gain = (0.0, 0.0) if loop.feedback is None else np.ravel(loop.feedback)
    random = np.random.default_rng(seed)
    observer = None if loop.observer is None else _Filter(loop.observer, loop.sampling)
    every = round(loop.sampling / STEP)
    queue = [0.0] * round(loop.delay / STEP)
    follow = 1.0 - exp(-STEP / loop.lag) if loop.lag else 1.0
    count = len(lateral)
    roll, rates, moments = np.zeros(count), np.zeros(count), np.zeros(count)
    errors: list[tuple[float, float]] = []
    roll_now = rate_now = command = delivered = since = setting = 0.0
    sent = samples = 0
    for k, acceleration in enumerate(lateral.tolist()):
        roll[k], rates[k] = roll_now, rate_now
        if k % every == 0 and loop.feedback is not None:
            samples += 1
            measured = rate_now + (loop.noise * random.standard_normal() if loop.noise else 0.0)
            angle, lateral_seen = roll_now, acceleration
            if observer is not None:
                angle, measured, lateral_seen = observer.update(measured, since / every).tolist()
                errors.append((angle - roll_now, lateral_seen - acceleration))
            since = 0.0
            wanted = angle_gain * angle + rate_gain * measured - loop.feedforward * lateral_seen
            wanted = min(max(wanted, -loop.limit), loop.limit)
            threshold = loop.epsilon_squared
            if threshold is None or (wanted - command) ** 2 > threshold * command**2:
                command, sent = wanted, sent + 1
        moments[k] = command
        queue.append(command)
        arrived = queue.pop(0)
        if loop.curve is None:
            delivered += follow * (arrived - delivered)
        else:
            stroke = rate_now * loop.half_track
            target = semi_active_setting(loop.curve, arrived / (4 * loop.half_track), stroke)
            setting += follow * (target - setting)
            delivered = -float(np.sign(stroke)) * 4 * loop.half_track * setting
            delivered *= span(loop.curve, abs(stroke))
        since += delivered
        roll_now, rate_now = (
            a11 * roll_now + a12 * rate_now + b11 * acceleration + b12 * delivered,
            a21 * roll_now + a22 * rate_now + b21 * acceleration + b22 * delivered,
        )
        if abs(roll_now) > RUNAWAY:
            roll[k:] = roll_now
            break
    seen = np.array(errors or [(0.0, 0.0)])
    return Motion(roll, rates, moments, seen[:, 0], seen[:, 1], sent, samples)
