"""Sampling of a continuous plant with held commands that take effect a delay after the sample.

x⁺ = Φ x + Γ_fresh u[k − d + 1] + Γ_stale u[k − d] with d ticks of delay, the last one fractional:
the hold and the fractional delay are exact (Åström, Wittenmark 1997, section 2.5).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_lyapunov

from gain_gen.models.controller import Controller, matrices
from gain_gen.models.roll import Matrix, zero_order_hold

Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, slots=True)
class HeldPlant:
    """A sampled plant with input delay.

    Attributes:
        phi: (n, n).
        fresh: column of the newer of the two commands that act in a tick, (n, 1).
        stale: column of the older, (n, 1); zero without a delay.
        steps: d, ticks of delay rounded up.
        tick: s.
    """

    phi: Matrix
    fresh: Matrix
    stale: Matrix
    steps: int
    tick: float


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
    plant: HeldPlant, controller: Controller, measured: Matrix
) -> tuple[Matrix, Matrix, Matrix]:
    """Return A, B, C of plant, delay line and controller, cut where the command leaves the ECU.

    x⁺ = A x + B u, u = C x closes it. The controller's own ring of past commands stays closed: it
    holds what the controller computed. The plant's states come first, the delay line follows, its
    first entry is the oldest command not yet in effect.

    Args:
        plant: at the controller's tick.
        controller: as the ECU runs it.
        measured: its inputs as rows on the plant's state, in its order, (4, n).
    """
    ac, bc, cc, dc = matrices(controller)
    n, lines, m = len(plant.phi), max(plant.steps, 1), len(ac)
    size = n + lines + m
    a = np.zeros((size, size))
    b = np.zeros((size, 1))
    a[:n, :n] = plant.phi
    if plant.steps:
        a[:n, n : n + 1] = plant.stale
    if plant.steps > 1:
        a[:n, n + 1 : n + 2] = plant.fresh
    else:
        b[:n] = plant.fresh
    a[n : n + lines - 1, n + 1 : n + lines] = np.eye(lines - 1)
    b[n + lines - 1] = 1.0

    wide = np.hstack([measured, np.zeros((len(measured), size - n))])
    c = dc @ wide
    c[:, n + lines :] += cc
    a[n + lines :] = bc @ wide
    a[n + lines :, n + lines :] += ac
    return a, b, c


def resolvent_rows(phi: Matrix, rows: Matrix, z: Complex) -> Complex:
    """Return C (z − Φ)⁻¹ at every z, (len(z), rows, n)."""
    shifted = z[:, None, None] * np.eye(len(phi)) - phi.T
    columns = np.broadcast_to(rows.T.astype(complex), (len(z), *rows.T.shape))
    return np.asarray(np.linalg.solve(shifted, columns).transpose(0, 2, 1), dtype=complex)


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
        rows: C (z − Φ)⁻¹ by :func:`resolvent_rows`, (len(z), m, n).
        z: e^{jωT}.

    Returns:
        (len(z), m, m), Hermitian.
    """
    weighted = solve_continuous_lyapunov(a, -command @ command.T) @ measured.T
    half: Complex = tick * (z[:, None, None] * (rows @ weighted) - 0.5 * measured @ weighted)
    return half + np.conj(half.transpose(0, 2, 1))


def command_response(plant: HeldPlant, rows: Complex, z: Complex) -> Complex:
    """Return the response to the command at every z, (len(z), rows).

    ``rows`` is what :func:`resolvent_rows` returns for the plant.
    """
    fresh, stale = (rows @ column for column in (plant.fresh, plant.stale))
    line = z ** -max(plant.steps - 1, 0)
    return np.asarray((fresh + stale / z[:, None, None])[:, :, 0] * line[:, None], dtype=complex)
