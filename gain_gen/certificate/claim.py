"""A claim of a certificate: found in floating point, written in rationals, then checked."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq
from scipy.linalg import eigh

from gain_gen.certificate import checker
from gain_gen.certificate.delay_curve import POINTS, Ellipsoid, ellipsoid, lacking
from gain_gen.certificate.lyapunov import SLACK, Point, UncertainLoop, feasible
from gain_gen.models.roll import Matrix, zero_order_hold

BITS = 45
"""Of the numbers that are found."""
CELLS = 256
"""Of the curve of a delay."""
ROUNDED_UP = 1.0 + 1e-9
"""Factor from a proved bound to the claimed one."""
TRIED = 12
"""Points that are checked before a claim counts as not proved."""


def rational(value: float, bits: int | None = None) -> str:
    """Return a number as text, exactly or with ``bits`` of its mantissa."""
    if bits is not None:
        mantissa, exponent = np.frexp(value)
        value = float(np.ldexp(round(float(mantissa) * 2.0**bits), int(exponent) - bits))
    return str(Fraction(value))


def texts(rows: Matrix, bits: int | None = None) -> list[Any]:
    """Return a vector or matrix of such numbers."""
    if rows.ndim == 1:
        return [rational(float(value), bits) for value in rows]
    return [texts(row, bits) for row in rows]


def prove(
    c: Mapping[str, Any],
    condition: Mapping[str, Any],
    *,
    name: str,
    delay: Sequence[float],
    resolution: Sequence[str],
    trigger: bool,
) -> dict[str, Any] | None:
    """Return a proved claim, or None where none is found.

    Args:
        c: integers of the controller.
        condition: of the certificate.
        name: of the claim.
        delay: least and most from the sample to the force, s.
        resolution: bounds of the roundings of readings and commands, in the ECU's units.
        trigger: commands are withheld by the event trigger.
    """
    claim: dict[str, Any] = {
        "name": name,
        "delay": texts(np.array(delay)),
        "resolution": list(resolution),
        "trigger": trigger,
        "slack": rational(SLACK),
        "channels": [],
    }
    tick = fmpq(c["tick_us"], 1000000)
    sampled = checker.Sampled(c, condition, claim, tick)
    places, loop = uncertain(c, condition, claim, sampled)
    for point in feasible(loop)[:TRIED]:
        proved = _checked(claim | _written(point, places, condition), c, condition, tick)
        if proved is not None:
            return proved
    return None


def _written(
    point: Point, places: Sequence[Ellipsoid], condition: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the numbers of a point as texts."""
    a = _floats(condition["a"])
    plant = point.p[: len(a), : len(a)]
    growth = 0.5 * float(eigh(plant @ a + a.T @ plant, plant, eigvals_only=True)[-1])
    return {
        "cells": CELLS,
        "decay": rational(point.decay, BITS),
        "trigger_weight": rational(point.withheld, BITS),
        "noise_weights": texts(point.roundings, BITS),
        "p": _symmetric(point.p),
        "growth": rational(1.01 * max(growth, 0.0) + 1.0, BITS),
        "channels": [
            {
                "weight": rational(float(d), BITS),
                "centre": texts(place.centre[:, None], BITS),
                "generators": texts(place.generators, BITS),
                "onto": texts(place.onto, BITS),
            }
            for d, place in zip(point.delays, places, strict=True)
        ],
    }


def uncertain(
    c: Mapping[str, Any],
    condition: Mapping[str, Any],
    claim: Mapping[str, Any],
    sampled: checker.Sampled,
) -> tuple[list[Ellipsoid], UncertainLoop]:
    """Return the ellipsoids of the delays that vary, and the loop in floating point."""
    a, readings_roll = (_floats(condition[key]) for key in ("a", "roll"))
    b = _floats(condition["b"])[:, 0]
    n, tick, order = len(a), 1e-6 * c["tick_us"], sampled.order

    def row(form: checker.Form) -> Matrix:
        return np.array([_float(form.get(name, 0)) for name in sampled.names[: order + 1]])

    sent = row(sampled.sent)
    after = np.zeros((order, order + 1))
    after[:n, :n] = zero_order_hold(a, b[:, None], tick)[0]
    after[:n] += np.outer(lacking(a, b, tick, np.array([tick]))[0], sent)
    places, jumps = [], []
    for ends, form in zip(sampled.ends, sampled.jumps, strict=True):
        jump = row(form)
        instants = np.linspace(_float(ends[0]), _float(ends[1]), POINTS)
        curve = lacking(a, b, tick, instants)
        if ends[0] == ends[1]:
            after[:n] += np.outer(curve[0], jump)
            continue
        places.append(ellipsoid(curve))
        after[:n] += np.outer(places[-1].centre, jump)
        jumps.append(jump)
    after[n:] = [row(form) for form in sampled.shifted]
    share = c["trigger_epsilon_squared"] / 2.0**20 if claim["trigger"] else 0.0
    more, extra = _float(checker.MORE), _float(sampled.extra)
    if claim["trigger"]:
        extra += checker.COARSE
        floor = np.sqrt((1.0 + more) * c["trigger_floor"] ** 2 + (1.0 + 1.0 / more) * extra**2)
    return places, UncertainLoop(
        a=after[:, :order],
        withheld=after[:, order],
        places=tuple(
            np.vstack([e.generators, np.zeros((order - n, e.generators.shape[1]))]) for e in places
        ),
        jumps=np.array(jumps).reshape(len(jumps), order + 1),
        sent=sent,
        share=share * (1.0 + more),
        floor=float(floor) if claim["trigger"] else extra,
        roundings=np.array([_float(form.rounding()) for form in sampled.inner]),
        roll=np.concatenate([readings_roll, np.zeros(order - n)]),
    )


def _checked(
    claim: dict[str, Any], c: Mapping[str, Any], condition: Mapping[str, Any], tick: object
) -> dict[str, Any] | None:
    """Return the claim with its proved bounds, rounded up, or None if the checker refuses it."""
    try:
        bounds = checker.proved(c, condition, claim, tick)
    except ValueError:
        return None
    return claim | {
        name: rational(float(bound.upper()) * ROUNDED_UP, BITS) for name, bound in bounds.items()
    }


def _symmetric(p: Matrix) -> list[list[str]]:
    lower = texts(p, BITS)
    return [[lower[max(i, j)][min(i, j)] for j in range(len(p))] for i in range(len(p))]


def _floats(rows: Any) -> Matrix:  # noqa: ANN401 - texts, of one or two dimensions
    if isinstance(rows[0], str):
        return np.array([float(Fraction(text)) for text in rows])
    return np.array([_floats(row) for row in rows])


def _float(value: Any) -> float:  # noqa: ANN401 - a rational of flint, or 0
    return float(Fraction(str(value)))
