"""The papers' inequalities on the roll model at the stored gain: solved, rounded, then checked.

A sampled command acts until the next one: their delay is up to the longest one and a tick.
All are one inequality: with P = X⁻¹ and Y = r⁻¹ the delay theorem of Redondo 2021, (44)–(45), is
that of Viadero 2022 without its trigger, and without a delay it is (52). The checker takes γ²
from the certificate, so it is a proved number for the integers as stored.
"""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq

from canroll.extensions.certify import checker
from canroll.extensions.certify.claim import BITS, rational, symmetric, texts
from canroll.firmware.calibration import OUTPUT_FEEDBACK, Q_MOMENT, Q_RATE, Calibration
from canroll.gain_gen.laws.lmi import Clock, EventPoint, event_point
from canroll.gain_gen.laws.roll_rate_feedback import normalised_plant
from canroll.gain_gen.models.roll import (
    PERFORMANCE,
    NormalisedPlant,
    disturbance_input,
    moment_input,
    normalise,
    state_matrix,
)
from canroll.vehicles import RollModel

RAISED = (1e-5, 1e-4, 1e-3)
"""Shares by which the solver's γ² is raised, so that the inequality holds strictly."""
WITHOUT_DELAY, LEVEL = "level without delay", "level"
TRIGGER_LEVEL = "level with event trigger"
SHORT = 1e-3
"""Delay, relative to the inverse of the roll frequency, at which "no delay" is solved."""


def applies(record: Calibration) -> bool:
    """Whether the law is a gain on the roll rate, of which the inequalities are."""
    return bool(
        record.law == OUTPUT_FEEDBACK and record.output_gain[0] and not any(record.output_gain[1:])
    )


def roll_model(model: RollModel) -> dict[str, Any]:
    """Return the roll model's data, as yet without claims."""
    flow = np.hstack([state_matrix(model), moment_input(model), disturbance_input(model)])
    return {
        "name": checker.MODEL,
        "flow": texts(flow),
        "performance": texts(PERFORMANCE[0]),
        "claims": [],
    }


def theorems(integers: Mapping[str, Any], model: RollModel, delay: Fraction) -> dict[str, Any]:
    """Return the roll model with a claim of each inequality that holds.

    Args:
        integers: of the controller, :func:`applies`.
        model: design model of the vehicle.
        delay: longest one from motion to force, with the tick that a command acts, s.
    """
    plant, content = normalise(model), roll_model(model)
    wanted = [(WITHOUT_DELAY, Fraction(0), False), (LEVEL, delay, False)]
    if integers["event_trigger"]:
        wanted.append((TRIGGER_LEVEL, delay, True))
    for name, seconds, trigger in wanted:
        of = {"trigger": trigger, "performance": True, "delay": [str(seconds), str(seconds)]}
        claim = _claim(plant, integers, content, {"name": name, **of})
        if claim is not None:
            content["claims"].append(claim)
    return content


def _claim(
    plant: NormalisedPlant,
    integers: Mapping[str, Any],
    model: Mapping[str, Any],
    wish: dict[str, Any],
) -> dict[str, Any] | None:
    """Return the claim of a wish with the numbers of the solver's point, or None."""
    seconds = float(Fraction(wish["delay"][1]))
    unit = 2.0 ** (Q_RATE - Q_MOMENT - integers["output_gain_shift"])
    gain = integers["output_gain"][0] * unit * plant.frequency / plant.stiffness
    share = integers["trigger_epsilon_squared"] / 2.0**20 if wish["trigger"] else 0.0
    delay = plant.delay(seconds) or SHORT
    point = event_point(normalised_plant(plant), gain, delay, share, Clock())
    if point is None:
        return None
    tick = fmpq(integers["tick_us"], 1000000)
    for raised in RAISED:
        claim = {
            **wish,
            **_written(point, plant, delay=0.0 if seconds else delay),
            "gamma_squared": rational(point.gamma_squared * (1.0 + raised), BITS),
        }
        try:
            checker.theorem(integers, model, claim, tick)
        except ValueError:
            continue
        return claim
    return None


def _written(point: EventPoint, plant: NormalisedPlant, *, delay: float) -> dict[str, Any]:
    """Return the point in SI units as texts; r over a ``delay`` that the claim leaves out."""
    units = np.diag([1.0, 1.0 / plant.frequency])
    moments = plant.frequency * plant.stiffness**2
    r = point.r / moments
    return {
        "p": symmetric(units @ point.p @ units / plant.frequency),
        # without a delay r stands for r over the delay, both in normalised time
        "r": rational(r * plant.frequency / delay if delay else r, BITS),
        "omega": rational(point.omega / plant.stiffness**2, BITS),
    }


def gamma_of(claim: Mapping[str, Any]) -> float:
    """Return the proved level γ of a claim."""
    return float(np.sqrt(float(Fraction(claim["gamma_squared"]))))
