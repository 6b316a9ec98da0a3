"""The certificate of a calibration: data of its loop and every claim that could be proved.

Claims of each condition of the family, for every sequence of delays within bounds, a new one every
tick:

``every tick``
    the bounds are those of the task; commands are sent every tick. It alone is also claimed for
    the cars drawn from a fitted vehicle's spread.
``event trigger``
    the same with the commands that the event trigger withholds.
``n lost``
    the longest delay is longer by n ticks, so up to n commands in a row may be lost.
``limited``, ``limited with event trigger``
    the loop that runs with the limit of moment on its command, which no claim above has: from any
    state of the linear car from which no other value of the code saturates.
``steered``
    every tick with that limit, under steering and a bank of the road
    (:mod:`canroll.extensions.certify.disturbed`).
``level``, ``level with event trigger``
    of the first condition: the mean-square gain from a held roll moment to the roll angle.

Claims of the 1-DOF roll model are the papers' inequalities (``theorem``):
``level without delay``, ``level`` with every delay up to the longest and a tick, and that with the
trigger.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq

from canroll.extensions.certify import checker
from canroll.extensions.certify.claim import Wish, prove, prove_level
from canroll.extensions.certify.disturbed import LATERAL, disturbances
from canroll.extensions.certify.stored_ranges import within_ranges
from canroll.extensions.certify.subject import INTEGERS, subject
from canroll.extensions.certify.theorem import (
    LEVEL,
    TRIGGER_LEVEL,
    WITHOUT_DELAY,
    gamma_of,
    theorems,
)
from canroll.firmware.calibration import Calibration
from canroll.gain_gen.analysis.family import Member
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.laws.rate_gain import free_peak
from canroll.gain_gen.models.task import Task

ABOUT = ("delay", "resolution", "trigger", "limited", "performance", "disturbances")
"""Entries of a claim that its name decides."""
MOST_LOST = 3
"""Commands lost in a row that are tried."""
EVERY_TICK, TRIGGER, STEERED = "every tick", "event trigger", "steered"
LIMITED, LIMITED_TRIGGER = "limited", "limited with event trigger"
LOST = "{} lost"
OF_MODEL = {
    WITHOUT_DELAY: "level without delay",
    LEVEL: "level with delay",
    TRIGGER_LEVEL: "level with delay and event trigger",
}
"""Levels of the roll model by the names of its claims."""
ASSUMPTIONS = (
    "the car is linear: the tyres, springs and actuators of each condition stay in their linear "
    "range, and no limit of slew, corner or estimate acts, nor that of moment where none is named",
    "the ECU samples at its tick; the whole delay from sample to force, which may change every "
    "tick within its bounds without commands overtaking each other, lies in the command",
    "every tick has a new sample of each sensor and the delivered moment, off by half a resolution",
    "the estimates of offsets and the speed stand still; the steering changes only at ticks",
)


@dataclass(frozen=True, slots=True)
class Certificate:
    """A certificate and what it lacks.

    Attributes:
        content: of the file.
        delay: bounds from sample to force, without the sensor's low-pass, s.
        unproved: conditions in which "every tick" is not proved.
        triggered: whether every condition is proved with the event trigger; None without one.
        lost: commands in a row that may be lost in every condition.
        steered: lateral acceleration by steering, m/s², up to which with the bank no stored value
            saturates in any condition; zero where there is no such proof.
        levels: proved gains by name: those of the first condition relative to the largest without
            control, those of the roll model γ.
        note: reason why the family is the roll model alone, or empty.
        tick: s.
        draws: cars drawn from the vehicle's fit that are certified with it.
    """

    content: dict[str, Any]
    delay: tuple[float, float]
    unproved: tuple[Member, ...]
    triggered: bool | None
    lost: int
    steered: float
    levels: Mapping[str, float]
    note: str
    tick: fmpq
    draws: int

    @property
    def every_tick(self) -> bool:
        """Whether the loop is proved stable in every condition with a command every tick."""
        return not self.unproved

    @property
    def proved(self) -> bool:
        """Whether the loop that runs is: with its event trigger, if it has one."""
        return self.every_tick and self.triggered is not False

    @property
    def with_trigger(self) -> list[str]:
        """Names of the conditions that are proved with the event trigger."""
        return self._claimed(TRIGGER)

    @property
    def with_limit(self) -> list[str]:
        """Names of the conditions in which the loop that runs is, with its limit of moment."""
        return self._claimed(LIMITED if self.triggered is None else LIMITED_TRIGGER)

    def _claimed(self, name: str) -> list[str]:
        return [of for of, names in self.content["proved"].items() if name in names]

    @property
    def conditions(self) -> int:
        """Number of the conditions of each car."""
        return len(self.content["conditions"]) // (1 + self.draws)

    @property
    def ranges(self) -> tuple[str, ...]:
        """Fields of the ECU in whose declared ranges all values of all claims stay."""
        return within_ranges()

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What every claim assumes."""
        return ASSUMPTIONS

    def longest(self, condition: Mapping[str, Any], claim: Mapping[str, Any]) -> float:
        """Return the longest delay of a claim, without the sensor's low-pass, s."""
        about = checker.meant(self.content, condition, claim["name"], self.tick)
        return float(Fraction(about["delay"][1]))

    def worst(self, name: str) -> tuple[float, float]:
        """Return the largest roll angle (degrees) and moment (N·m) of the claims of a name."""
        claims = [
            claim
            for condition in self.content["conditions"]
            for claim in condition["claims"]
            if claim["name"] == name
        ]
        roll, moment = (
            max(_float(claim[key]) for claim in claims) for key in ("roll_rad", "moment_nm")
        )
        return math.degrees(roll), moment


def certify(
    task: Task, calibration: LoadedCalibration, over: Callable[..., Iterable[Any]] = map
) -> Certificate:
    """Return the certificate of a calibration on a task's vehicle and delay.

    Args:
        task: its vehicle and delay; of a fitted vehicle its draws are certified too.
        calibration: with the integers.
        over: works as ``map`` does, in parallel if it likes.

    Raises:
        CanrollError: the loop of this calibration is none that can be certified.
    """
    record = calibration.record
    family, content = subject(task, calibration)
    integers = {name: getattr(record, name) for name in INTEGERS}
    conditions, resolution = content["conditions"], content["resolution"]
    tick = Fraction(record.tick_us, 1_000_000)
    exact = [Fraction(seconds) for seconds in content["delay"]]

    def claims(
        name: str, *, lost: int = 0, trigger: bool = False, lateral: float = 0.0
    ) -> Iterator[bool]:
        limited = name in {LIMITED, LIMITED_TRIGGER, STEERED}
        most = exact[1] + lost * tick
        chosen, wishes = list[dict[str, Any]](), list[Wish]()
        for member, condition in zip(family.members, conditions, strict=True):
            if name == EVERY_TICK or not member.condition.draw:
                driven = disturbances(member, task, record, lateral) if lateral else {}
                chosen.append(condition)
                delay = exact[0], most
                wishes.append(Wish(name, delay, resolution, trigger, limited, driven))
        bare = [{**condition, "claims": []} for condition in chosen]
        proofs = over(prove, [integers] * len(bare), bare, wishes)
        for condition, claim in zip(chosen, proofs, strict=True):
            if claim is not None:
                condition["claims"].append(claim)
            yield claim is not None

    def in_all(name: str, *, lost: int = 0, lateral: float = 0.0) -> bool:
        """Add claims of a name to every condition, or to none."""
        if all(claims(name, lost=lost, lateral=lateral)):
            return True
        for condition in conditions:
            condition["claims"] = [c for c in condition["claims"] if c["name"] != name]
        return False

    proved = list(claims(EVERY_TICK))
    unproved = [member for member, fine in zip(family.members, proved, strict=True) if not fine]
    triggered, lost, steered, levels = None, 0, 0.0, dict[str, float]()
    if record.event_trigger:
        triggered = not unproved and all(list(claims(TRIGGER, trigger=True)))
    if triggered:
        list(claims(LIMITED_TRIGGER, trigger=True))
    elif triggered is None and not unproved:
        list(claims(LIMITED))
    if not unproved:
        while lost < MOST_LOST and in_all(LOST.format(lost + 1), lost=lost + 1):
            lost += 1
        proofs = (most for most in LATERAL if in_all(STEERED, lateral=most))
        steered = next(proofs, 0.0)
        wish = Wish(LEVEL, (exact[0], exact[1]), resolution)
        levels = _levels(integers, conditions[0], wish, family.members[0], record)
    if content["models"]:
        # of a sampled loop a command acts until the next one
        model = theorems(integers, task.vehicle.design, exact[1] + exact[2] + tick)
        content["models"] = [model]
        levels |= {OF_MODEL[claim["name"]]: gamma_of(claim) for claim in model["claims"]}
    state(content)
    return Certificate(
        content,
        (float(exact[0]), float(exact[1])),
        tuple(unproved),
        triggered,
        lost,
        steered,
        levels,
        family.note,
        fmpq(record.tick_us, 1_000_000),
        max(member.condition.draw for member in family.members),
    )


def state(content: dict[str, Any]) -> None:
    """Move what a claim is about from it to the certificate, and state all claims and the digest.

    What a claim is about follows from its name (:func:`canroll.extensions.certify.checker.meant`).
    """
    every = content["conditions"] + content["models"]
    for of in every:
        for claim in of["claims"]:
            if claim["name"] == STEERED:
                of["driven"] = claim["disturbances"]
        of["claims"] = [
            {key: value for key, value in claim.items() if key not in ABOUT}
            for claim in of["claims"]
        ]
    content["proved"] = {of["name"]: [claim["name"] for claim in of["claims"]] for of in every}
    content["sha256"] = checker.digest(content)


def _levels(
    integers: Mapping[str, Any],
    condition: dict[str, Any],
    wish: Wish,
    member: Member,
    record: Calibration,
) -> dict[str, float]:
    """Add the level claims to the condition; return their gains."""
    wishes = [wish]
    if record.event_trigger:
        wishes.append(replace(wish, name=TRIGGER_LEVEL, trigger=True))
    levels = {}
    for each in wishes:
        claim = prove_level(integers, condition, each)
        if claim is not None:
            condition["claims"].append(claim)
            levels[each.name] = math.sqrt(_float(claim["weights"][-1])) / free_peak(member)
    return levels


def _float(text: str) -> float:
    above, _, below = text.partition("/")
    return float(np.nextafter(int(above) / int(below or 1), math.inf))
