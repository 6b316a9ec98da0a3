"""Kernel of the Magic Formula 5.2 to 6.2; data: :mod:`canroll.vehicles.tyres.magic_formula`.

Equations (4.E1) to (4.E78) of Pacejka, Tire and Vehicle Dynamics, 3rd edition, in steady state and
without turn slip. Where book and solvers differ, as in the paper of Besselink, Schmeitz and Pacejka
(An improved Magic Formula/Swift tyre model that can handle inflation pressure changes, 2010):
trail and its stiffness with the signed camber (A58, A60), equivalent slip by tangents (A54, A55).
Slip in version 6 is the tangent of the slip angle, camber its sine (4.E3, 4.E4).

Letters are those of the book: C shape, D peak, E curvature, B stiffness over C D, H and V shifts.
"""

from math import atan, copysign, cos, exp, nan, sin, sqrt, tan
from typing import Any

import numpy as np
from numba.types import float64, int64, void

from canroll.plant_sim.kernels.jit import (
    Linked,
    address_of,
    function_at,
    inlined,
    njit,
    record_of,
    stack_vector,
)
from canroll.vehicles.tyres.magic_formula import MagicFormula

TINY = 1e-6
"""Force (N) that keeps a quotient finite where a tyre has no peak."""
STEEPEST = 1.5
"""Slip (rad) before the pole of the tangent, from which the moment has only its residue."""

tyre_of = record_of(np.dtype([(name, "f8") for name in MagicFormula.NUMBERS]))


@inlined
def bent(x: float, curvature: float) -> float:
    """Argument of the outer arctangent of the formula."""
    return x - curvature * (x - atan(x))


@inlined
def weight(slip: float, shift: float, stiffness: float, shape: float, curvature: float) -> float:
    """Factor by which the other slip reduces a force; 1 without it."""
    here = cos(shape * atan(bent(stiffness * (slip + shift), curvature)))
    return here / cos(shape * atan(bent(stiffness * shift, curvature)))


@njit
def longitudinal(  # noqa: PLR0917
    tyre: Any,  # noqa: ANN401
    load: float,
    overload: float,
    slip: float,
    angle: float,
    friction: float,
) -> tuple[float, float]:
    """Longitudinal force (N) of a wheel cambered by ``angle`` (rad), and slip stiffness (N)."""
    stiffness = load * (tyre.kx1 + tyre.kx2 * overload) * exp(tyre.kx3 * overload)
    peak = (tyre.dx1 + tyre.dx2 * overload) * (1.0 - tyre.dx3 * angle * angle) * friction * load
    x = slip + tyre.hx1 + tyre.hx2 * overload
    curvature = tyre.ex1 + overload * (tyre.ex2 + tyre.ex3 * overload)
    curvature = min(curvature * (1.0 - tyre.ex4 * copysign(1.0, x)), 1.0)
    x *= stiffness / (tyre.cx * peak + copysign(TINY, peak))
    lift = load * (tyre.vx1 + tyre.vx2 * overload) * friction
    return peak * sin(tyre.cx * atan(bent(x, curvature))) + lift, stiffness


@njit
def lateral(  # noqa: PLR0917
    tyre: Any,  # noqa: ANN401
    load: float,
    overload: float,
    slip: float,
    camber: float,
    friction: float,
) -> tuple[float, float, float, float, float]:
    """Lateral force (N) without longitudinal slip, and what the moment needs of it.

    That is: cornering stiffness (N/rad, < 0), B C (1/rad), peak (N) and the slip at which the
    tyre has no force, negative.
    """
    square = camber * camber
    stiffness = tyre.ky1 * (1.0 - tyre.ky3 * abs(camber))
    stiffness *= sin(tyre.ky4 * atan(load / (tyre.ky2 + tyre.ky5 * square)))
    stiffness += copysign(TINY, stiffness)
    of_camber = load * (tyre.vy3 + tyre.vy4 * overload) * camber * friction
    thrust = load * (tyre.kg1 + tyre.kg2 * overload) * camber - of_camber
    shift = tyre.hy1 + tyre.hy2 * overload + tyre.hy3 * camber + tyre.six * thrust / stiffness
    lift = load * (tyre.vy1 + tyre.vy2 * overload) * friction + of_camber
    peak = (tyre.dy1 + tyre.dy2 * overload) * (1.0 - tyre.dy3 * square) * friction * load
    x = slip + shift
    tilt = (tyre.ey3 + tyre.ey4 * camber) * copysign(1.0, x)
    curvature = (tyre.ey1 + tyre.ey2 * overload) * (1.0 + tyre.ey5 * square - tilt)
    steepness = stiffness / (tyre.cy * peak + copysign(TINY, peak))
    force = peak * sin(tyre.cy * atan(bent(steepness * x, min(curvature, 1.0)))) + lift
    return force, stiffness, steepness * tyre.cy, peak, shift + lift / stiffness


@inlined
def equivalent(slip: float, square: float) -> float:
    """Slip (rad) that counts for the moment, with the ``square`` of the other one, scaled."""
    tangent = tan(min(abs(slip), STEEPEST))
    return copysign(atan(sqrt(tangent * tangent + square)), slip)


@njit
def trail(  # noqa: PLR0917
    tyre: Any,  # noqa: ANN401
    load: float,
    overload: float,
    slip: float,
    camber: float,
    angle: float,
    friction: float,
    square: float,
) -> float:
    """Pneumatic trail (m), before its factor cos α."""
    slip += tyre.ht1 + tyre.ht2 * overload + (tyre.ht3 + tyre.ht4 * overload) * camber
    steepness = tyre.bt1 + overload * (tyre.bt2 + tyre.bt3 * overload)
    steepness *= (1.0 + tyre.bt4 * angle + tyre.bt5 * abs(angle)) / friction
    peak = load * (tyre.dt1 + tyre.dt2 * overload)
    peak *= 1.0 + angle * (tyre.dt3 + tyre.dt4 * angle)
    tilt = (tyre.et4 + tyre.et5 * camber) * atan(steepness * tyre.ct * slip)
    curvature = (tyre.et1 + overload * (tyre.et2 + tyre.et3 * overload)) * (1.0 + tilt)
    x = bent(steepness * equivalent(slip, square), min(curvature, 1.0))
    arm: float = peak * cos(tyre.ct * atan(x))
    return arm


@njit
def residual(  # noqa: PLR0917
    tyre: Any,  # noqa: ANN401
    load: float,
    overload: float,
    slip: float,
    camber: float,
    friction: float,
    steepness: float,
) -> float:
    """Moment (N·m) that is left where the trail is zero, before its factor cos α."""
    peak = tyre.dr8 + tyre.dr9 * overload + (tyre.dr10 + tyre.dr11 * overload) * abs(camber)
    peak = load * (tyre.dr6 + tyre.dr7 * overload + peak * camber) * friction
    moment: float = peak * cos(atan((tyre.br9 / friction + tyre.br10 * steepness) * slip))
    return moment


@njit
def forces_of_tyre(  # noqa: PLR0917
    tyre: Any,  # noqa: ANN401
    load: float,
    slip_ratio: float,
    slip_angle: float,
    camber: float,
    friction: float,
    hand: float,
) -> tuple[float, float, float]:
    """Forces (N) and moment (N·m) of a tyre; ``hand`` is 1 on the left and -1 on the right."""
    if not (load > 0.0 and friction > 0.0):
        return 0.0, 0.0, 0.0
    # slips of the file: positive moves to the left, of the side on which the tyre was measured
    hand *= tyre.side
    load = min(load, tyre.load_max)
    kappa = min(max(slip_ratio, tyre.ratio_min), tyre.ratio_max)
    alpha = min(max(-hand * slip_angle, tyre.slip_min), tyre.slip_max)
    gamma = min(max(hand * camber, tyre.camber_min), tyre.camber_max)
    angle = atan(gamma / sqrt(max(1.0 - gamma * gamma, TINY)))
    overload = load * tyre.per_nominal - 1.0
    square = gamma * gamma

    ahead, slip_stiffness = longitudinal(tyre, load, overload, kappa, angle, friction)
    stiffness = (tyre.bxa1 + tyre.bxa3 * square) * cos(atan(tyre.bxa2 * kappa))
    curvature = min(tyre.exa1 + tyre.exa2 * overload, 1.0)
    ahead *= weight(alpha, tyre.hxa, stiffness, tyre.cxa, curvature)

    pure, cornering, steepness, peak, zero = lateral(tyre, load, overload, alpha, gamma, friction)
    stiffness = (tyre.byk1 + tyre.byk4 * square) * cos(atan(tyre.byk2 * (alpha - tyre.byk3)))
    curvature = min(tyre.eyk1 + tyre.eyk2 * overload, 1.0)
    shift = tyre.hyk1 + tyre.hyk2 * overload
    left = weight(kappa, shift, stiffness, tyre.cyk, curvature)
    by_ratio = peak * (tyre.vyk1 + tyre.vyk2 * overload + tyre.vyk3 * gamma)
    by_ratio *= cos(atan(tyre.vyk4 * alpha)) * sin(tyre.vyk5 * atan(tyre.vyk6 * kappa))
    aside = left * pure + by_ratio

    ratio = slip_stiffness / cornering * kappa
    ratio *= ratio
    # version 6 has the trail at the force without camber
    upright = lateral(tyre, load, overload, alpha, (1.0 - tyre.six) * gamma, friction)[0]
    moment = residual(
        tyre, load, overload, equivalent(alpha + zero, ratio), gamma, friction, steepness
    )
    moment -= left * upright * trail(tyre, load, overload, alpha, gamma, angle, friction, ratio)
    moment /= sqrt(1.0 + alpha * alpha)
    lever = tyre.s1 + tyre.s2 * aside + (tyre.s3 + tyre.s4 * overload) * angle
    return ahead, hand * aside, hand * (moment + lever * ahead)


@njit
def magic_formula(  # noqa: PLR0917
    axle: Any,  # noqa: ANN401
    load: float,
    slip_ratio: float,
    slip_angle: float,
    camber: float,
    friction: float,
    hand: float,
) -> tuple[float, float, float]:
    """Kernel of :class:`canroll.vehicles.tyres.magic_formula.MagicFormula`."""
    tyre = tyre_of(axle.tyre)
    return forces_of_tyre(tyre, load, slip_ratio, slip_angle, camber, friction, hand)


LINK = Linked("canroll_magic_formula")
"""Where :mod:`canroll.plant_sim.bodies.magic_formula_step` is, once a vehicle needs it."""

_address = LINK.address
_step_at = function_at(void(int64, float64[::1]))
_numbers = stack_vector(6)


@inlined
def linked(  # noqa: PLR0917
    axle: Any,  # noqa: ANN401
    load: float,
    slip_ratio: float,
    slip_angle: float,
    camber: float,
    friction: float,
    hand: float,
) -> tuple[float, float, float]:
    """:func:`magic_formula` at its address: vehicles without such tyres need not compile it."""
    address = _address()
    if address == 0:
        return nan, nan, nan
    numbers, step = _numbers(), _step_at(address)
    numbers[0], numbers[1], numbers[2] = load, slip_ratio, slip_angle
    numbers[3], numbers[4], numbers[5] = camber, friction, hand
    step(address_of(axle.tyre), numbers)
    return numbers[0], numbers[1], numbers[2]


linked.in_c = magic_formula  # type: ignore[attr-defined]  # for the translation to C
