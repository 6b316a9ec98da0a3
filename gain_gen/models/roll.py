"""The 1-DOF roll plant as design model: matrices, normalised form, exact discretisation."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from canroll.vehicles import GRAVITY, RollModel

Matrix = NDArray[np.floating[Any]]


def state_matrix(model: RollModel) -> Matrix:
    """Return A of x = [φ, φ'], (2, 2): Redondo 2021, (4), with the damping term negative."""
    return np.array(
        [
            [0.0, 1.0],
            [
                -model.effective_stiffness / model.roll_inertia,
                -model.roll_damping / model.roll_inertia,
            ],
        ]
    )


def moment_input(model: RollModel) -> Matrix:
    """Return the input column of the anti-roll moment, (2, 1)."""
    return np.array([[0.0], [1.0 / model.roll_inertia]])


def lateral_input(model: RollModel) -> Matrix:
    """Return the input column of the lateral acceleration, (2, 1)."""
    return np.array([[0.0], [model.roll_arm / model.roll_inertia]])


def disturbance_input(model: RollModel) -> Matrix:
    """Return the input columns of w = [a_y, road bank, unknown disturbance], (2, 3)."""
    per_lateral = model.roll_arm / model.roll_inertia
    return np.array([[0.0, 0.0, 1.0], [per_lateral, per_lateral * GRAVITY, 1.0]])


def scaled(
    model: RollModel,
    *,
    inertia: float = 1.0,
    damping: float = 1.0,
    stiffness: float = 1.0,
    mass: float = 1.0,
) -> RollModel:
    """Return ``model`` with its parameters multiplied by the factors given."""
    return replace(
        model,
        roll_inertia=model.roll_inertia * inertia,
        roll_damping=model.roll_damping * damping,
        roll_stiffness=model.roll_stiffness * stiffness,
        sprung_mass=model.sprung_mass * mass,
    )


PERFORMANCE = np.array([[1.0, 1.0]])
"""z = φ + φ', the controlled output of the 2021 and 2022 papers."""

ROLL_RATE = np.array([[0.0, 1.0]])
"""y = φ', the measured output of the same papers."""


@dataclass(frozen=True, slots=True)
class NormalisedPlant:
    """The plant in time units of 1/ωn and moments of K_eff: every entry is near one.

    x = [φ, φ'/ωn], t' = ωn t, u' = u / K_eff. Semidefinite solvers report wrong optima in SI
    units; the H∞ level from w to z is the same in both.
    """

    a: Matrix
    b: Matrix
    b_disturbance: Matrix
    performance: Matrix
    frequency: float
    stiffness: float

    def delay(self, seconds: float) -> float:
        """Return ``seconds`` in units of 1/ωn."""
        return self.frequency * seconds

    def rate_gain(self, gain: float) -> float:
        """Return a normalised gain on [.., φ'/ωn] as N·m·s/rad."""
        return gain * self.stiffness / self.frequency


def normalise(model: RollModel) -> NormalisedPlant:
    """Return ``model`` in normalised units, in which the solvers are reliable."""
    frequency = model.natural_frequency
    scale = np.diag([1.0, 1.0 / frequency])
    return NormalisedPlant(
        a=np.array([[0.0, 1.0], [-1.0, -2.0 * model.damping_ratio]]),
        b=np.array([[0.0], [1.0]]),
        b_disturbance=scale @ disturbance_input(model) / frequency,
        performance=np.array([[1.0, frequency]]),
        frequency=frequency,
        stiffness=model.effective_stiffness,
    )


def zero_order_hold(a: Matrix, b: Matrix, step: float) -> tuple[Matrix, Matrix]:
    """Return Φ, Γ of x' = A x + B u with u held over ``step`` seconds, exactly.

    Args:
        a: (n, n).
        b: (n, m).
        step: hold time, s; zero gives Φ = 1, Γ = 0.
    """
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n] = a
    block[:n, n:] = b
    exponential = expm(block * step)
    return exponential[:n, :n], exponential[:n, n:]


def stationary_covariance(a: Matrix, noise: Matrix) -> Matrix:
    """Return P = A P A' + N for a stable A by doubling (Smith 1968), (n, n).

    Near the stability limit it stays accurate where the direct solvers warn; 2⁴⁰ steps suffice
    for any loop that float64 can distinguish from a marginal one.
    """
    covariance = noise
    for _ in range(40):
        added = a @ covariance @ a.T
        covariance = covariance + added
        a = a @ a
        if np.abs(added).max() <= 1e-14 * np.abs(covariance).max():
            break
    return covariance
