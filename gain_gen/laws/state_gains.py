"""State-feedback gains without an LMI: discrete LQR, sliding mode, disturbance feedforward."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_are

from canroll.gain_gen.models.roll import (
    Matrix,
    lateral_input,
    moment_input,
    state_matrix,
    zero_order_hold,
)
from canroll.vehicles import RollModel

DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True, slots=True)
class Weights:
    """Bryson's rule: the largest acceptable value of each quantity.

    Attributes:
        roll: rad.
        roll_rate: rad/s.
        moment: N·m.
    """

    roll: float
    roll_rate: float
    moment: float

    @property
    def state(self) -> Matrix:
        """Q = diag(1/ρ₁², 1/ρ₂²)."""
        return np.diag([self.roll**-2, self.roll_rate**-2])

    @property
    def input(self) -> Matrix:
        """R = 1/ρ₃²."""
        return np.array([[self.moment**-2]])


YIM_STIFFNESS = 60456.132
"""K − m g h of the small SUV of Yim 2020, Table 1, N·m/rad."""


def yim_weights(model: RollModel) -> Weights:
    """Return the weights of Yim 2020, Table 2, the moment scaled up with the roll stiffness.

    2000 N·m is 1.9 times the moment that holds the SUV at one degree; a stiffer vehicle gets the
    same ratio, a softer one the printed value.
    """
    ratio = max(1.0, model.effective_stiffness / YIM_STIFFNESS)
    return Weights(DEGREE, 10.0 * DEGREE, 2000.0 * ratio)


def discrete_plant(model: RollModel, tick: float) -> tuple[Matrix, Matrix, Matrix]:
    """Return Φ (2, 2), Γ of the moment (2, 1) and Π of the lateral acceleration (2, 1)."""
    phi, inputs = zero_order_hold(
        state_matrix(model), np.hstack([moment_input(model), lateral_input(model)]), tick
    )
    return phi, inputs[:, :1], inputs[:, 1:]


def riccati_gain(phi: Matrix, gamma: Matrix, state_weight: Matrix, input_weight: Matrix) -> Matrix:
    """Return K of u = −K x that minimises Σ x'Qx + u'Ru, by the discrete Riccati equation.

    Args:
        phi: (n, n).
        gamma: (n, m).
        state_weight: Q, (n, n).
        input_weight: R, (m, m).

    Returns:
        K, (m, n).
    """
    # a common factor of Q and R does not move K, and R near 1 keeps the pencil balanced
    scale = float(np.trace(input_weight)) / len(input_weight)
    cost = solve_discrete_are(phi, gamma, state_weight / scale, input_weight / scale)
    gain: Matrix = np.linalg.solve(
        input_weight / scale + gamma.T @ cost @ gamma, gamma.T @ cost @ phi
    )
    return gain


def lqr(model: RollModel, tick: float, weights: Weights) -> Matrix:
    """Return K of u = −K [φ, φ'], (1, 2), on the exact discretisation (Yim 2020, (7)–(10))."""
    phi, gamma, _ = discrete_plant(model, tick)
    return riccati_gain(phi, gamma, weights.state, weights.input)


def sliding_mode(model: RollModel, tick: float, *, surface: Matrix, alpha: float) -> Matrix:
    """Return K of u = −K x that gives s(k+1) = α s(k) on s = H x (Yim 2020, (14)–(18)).

    Args:
        model: design model.
        tick: s.
        surface: H, (1, 2).
        alpha: fraction of s that remains after a tick, 0 < α < 1.

    Raises:
        ValueError: α outside its range, or the input does not move the surface.
    """
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"alpha = {alpha} is outside (0, 1)")
    phi, gamma, _ = discrete_plant(model, tick)
    reach = float((surface @ gamma)[0, 0])
    if abs(reach) < np.finfo(float).tiny:
        raise ValueError("the moment does not move the sliding surface")
    return surface @ (phi - alpha * np.eye(2)) / reach


def disturbance_feedforward(model: RollModel, tick: float) -> float:
    """Return K_FF = Γ⁺ Π of u = −K_FF a_y, N·m per m/s² (Yim 2020, (21)); it equals m h."""
    _, gamma, pi = discrete_plant(model, tick)
    return float((np.linalg.pinv(gamma) @ pi)[0, 0])
