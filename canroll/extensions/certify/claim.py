"""A claim of a certificate: found in floating point, written in rationals, then checked."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import islice
from typing import Any

import numpy as np
from flint import fmpq

from canroll.extensions.certify import checker
from canroll.extensions.certify.delay_curve import POINTS, Ellipsoid, ellipsoid, lacking
from canroll.extensions.certify.level import level_points
from canroll.extensions.certify.limited import limited_points
from canroll.extensions.certify.lyapunov import SLACK, LyapunovPoint, feasible, fits
from canroll.extensions.certify.uncertain_loop import Trigger, UncertainLoop
from canroll.gain_gen.models.roll import Matrix, zero_order_hold

BITS = 45
"""Of the numbers that are found."""
CELLS = 128
"""Of the curve of a delay."""
STILL = 1e-9
"""Multiplier of a delay that does not vary, relative to that of the command's rounding."""
MOMENT, STEERING, READ = 0, 1, 2
"""Inputs of a condition besides the command: roll moment on the body (N·m), steering angle (rad),
lateral acceleration that the ECU computes from a steering angle (m/s², Q24)."""
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


@dataclass(frozen=True, slots=True)
class Reach:
    """Where a delay takes the state: an ellipsoid, without extent for one that does not vary."""

    ellipsoid: Ellipsoid
    varies: bool

    @classmethod
    def of(cls, curve: Matrix, *, varies: bool) -> "Reach":
        """Return the place of a curve, (points, n)."""
        if varies:
            return cls(ellipsoid(curve), varies=True)
        nothing = np.zeros((curve.shape[1], 1))
        return cls(Ellipsoid(curve[0], nothing, nothing.T), varies=False)


@dataclass(frozen=True, slots=True)
class Wish:
    """What a claim is about.

    Attributes:
        name: of the claim.
        delay: least and most from the sample to the force, s; exactly these rationals.
        resolution: bounds of the roundings of readings and commands, in the ECU's units.
        trigger: commands are withheld by the event trigger.
        limited: the limit of moment acts.
        disturbances: bound of each input of the condition besides the command.
    """

    name: str
    delay: tuple[float | Fraction, float | Fraction]
    resolution: Sequence[str]
    trigger: bool = False
    limited: bool = False
    disturbances: Mapping[int, float] = field(default_factory=dict)


def prove(c: Mapping[str, Any], condition: Mapping[str, Any], wish: Wish) -> dict[str, Any] | None:
    """Return a proved claim that bounds roll angle and command, or None where none is found.

    Args:
        c: integers of the controller.
        condition: of the certificate.
        wish: what is claimed.
    """
    return _first(c, condition, _claim(wish), _tried)


def _tried(loop: UncertainLoop) -> Iterable[LyapunovPoint]:
    """Return the points without saturation, those of least roll angle or level first."""
    points = limited_points(loop) if len(loop.opposed) else feasible(loop)
    return islice((point for point in points if fits(loop, point)), TRIED)


def prove_level(
    c: Mapping[str, Any], condition: Mapping[str, Any], wish: Wish
) -> dict[str, Any] | None:
    """Return a proved claim of the level from the roll moment to the roll angle, or None."""
    claim = _claim(replace(wish, disturbances={MOMENT: 0.0})) | {"performance": True}
    return _first(c, condition, claim, level_points)


def _claim(wish: Wish) -> dict[str, Any]:
    return {
        "name": wish.name,
        "delay": [str(Fraction(seconds)) for seconds in wish.delay],
        "resolution": list(wish.resolution),
        "trigger": wish.trigger,
        "limited": wish.limited,
        "performance": False,
        "slack": rational(SLACK),
        "disturbances": [
            {"input": number, "most": rational(most)} for number, most in wish.disturbances.items()
        ],
        "channels": [],
    }


def _first(
    c: Mapping[str, Any],
    condition: Mapping[str, Any],
    claim: dict[str, Any],
    points: Callable[[UncertainLoop], Iterable[LyapunovPoint]],
) -> dict[str, Any] | None:
    """Return the claim with the first of the loop's points that the checker accepts."""
    tick = fmpq(c["tick_us"], 1000000)
    sampled = checker.Sampled(c, condition, claim, tick)
    places, loop = uncertain(c, condition, claim, sampled)
    for point in points(loop):
        proved = _checked(claim | _written(point, places), c, condition, tick)
        if proved is not None:
            return proved
    return None


def _written(point: LyapunovPoint, places: Sequence[Reach]) -> dict[str, Any]:
    """Return the numbers of a point as texts."""
    delays = iter(point.delays)
    # a delay that does not vary has a place without extent: any multiplier serves
    still = STILL * float(point.inputs[0])
    return {
        **({} if point.limit is None else {"limit": texts(point.limit, BITS)}),
        "decay": rational(point.decay, BITS),
        "switching": rational(point.switching, BITS),
        "weights": texts(point.inputs, BITS),
        "p": symmetric(point.p),
        "channels": [
            {
                "weight": rational(float(next(delays)) if place.varies else still, BITS),
                "cells": CELLS if place.varies else 1,
                "centre": texts(place.ellipsoid.centre[:, None], BITS),
                "generators": texts(place.ellipsoid.generators, BITS),
                "onto": texts(place.ellipsoid.onto, BITS),
            }
            for place in places
        ],
    }


def uncertain(
    c: Mapping[str, Any],
    condition: Mapping[str, Any],
    claim: Mapping[str, Any],
    sampled: checker.Sampled,
) -> tuple[list[Reach], UncertainLoop]:
    """Return the places of the delays, and the loop in floating point."""
    flow, roll = _floats(condition["flow"]), _floats(condition["roll"])
    n, tick, order = len(flow), 1e-6 * c["tick_us"], len(sampled.states)
    a, inputs, b = flow[:, :n], flow[:, n:], flow[:, n]
    size = order + len(sampled.inputs) + sampled.limited

    def row(form: checker.Form) -> Matrix:
        return np.array([_float(form.get(name, 0)) for name in sampled.names[:size]])

    sent = row(sampled.sent)
    after = np.zeros((order, size))
    after[:n, :n], held = zero_order_hold(a, inputs, tick)
    first = size - sampled.limited - len(claim["disturbances"])
    for column, each in enumerate(claim["disturbances"], first):
        after[:n, column] = held[:, 1 + each["input"]]
    after[:n] += np.outer(lacking(a, b, tick, np.array([tick]))[0], sent)
    places, jumps = list[Reach](), []
    for ends, form in zip(sampled.ends, sampled.jumps, strict=True):
        jump = row(form)
        instants = np.linspace(_float(ends[0]), _float(ends[1]), POINTS)
        curve = lacking(a, b, tick, instants)
        places.append(Reach.of(curve, varies=ends[0] < ends[1]))
        after[:n] += np.outer(places[-1].ellipsoid.centre, jump)
        if places[-1].varies:
            jumps.append(jump)
    after[n:] = [row(form) for form in sampled.shifted]
    trigger = None
    if claim["trigger"]:
        share = _float(checker.MORE) * c["trigger_epsilon_squared"] / 2.0**20
        trigger = Trigger(sent, row(sampled.states[n]), share)
    bounds = [np.sqrt(_float(square)) for square in sampled.squares]
    bounds += [float(Fraction(each["most"])) for each in claim["disturbances"]]
    limits = {
        ("d", each["input"]): fmpq(*map(int, each["most"].split("/")))
        for each in claim["disturbances"]
    }
    varying = [place.ellipsoid.generators for place in places if place.varies]
    return places, UncertainLoop(
        a=after[:, :order],
        inputs=after[:, order:],
        bounds=np.array(bounds),
        places=tuple(np.vstack([g, np.zeros((order - n, g.shape[1]))]) for g in varying),
        jumps=np.array(jumps).reshape(len(jumps), size),
        withheld=np.zeros((0, size)),
        trigger=trigger,
        opposed=tuple((row(cut), row(by)) for cut, by in sampled.opposed),
        stored=np.array([row(form)[:order] for form in sampled.stored]) / checker.LIMIT,
        spread=np.array([_float(form.rounding(limits)) for form in sampled.stored]) / checker.LIMIT,
        roll=np.concatenate([roll, np.zeros(order - n)]),
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


def symmetric(p: Matrix) -> list[list[str]]:
    """Return a symmetric matrix of such numbers."""
    lower = texts(p, BITS)
    return [[lower[max(i, j)][min(i, j)] for j in range(len(p))] for i in range(len(p))]


def _floats(rows: Any) -> Matrix:  # noqa: ANN401 - texts, of one or two dimensions
    if isinstance(rows[0], str):
        return np.array([float(Fraction(text)) for text in rows])
    return np.array([_floats(row) for row in rows])


def _float(value: Any) -> float:  # noqa: ANN401 - a rational of flint, or 0
    return float(Fraction(str(value)))
