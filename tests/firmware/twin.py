"""The loop once more in float64: observer, prediction, law, limits, on the frames' own values.

Nothing of it reads the firmware's arithmetic or its integers. Decisions (mode, ramp, trigger) are
taken from the ECU, values never.
"""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Twin:
    """``phi`` (5, 5), ``gamma`` (5,), ``gamma_steering`` (5,), ``output`` (2, 5), ``gains`` (2, 5).

    ``law(ahead, rate, lateral)`` gives the moment wanted, N·m.
    """

    phi: np.ndarray
    gamma: np.ndarray
    gamma_steering: np.ndarray
    output: np.ndarray
    gains: np.ndarray
    law: object
    predict_steps: int = 0
    actuator_rate: float = 1.0
    moment_max: float = np.inf
    slew_max: float = np.inf
    bias_max: float = np.inf
    x: np.ndarray = field(default_factory=lambda: np.zeros(5))
    ring: list = field(default_factory=lambda: [0.0] * 32)
    moment: float = 0.0
    delivered: float = 0.0
    steering: float = 0.0
    rate: float = 0.0
    lateral: float = 0.0

    def tick(self, frames, *, authority: float, gain: float = 1.0, active: bool = True) -> float:
        """Advance by the decoded ``frames`` that were accepted at this tick; the moment."""
        actuators = frames.get("ActuatorState")
        if actuators is not None:
            self.delivered = actuators["DeliveredMomentFront"] + actuators["DeliveredMomentRear"]
        self.x = (
            self.phi @ self.x + self.gamma * self.delivered + self.gamma_steering * self.steering
        )
        imu = frames.get("Imu")
        if imu is not None:
            self.rate, self.lateral = np.radians(imu["RollRate"]), imu["LateralAcceleration"]
            for c, gain_row, y in zip(
                self.output, self.gains, (self.rate, self.lateral), strict=True
            ):
                self.x = self.x + gain_row * (y - c @ self.x)
        self.x[4] = np.clip(self.x[4], -self.bias_max, self.bias_max)
        ahead, moment = self.x, self.delivered
        for command in self.ring[32 - self.predict_steps :]:
            reached = moment + self.actuator_rate * (command - moment)
            mean = (moment + reached) / 2
            ahead = self.phi @ ahead + self.gamma * mean + self.gamma_steering * self.steering
            moment = reached
        if active:
            wanted = self.law(ahead, self.rate, self.lateral) * gain * authority
            wanted = np.clip(wanted, -self.moment_max, self.moment_max)
            self.moment += np.clip(wanted - self.moment, -self.slew_max, self.slew_max)
        return self.moment

    def sent(self, triggered: bool) -> None:
        """Put what is under way in the ring: this tick's moment, or the last one again."""
        self.ring = [*self.ring[1:], self.moment if triggered else self.ring[-1]]
