"""The sampled loop with its uncertain inputs, in floating point.

The places w of the delays and what an event trigger withholds are inputs that depend on the loop's
own signals; roundings and disturbances are inputs with bounds.

*Trigger.* Either the new command u is sent, or the one before, p, stays in force: with σ = u + a in
force a (σ − p) = 0, and a² ≤ ε² σ² but for the floor. For every κ < 1 − ε² both together say

    a² − ε² σ² − κ a (σ − p) = c ((a − a₀)² − a₀² − ε² u² / c) ≤ 0,
    c = 1 − ε² − κ,    a₀ = (2 ε² u + κ (u − p)) / (2 c):

with a₀ put into the loop, what remains of a is small against [a₀, ε u / √c]. With κ = 0, the circle
criterion, every σ near u is possible anew each tick; for κ → −∞ all that is between u and p is.
"""

from dataclasses import dataclass, replace

import numpy as np

from canroll.gain_gen.models.roll import Matrix


@dataclass(frozen=True, slots=True)
class Trigger:
    """The event trigger of a loop whose first input is what it withholds.

    Attributes:
        sent: row of σ on states and inputs, (n + m,).
        before: row of p, (n + m,).
        share: ε².
    """

    sent: Matrix
    before: Matrix
    share: float

    def curvature(self, kappa: float) -> float:
        """Return c."""
        return 1.0 - self.share - kappa

    def kappa(self, curvature: float) -> float:
        """Return κ of a c."""
        return 1.0 - self.share - curvature

    def centre(self, kappa: float) -> tuple[float, float]:
        """Return the factors of u and p in a₀."""
        twice = 2.0 * self.curvature(kappa)
        return (2.0 * self.share + kappa) / twice, -kappa / twice


@dataclass(frozen=True, slots=True)
class UncertainLoop:
    """The sampled loop with its inputs; commands in N·m, Q14, roundings in the ECU's units.

    x⁺ = A x + B i + Σ G_j w_j with |w_j| ≤ |v_j|, v = V [x, i]. Inputs are roundings and
    disturbances, with a trigger preceded by what it withholds, with a limit followed by what that
    cuts off.

    Attributes:
        a: with every delay at the centre of its ellipsoid, (n, n).
        inputs: B, (n, m).
        bounds: of the inputs, of the first one with a trigger the floor; of what the limit cuts
            off there is none, (m,).
        places: G_j for each delay that varies, (n, r).
        jumps: V, (delays, n + m).
        withheld: rows against which the first input is small, no row without a trigger, (k, n + m).
        trigger: of the first input as it is; None without one, and once it is centred.
        opposed: pairs of rows, with a limit, whose product is not positive, (n + m,).
        stored: rows of the values that the code stores, relative to their limit, (k, n).
        spread: largest part of them by roundings and disturbances themselves, (k,).
        roll: row of the roll angle, (n,).
    """

    a: Matrix
    inputs: Matrix
    bounds: Matrix
    places: tuple[Matrix, ...]
    jumps: Matrix
    withheld: Matrix
    trigger: Trigger | None
    opposed: tuple[tuple[Matrix, Matrix], ...]
    stored: Matrix
    spread: Matrix
    roll: Matrix

    @property
    def radius(self) -> float:
        """Spectral radius with every delay at its centre."""
        return float(np.abs(np.linalg.eigvals(self.a)).max())

    def centred(self, kappa: float) -> "UncertainLoop":
        """Return the loop with a₀ of its trigger in it; without a trigger the loop itself."""
        trigger = self.trigger
        if trigger is None:
            return self
        n, c = len(self.a), trigger.curvature(kappa)
        u = trigger.sent.copy()
        u[n] = 0.0
        new, before = trigger.centre(kappa)
        centre = new * u + before * trigger.before

        def driven(rows: Matrix) -> Matrix:
            return rows + np.outer(rows[:, n], centre)

        moved = driven(np.hstack([self.a, self.inputs]))
        return replace(
            self,
            a=moved[:, :n],
            inputs=moved[:, n:],
            bounds=np.r_[self.bounds[0] / np.sqrt(c), self.bounds[1:]],
            jumps=driven(self.jumps),
            withheld=np.array([centre, np.sqrt(trigger.share / c) * u]),
            trigger=None,
        )
