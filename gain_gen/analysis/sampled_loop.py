"""The sampled closed loop: continuous plant and actuator, delay, hold, discrete controller."""

from dataclasses import dataclass

import numpy as np

from canroll.gain_gen.analysis.held_plant import held, opened, padded
from canroll.gain_gen.models.controller import LinearController
from canroll.gain_gen.models.observer import LateralModel
from canroll.gain_gen.models.roll import (
    Matrix,
    lateral_input,
    moment_input,
    state_matrix,
    stationary_covariance,
    zero_order_hold,
)
from canroll.gain_gen.models.state_space import Complex, resolvent, resolvent_rows
from canroll.vehicles import GRAVITY, RollModel

ROLL, RATE, MOMENT, LATERAL, JERK = range(5)


@dataclass(frozen=True, slots=True)
class SampledLoop:
    """A sampled closed loop cut where the command leaves the ECU.

    x⁺ = A x + B u, u = C x closes it; noise enters through ``noise`` (white, unit variance). The
    controller's own ring of past commands stays closed: it holds what the controller computed.

    Attributes:
        a: (n, n), plant, delay line and controller.
        b: (n, 1), the command that enters the delay line.
        c: (1, n), the command that the controller computes.
        noise: (n, 1), a disturbance; of the roll model, that of the lateral-acceleration model.
        tick: s.
        apart: number of states of a disturbance model, which no command reaches.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    noise: Matrix
    tick: float
    apart: tuple[int, ...] = ()

    @property
    def closed(self) -> Matrix:
        """A + B C."""
        return self.a + self.b @ self.c


def continuous_plant(
    model: RollModel, lag: float, lateral: LateralModel
) -> tuple[Matrix, Matrix, Matrix]:
    """Return A (5, 5), the command's column and the noise column of [φ, φ', M, a_y, a_y'].

    The actuator is a first-order lag of ``lag`` seconds; zero is taken as 0.1 ms.
    """
    a = np.zeros((5, 5))
    a[:2, :2] = state_matrix(model)
    a[:2, MOMENT : MOMENT + 1] = moment_input(model)
    a[:2, LATERAL : LATERAL + 1] = lateral_input(model)
    lag = max(lag, 1e-4)
    a[MOMENT, MOMENT] = -1.0 / lag
    frequency = lateral.frequency or 1.5
    a[LATERAL, JERK] = 1.0
    a[JERK, LATERAL] = -(frequency**2)
    a[JERK, JERK] = -2.0 * lateral.damping * frequency
    command = np.zeros((5, 1))
    command[MOMENT] = 1.0 / lag
    noise = np.zeros((5, 1))
    noise[JERK] = np.sqrt(4.0 * lateral.damping * frequency**3) * lateral.acceleration
    return a, command, noise


def build(
    model: RollModel,
    controller: LinearController,
    *,
    delay: float,
    lag: float,
    lateral: LateralModel | None = None,
) -> SampledLoop:
    """Return the loop of ``controller`` with a constant delay from sample to force.

    Args:
        model: the plant, possibly other than the design model.
        controller: as the ECU runs it.
        delay: τ ≥ 0 from the instant of the sample to the change of the actuator's command, s.
        lag: time constant of the actuator, s.
        lateral: model of the lateral acceleration.
    """
    tick = controller.tick
    lateral = lateral or LateralModel()
    a, command, noise = continuous_plant(model, lag, lateral)
    measured = np.zeros((4, len(a)))
    measured[0, RATE] = 1.0
    measured[1, ROLL], measured[1, LATERAL] = GRAVITY, 1.0
    measured[2, ROLL] = 1.0
    measured[3, MOMENT] = 1.0
    plant = held(a, command, tick=tick, delay=delay)
    loop, b, c = opened(plant, controller, measured)
    # white noise over a tick acts almost as its mean held: a_y moves slowly against the tick
    driven = zero_order_hold(a, noise, tick)[1] / np.sqrt(tick)
    return SampledLoop(loop, b, c, padded(driven.T, len(loop)).T, tick, apart=(LATERAL, JERK))


def spectral_radius(loop: SampledLoop) -> float:
    """Return the largest modulus of the closed loop's eigenvalues without a disturbance model's.

    That model is stable and not controlled; its eigenvalues would hide the loop's own.
    """
    keep = [i for i in range(len(loop.a)) if i not in loop.apart]
    eigenvalues = np.linalg.eigvals(loop.closed[np.ix_(keep, keep)])
    return float(np.abs(eigenvalues).max())


def roll_rms(loop: SampledLoop) -> float:
    """Return the stationary standard deviation of the roll angle, rad; infinite if unstable."""
    if spectral_radius(loop) >= 1.0:
        return float("inf")
    covariance = stationary_covariance(loop.closed, loop.noise @ loop.noise.T)
    return float(np.sqrt(max(covariance[ROLL, ROLL], 0.0)))


def loop_gain(loop: SampledLoop, frequencies: Matrix) -> Complex:
    """Return L(e^{jωT}) = −C (z − A)⁻¹ B, negative feedback, at ``frequencies`` in rad/s."""
    z = np.exp(1j * frequencies * loop.tick)
    gain = -(loop.c @ resolvent(loop.a, loop.b, z))
    return np.asarray(gain[:, 0, 0], dtype=complex)


def response_peak(loop: SampledLoop, row: Matrix) -> float:
    """Return the peak of the closed loop's response from ``noise`` to ``row`` x.

    Infinite if the loop is unstable.

    Args:
        loop: the open loop, closed here.
        row: on the first states of the loop, (m,).
    """
    if spectral_radius(loop) >= 1.0:
        return float("inf")
    z = np.exp(1j * np.geomspace(1e-2, 0.98 * np.pi / loop.tick, 400) * loop.tick)
    rows = resolvent_rows(loop.closed, padded(row[None, :], len(loop.a)), z)
    return float(np.abs(rows @ loop.noise).max())
