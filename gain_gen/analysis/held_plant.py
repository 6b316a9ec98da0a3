"""Sampling of a continuous plant with held commands that take effect a delay after the sample.

x⁺ = Φ x + Γ_fresh u[k − d + 1] + Γ_stale u[k − d] with d ticks of delay, the last one fractional:
the hold and the fractional delay are exact (Åström, Wittenmark 1997, section 2.5).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from canroll.gain_gen.models.controller import LinearController, matrices
from canroll.gain_gen.models.roll import Matrix, zero_order_hold
from canroll.gain_gen.models.state_space import Complex


@dataclass(frozen=True, slots=True)
class HeldPlant:
    """A sampled plant with input delay.

    Attributes:
        phi: (n, n).
        fresh: column of the newer of the two commands that act in a tick, (n, inputs).
        stale: column of the older, (n, inputs); zero without a delay.
        steps: d, ticks of delay rounded up.
        tick: s.
    """

    phi: Matrix
    fresh: Matrix
    stale: Matrix
    steps: int
    tick: float

    def delayed(self, past: int = 0) -> tuple[Matrix, Matrix]:
        """Return A, B with the commands under way as states after the plant's, the oldest first.

        ``past`` commands, where these are more than are under way.
        """
        n, m = self.fresh.shape
        line = m * max(past, self.steps)
        joint = np.zeros((n + line, n + line + m))
        joint[:n, :n], joint[n:, n + m :] = self.phi, np.eye(line)
        for column, age in ((self.fresh, max(self.steps - 1, 0)), (self.stale, self.steps)):
            joint[:n, n + line - m * age :][:, :m] += column
        return joint[:, : n + line], joint[:, n + line :]


def held(a: Matrix, command: Matrix, *, tick: float, delay: float) -> HeldPlant:
    """Return x' = A x + B u sampled at the tick.

    Args:
        a: (n, n).
        command: B, (n, 1).
        tick: s.
        delay: τ ≥ 0 from the instant of the sample to the change of the command, s.
    """
    steps = int(np.ceil(delay / tick - 1e-9))
    late = delay - (steps - 1) * tick if steps else 0.0
    phi, _ = zero_order_hold(a, command, tick)
    after, fresh = zero_order_hold(a, command, tick - late)
    _, before = zero_order_hold(a, command, late)
    return HeldPlant(phi, fresh, after @ before, steps, tick)


def opened(
    plant: HeldPlant, controller: LinearController, measured: Matrix, *, summed: bool = True
) -> tuple[Matrix, Matrix, Matrix]:
    """Return A, B, C of plant, delay line and controller, cut where the command leaves the ECU.

    x⁺ = A x + B u, u = C x closes it. The controller's own ring of past commands stays closed: it
    holds what the controller computed. The plant's states come first, the delay line follows, its
    first entry is the oldest command not yet in effect.

    Args:
        plant: at the controller's tick.
        controller: as the ECU runs it.
        measured: its inputs as rows on the plant's state, in its order, (4, n).
        summed: whether a compensator's two outputs are one command, their sum.
    """
    ac, bc, cc, dc = matrices(controller, summed=summed)
    line, entry = plant.delayed()
    seen = padded(measured, len(line))
    a = np.block([[line, np.zeros((len(line), len(ac)))], [bc @ seen, ac]])
    return a, padded(entry.T, len(a)).T, np.hstack([dc @ seen, cc])


def padded(rows: Matrix, width: int) -> Matrix:
    """Return rows on the first states of a loop as rows on all ``width`` of them."""
    return np.pad(rows, ((0, 0), (0, width - rows.shape[1])))


def aliased(
    a: Matrix, command: Matrix, measured: Matrix, *, tick: float, rows: Complex, z: Complex
) -> Complex:
    """Return Σ_k p(jω_k) p(jω_k)ᴴ of p(s) = C (s − A)⁻¹ B over all ω_k = ω + 2πk/T.

    That is what a sampler makes of white noise before the plant. With A W + W A' = −B B',
    p pᴴ = C [(jω − A)⁻¹ W + W (jω − A)⁻ᴴ] C'; and Σ_k (jω_k − A)⁻¹ = T [z (z − Φ)⁻¹ − ½], the
    partial fractions of the cotangent. A delay leaves the sum as it is.

    Args:
        a: (n, n), no two eigenvalues of which add up to zero.
        command: B, (n, 1).
        measured: C, (m, n).
        tick: T, s.
        rows: C (z − Φ)⁻¹ by :func:`canroll.gain_gen.models.state_space.resolvent_rows`,
            (len(z), m, n).
        z: e^{jωT}.

    Returns:
        (len(z), m, m), Hermitian.
    """
    weighted = solve_continuous_lyapunov(a, -command @ command.T) @ measured.T
    half: Complex = tick * (z[:, None, None] * (rows @ weighted) - 0.5 * measured @ weighted)
    return half + np.conj(half.transpose(0, 2, 1))


def command_response(plant: HeldPlant, rows: Complex, z: Complex) -> Complex:
    """Return the response to the command at every z, (len(z), rows).

    ``rows`` is what that returns for the plant.
    """
    fresh, stale = (rows @ column for column in (plant.fresh, plant.stale))
    line = z ** -max(plant.steps - 1, 0)
    return np.asarray((fresh + stale / z[:, None, None])[:, :, 0] * line[:, None], dtype=complex)
