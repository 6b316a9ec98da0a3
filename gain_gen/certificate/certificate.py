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
``steered``
    every tick, under steering and a bank of the road (:mod:`gain_gen.certificate.disturbed`).
``level``, ``level with event trigger``
    of the first condition: the mean-square gain from a held roll moment to the roll angle.

Claims of the 1-DOF roll model are the papers' inequalities (:mod:`gain_gen.certificate.theorem`):
``level without delay``, ``level`` with every delay up to the longest, and that with the trigger.
"""

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from flint import fmpq

import dbc
import firmware
from canroll.errors import CanrollError
from firmware import calibration as fw
from firmware.calibration import Calibration
from firmware.schedule import schedule
from firmware.state import RX_VEHICLE_MOTION, Ecu
from gain_gen.analysis.family import Member, family_of
from gain_gen.analysis.fitted_family import with_draws
from gain_gen.calibration.calibration_file import LoadedCalibration
from gain_gen.certificate import checker
from gain_gen.certificate.claim import Wish, prove, prove_level, texts
from gain_gen.certificate.disturbed import LATERAL, disturbances
from gain_gen.certificate.stored_ranges import within_ranges
from gain_gen.certificate.theorem import (
    LEVEL,
    TRIGGER_LEVEL,
    WITHOUT_DELAY,
    applies,
    gamma_of,
    theorems,
)
from gain_gen.laws.rate_gain import free_peak
from gain_gen.models.task import Task
from vehicles import Vehicle
from vehicles.draws.fitted_cars import draws

INTEGERS = (
    *("tick_us", "law", "measurements", "phi", "phi_shift", "gamma", "gamma_steering"),
    *("output", "output_moment", "output_shift", "correction", "correction_shift"),
    *("feedback", "feedback_shift", "feedforward", "feedforward_shift"),
    *("output_gain", "output_gain_shift"),
    *("compensator_order", "compensator_outputs", "compensator_shift", "compensator_output_shift"),
    *("compensator_a", "compensator_b", "compensator_e", "compensator_c", "compensator_d"),
    *("predict_steps", "actuator_rate", "trigger_epsilon_squared", "trigger_floor"),
)
"""Fields of the calibration that decide the loop."""
MODELLED = ("control_law", "event_trigger", "fixed_point", "observer", "schedule")
"""Modules of the firmware that the checker repeats in rationals."""
ABOUT = ("delay", "resolution", "trigger", "performance", "disturbances")
"""Entries of a claim that its name decides."""
MOST_LOST = 3
"""Commands lost in a row that are tried."""
READINGS = np.exp2([fw.Q_RATE, fw.Q_ACCELERATION, fw.Q_MOMENT])
"""Units of the readings in the ECU."""
SCALING = 1e-3
"""Relative allowance for the fixed-point factors between raw signals and the ECU's units."""
EVERY_TICK, TRIGGER, STEERED = "every tick", "event trigger", "steered"
LOST = "{} lost"
OF_MODEL = {
    WITHOUT_DELAY: "level without delay",
    LEVEL: "level with delay",
    TRIGGER_LEVEL: "level with delay and event trigger",
}
"""Levels of the roll model by the names of its claims."""
ASSUMPTIONS = (
    "the car is linear: the tyres, springs and actuators of each condition stay in their linear "
    "range, and no limit of moment, slew, corner or estimate acts",
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
    def proved(self) -> bool:
        """Whether the loop is proved stable in every condition."""
        return not self.unproved

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
    refuse_other(record, calibration)
    family = with_draws(family_of(task), task)
    integers = {name: getattr(record, name) for name in INTEGERS}
    filtered = family.members[0].filtered
    delay = (max(task.delay.least - filtered, 0.0), max(task.delay.most - filtered, 0.0))
    conditions = [condition_of(member, record) for member in family.members]
    cars = [task.vehicle, *(draws(task.vehicle) if task.vehicle.fit else ())]
    each = zip(*(resolutions(car, record) for car in cars), strict=True)
    resolution = [str(max(map(int, halves))) for halves in each]
    tick = fmpq(record.tick_us, 1_000_000)
    exact = [Fraction(seconds) for seconds in (*delay, filtered)]
    content: dict[str, Any] = {
        "format": checker.FORMAT,
        "source": _source(task, calibration),
        "delay": [str(seconds) for seconds in exact],
        "resolution": resolution,
        "conditions": conditions,
        "models": [],
    }

    def claims(
        name: str, *, lost: int = 0, trigger: bool = False, lateral: float = 0.0
    ) -> Iterator[bool]:
        most = exact[1] + lost * Fraction(record.tick_us, 1_000_000)
        chosen, wishes = list[dict[str, Any]](), list[Wish]()
        for member, condition in zip(family.members, conditions, strict=True):
            if name == EVERY_TICK or not member.condition.draw:
                driven = disturbances(member, task.vehicle, lateral) if lateral else {}
                chosen.append(condition)
                wishes.append(Wish(name, (exact[0], most), resolution, trigger, driven))
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
    if not unproved:
        while lost < MOST_LOST and in_all(LOST.format(lost + 1), lost=lost + 1):
            lost += 1
        proofs = (most for most in LATERAL if in_all(STEERED, lateral=most))
        steered = next(proofs, 0.0)
        wish = Wish(LEVEL, (exact[0], exact[1]), resolution)
        levels = _levels(integers, conditions[0], wish, family.members[0], record)
    if applies(record):
        model = theorems(integers, task.vehicle.design, exact[1] + exact[2])
        content["models"].append(model)
        levels |= {OF_MODEL[claim["name"]]: gamma_of(claim) for claim in model["claims"]}
    state(content)
    return Certificate(
        content,
        delay,
        tuple(unproved),
        triggered,
        lost,
        steered,
        levels,
        family.note,
        tick,
        max(member.condition.draw for member in family.members),
    )


def state(content: dict[str, Any]) -> None:
    """Move what a claim is about from it to the certificate, and state all claims and the digest.

    What a claim is about follows from its name (:func:`gain_gen.certificate.checker.meant`).
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


def refuse_other(record: Calibration, calibration: LoadedCalibration) -> None:
    """Raise CanrollError for a loop that is not linear with constant coefficients."""
    reason = ""
    if calibration.stage is not None:
        reason = f"its own stage {calibration.stage.name} is no linear part of the loop"
    elif record.observer == fw.PROPAGATED_COVARIANCE:
        reason = "the gains of its observer change at run time; design with --observer two_sensors"
    elif record.observer == fw.BYPASS:
        reason = "it reads the true state, which no sensor measures; choose another --observer"
    elif record.identification:
        reason = "its model is identified at run time; design without --identification"
    elif record.actuator >= fw.DAMPERS:
        reason = "the commands of dampers and valves are no moments; choose another --actuator"
    if reason:
        raise CanrollError(f"{calibration.path}: cannot be certified: {reason}")


def condition_of(member: Member, record: Calibration) -> dict[str, Any]:
    """Return the data of a condition, as yet without claims."""
    plant = member.plant
    # the reading of the steering reaches the controller alone
    steering = plant.steering, np.zeros_like(plant.steering)
    command = plant.command / (1 << fw.Q_MOMENT)
    return {
        "name": str(member.condition),
        "gain_factor": gain_factor(record, member.condition.speed),
        "flow": texts(np.hstack([plant.a, command, plant.disturbance, *steering])),
        "readings": texts(plant.measured[[0, 1, 3]] * READINGS[:, None]),
        "roll": texts(member.roll),
        "claims": [],
    }


def gain_factor(record: Calibration, speed: float) -> int:
    """Return the factor of the ECU's schedule (Q28) at a speed, m/s; of a roll model that of 80."""
    ecu = Ecu()
    ecu.speed = round((speed or 80 / 3.6) * (1 << fw.Q_SPEED))
    ecu.fresh[RX_VEHICLE_MOTION] = 1
    schedule(ecu, record)
    return ecu.gain_factor


def resolutions(vehicle: Vehicle, record: Calibration) -> list[str]:
    """Return half a resolution of roll rate, a_y, delivered moment, past and new command.

    In the ECU's units, with the rounding to them; the signals are those of ``roll_control.dbc``.
    """
    imu, state = dbc.message("Imu"), dbc.message("ActuatorState")

    def step(message: Any, name: str) -> float:  # noqa: ANN401 - of cantools
        return (1.0 + SCALING) * float(message.get_signal_by_name(name).scale)

    if record.actuator == fw.BARS:
        bars = dbc.message("AntiRollBarCommand")
        command = step(bars, "TorqueFront") + step(bars, "TorqueRear")
    else:
        force = step(dbc.message("SuspensionForceCommand"), "ForceFrontLeft")
        geometry = vehicle.geometry
        command = 2.0 * force * (geometry.half_track_front + geometry.half_track_rear)
    delivered = step(state, "DeliveredMomentFront") + step(state, "DeliveredMomentRear")
    halves = (
        math.radians(0.5 * step(imu, "RollRate")) * (1 << fw.Q_RATE),
        0.5 * step(imu, "LateralAcceleration") * (1 << fw.Q_ACCELERATION),
        *(0.5 * moment * (1 << fw.Q_MOMENT) for moment in (delivered, command, command)),
    )
    # the split over axles and corners rounds a few times more
    return [str(math.ceil(half) + 4) for half in halves]


def _source(task: Task, calibration: LoadedCalibration) -> Mapping[str, Any]:
    code = hashlib.sha256()
    for name in MODELLED:
        code.update((Path(firmware.__file__).parent / f"{name}.py").read_bytes())
    return {
        "law": calibration.law,
        "calibration_sha256": hashlib.sha256(calibration.path.read_bytes()).hexdigest(),
        "vehicle": task.vehicle.reference,
        "vehicle_sha256": task.vehicle.fingerprint,
        "actuator": task.actuator,
        "firmware_sha256": code.hexdigest(),
    }


def _float(text: str) -> float:
    above, _, below = text.partition("/")
    return float(np.nextafter(int(above) / int(below or 1), math.inf))
