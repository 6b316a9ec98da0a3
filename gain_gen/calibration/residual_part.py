"""The residuals of a bank in fixed point."""

from math import ceil

from canroll.errors import CanrollError
from firmware import calibration as fw
from firmware.monitors.residuals import (
    GAIN_BITS,
    GYRO,
    LATERAL,
    LINEAR,
    MOMENT,
    MOTION,
    OFF_STOPS,
    ON_ROAD,
    STROKE,
    SUMMED,
    WRONG_FRONT,
    WRONG_LATERAL,
    WRONG_RATE,
    WRONG_REAR,
    YAW,
)
from gain_gen.calibration.rows import quantise
from gain_gen.monitors.bank import DERIVATIVE, INTEGRAL, KINDS, SIGNALS, Bank, Part

FORMATS = (
    *(fw.Q_RATE,) * 4,
    *(fw.Q_MOMENT,) * 2,
    *(fw.Q_ACCELERATION,) * 3,
    *(fw.Q_RATE,) * 3,
)
"""Fractional bits of the inputs, in the order of ``SIGNALS``."""
NEEDS = (
    *(STROKE,) * 4,
    *(MOMENT,) * 2,
    LATERAL,
    YAW | MOTION,
    MOTION,
    GYRO,
    YAW,
    GYRO,
)
WRONG = {
    "lateral": WRONG_LATERAL,
    "rate": WRONG_RATE,
    "front": WRONG_FRONT,
    "rear": WRONG_REAR,
}
RANGES = {"linear": LINEAR, "on_road": ON_ROAD, "off_stops": OFF_STOPS}
WEIGHT_BITS = 6
Value = int | list[int] | list[list[int]]


def residual_fields(bank: Bank, period: float) -> dict[str, Value]:
    """Return the fields of the residuals; ``period`` (s) is that of a stroke rate's samples.

    Raises:
        CanrollError: a gain or floor is outside its field's range; the message names it.
    """
    ordered = sorted(bank.parts.values(), key=lambda part: KINDS.index(part.kind))
    numbers = {part.name: k for k, part in enumerate(ordered)}
    needs = {part.name: _needs(part) for part in ordered}
    return (
        _parts(ordered, bank.tick, period)
        | _residuals(bank, numbers, needs)
        | _ranges(bank, numbers)
        | _signatures(bank)
    )


def _needs(part: Part) -> int:
    bits = 0
    for signal in part.gains:
        bits |= NEEDS[SIGNALS.index(signal)]
    return bits


def _parts(ordered: list[Part], tick: float, period: float) -> dict[str, Value]:
    """Return the fields of the parts, in the order of their kinds."""
    spare = fw.N_PARTS - len(ordered)
    differentiated = sum(part.kind == DERIVATIVE for part in ordered)
    if spare < 0 or differentiated > fw.N_DERIVATIVES:
        raise CanrollError(f"{len(ordered)} parts of residuals exceed the firmware's {fw.N_PARTS}")
    rows, inputs = [], []
    for part in ordered:
        signals = [*part.gains, *part.gains][:2]
        gains = [*part.gains.values(), 0.0][:2]
        # stroke rates are integrated sample by sample, whenever they come
        summed = SUMMED if part.kind == INTEGRAL else 0
        inputs.append([summed + SIGNALS.index(signal) for signal in signals])
        factor = period if part.kind == INTEGRAL else 1.0
        rows.append(
            [
                _gain(factor * gain, FORMATS[k % SUMMED], part.name)
                for gain, k in zip(gains, inputs[-1], strict=True)
            ]
        )
    kinds = [KINDS.index(part.kind) for part in ordered]
    return {
        "part_end": [sum(kind <= k for kind in kinds) for k in range(len(KINDS))],
        "part_input": inputs + [[0, 0]] * spare,
        "part_gain": rows + [[0, 0]] * spare,
        "part_wash": [round(fw.ONE / part.memory(tick)) for part in ordered] + [0] * spare,
        "part_pass": [min(fw.ONE, round(fw.ONE * tick / part.low_pass)) for part in ordered]
        + [0] * spare,
    }


def _gain(value: float, q: int, name: str) -> int:
    """Return a gain from a signal with ``q`` fractional bits to N·m, to a thousandth of it."""
    name = f"gain of the residuals' part {name}"
    stored = quantise(
        value, GAIN_BITS + fw.Q_MOMENT - q, -fw.COEFFICIENT, fw.COEFFICIENT, name=name
    )
    if value and abs(stored) < 500:
        raise CanrollError(f"{name}: {value:.4g} is too small for its fixed-point format")
    return stored


def _residuals(bank: Bank, numbers: dict[str, int], needs: dict[str, int]) -> dict[str, Value]:
    """Return the fields of the residuals."""
    bits = _bits(bank)
    spare = fw.N_RESIDUALS - len(bank.residuals)
    terms = [term for residual in bank.residuals for term in residual.terms]
    if len(terms) > fw.N_TERMS or spare < 0:
        raise CanrollError(f"{len(terms)} terms of residuals exceed the firmware's {fw.N_TERMS}")
    empty = fw.N_TERMS - len(terms)
    ends = [
        sum(len(residual.terms) for residual in bank.residuals[: k + 1])
        for k in range(len(bank.residuals))
    ]
    of_rows = []
    for residual in bank.residuals:
        bit = sum(RANGES[name] for name in residual.ranges)
        for term in residual.terms:
            bit |= needs[term.part]
        of_rows.append(bit)
    return {
        "term_part": [numbers[term.part] for term in terms] + [0] * empty,
        "term_sign": [term.sign + 1 for term in terms] + [1] * empty,
        "term_weight": [
            quantise(
                ceil(term.weight * 2**WEIGHT_BITS) / 2**WEIGHT_BITS,
                WEIGHT_BITS,
                0,
                255,
                name=f"weight of {term.part} in a residual",
            )
            for term in terms
        ]
        + [0] * empty,
        "residual_end": ends + [len(terms)] * spare,
        "residual_needs": of_rows + [0] * spare,
        "residual_floor": [
            quantise(r.floor, fw.Q_MOMENT, 0, fw.STATE_MAX // 2, name=f"floor of {r.name}")
            for r in bank.residuals
        ]
        + [fw.STATE_MAX // 2] * spare,
        "residual_fade": [round(fw.ONE * bank.tick / r.hold) for r in bank.residuals] + [0] * spare,
        "residual_ticks": [bank.rounds(r.time) for r in bank.residuals] + [1] * spare,
        "residual_bit": [bits[r.bit] for r in bank.residuals] + [0] * spare,
    }


def _ranges(bank: Bank, numbers: dict[str, int]) -> dict[str, Value]:
    """Return the fields of the ranges in which residuals are judged."""
    ranges = bank.ranges

    def stored(value: float, q: int) -> int:
        return min(fw.STATE_MAX, round(value * 2.0**q))

    return {
        "residual_linear": stored(ranges.linear, fw.Q_ACCELERATION),
        "residual_on_road": stored(ranges.on_road, fw.Q_ACCELERATION),
        "residual_off_stops": stored(ranges.off_stops, fw.Q_ACCELERATION),
        "lean_part": numbers.get(ranges.lean, 0),
        "lean_max": stored(ranges.lean_max, fw.Q_MOMENT),
    }


def _bits(bank: Bank) -> dict[str, int]:
    names = dict.fromkeys(residual.bit for residual in bank.residuals)
    return {name: 1 << k for k, name in enumerate(names)}


def _signatures(bank: Bank) -> dict[str, Value]:
    """Return the fields of the signatures."""
    bits = _bits(bank)
    spare = fw.N_SIGNATURES - len(bank.signatures)

    def mask(names: tuple[str, ...]) -> int:
        return sum(bits[name] for name in names if name in bits)

    return {
        "signature_same": [mask(s.same) for s in bank.signatures] + [0] * spare,
        "signature_opposite": [mask(s.opposite) for s in bank.signatures] + [0] * spare,
        "signature_absent": [mask(s.absent) for s in bank.signatures] + [0] * spare,
        "signature_ticks": [max(1, ceil(s.time / bank.tick) + 1) for s in bank.signatures]
        + [1] * spare,
        "signature_wrong": [sum(WRONG[name] for name in s.wrong) for s in bank.signatures]
        + [0] * spare,
    }
