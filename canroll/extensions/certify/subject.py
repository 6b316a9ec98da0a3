"""What a certificate is about: the loop of a calibration on a vehicle and its bus, as rationals."""

import hashlib
import math
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from canroll import firmware
from canroll.errors import CanrollError
from canroll.extensions.certify import checker
from canroll.extensions.certify.claim import texts
from canroll.extensions.certify.theorem import applies, roll_model
from canroll.firmware import calibration as fw
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import RX_ACTUATOR_STATE
from canroll.gain_gen.analysis.family import NOMINAL, Family, Member, family_of
from canroll.gain_gen.analysis.fitted_family import with_draws
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration
from canroll.gain_gen.models.task import Resolution, Task
from canroll.vehicles import Vehicle
from canroll.vehicles.axles import axles
from canroll.vehicles.draws.fitted_cars import draws

INTEGERS = (
    *("tick_us", "law", "actuator", "observer", "measurements", "identification", "event_trigger"),
    *("timeout_ticks", "phi", "phi_shift", "gamma", "gamma_steering"),
    *("output", "output_moment", "output_shift", "correction", "correction_shift"),
    *("feedback", "feedback_shift", "feedforward", "feedforward_shift"),
    *("output_gain", "output_gain_shift"),
    *("compensator_order", "compensator_outputs", "compensator_shift", "compensator_output_shift"),
    *("compensator_a", "compensator_b", "compensator_e", "compensator_c", "compensator_d"),
    *("schedule_points", "schedule_speed", "schedule_gain", "fade_low", "fade_high"),
    *("predict_steps", "actuator_rate", "trigger_epsilon_squared", "trigger_floor"),
    "moment_max",
)
"""Fields of the calibration that decide the loop, all of which the checker reads."""
MODELLED = ("control_law", "event_trigger", "fixed_point", "observer", "schedule")
"""Modules of the firmware that the checker repeats in rationals."""
READINGS = np.exp2([fw.Q_RATE, fw.Q_ACCELERATION, fw.Q_MOMENT])
"""Units of the readings in the ECU."""
SCALING = 1e-3
"""Relative allowance for the fixed-point factors between raw signals and the ECU's units."""


def subject(task: Task, calibration: LoadedCalibration) -> tuple[Family, dict[str, Any]]:
    """Return the family of a task and the contents of its certificate, as yet without claims.

    Raises:
        CanrollError: the loop of this calibration is none that can be certified.
    """
    record = calibration.record
    _refuse_other(record, calibration, task.vehicle)
    family = with_draws(family_of(task), task)
    filtered = family.members[0].filtered
    delays = (max(seconds - filtered, 0.0) for seconds in (task.delay.least, task.delay.most))
    cars = [task.vehicle, *(draws(task.vehicle) if task.vehicle.fit else ())]
    each = zip(*(resolutions(car, record, task.resolution) for car in cars), strict=True)
    content: dict[str, Any] = {
        "format": checker.FORMAT,
        "source": _source(task, calibration),
        "delay": [str(Fraction(seconds)) for seconds in (*delays, filtered)],
        "resolution": [str(max(map(int, halves))) for halves in each],
        "conditions": [condition_of(member) for member in family.members],
        "models": [roll_model(task.vehicle.design)] if applies(record) else [],
    }
    return family, content


def _refuse_other(record: Calibration, calibration: LoadedCalibration, vehicle: Vehicle) -> None:
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
    elif record.actuator == fw.SUSPENSION and not _of_tracks(record, vehicle):
        reason = f"its forces are for other tracks than those of {vehicle.reference}; design for it"
    if reason:
        raise CanrollError(f"{calibration.path}: cannot be certified: {reason}")


def _of_tracks(record: Calibration, vehicle: Vehicle) -> bool:
    """Whether the forces that the ECU computes of a moment make that moment on a vehicle."""
    arms = zip((record.arm_front, record.arm_rear), axles(vehicle), strict=True)
    return all(abs(arm / 2**28 * 2.0 * axle.half_track - 1.0) < SCALING for arm, axle in arms)


def condition_of(member: Member) -> dict[str, Any]:
    """Return the data of a condition, as yet without claims; a roll model counts as at 80 km/h."""
    plant, condition = member.plant, member.condition
    # the reading of the steering reaches the controller alone
    steering = plant.steering, np.zeros_like(plant.steering)
    command = plant.command / (1 << fw.Q_MOMENT)
    speed = condition.speed or NOMINAL.speed
    return {
        "name": str(condition) if condition.speed else f"{condition}, {3.6 * speed:.0f} km/h",
        "speed": round(speed * (1 << fw.Q_SPEED)),
        "flow": texts(np.hstack([plant.a, command, plant.disturbance, *steering])),
        "readings": texts(plant.measured[[0, 1, 3]] * READINGS[:, None]),
        "roll": texts(member.roll),
        "claims": [],
    }


def resolutions(vehicle: Vehicle, record: Calibration, steps: Resolution | None) -> list[str]:
    """Return half a resolution of roll rate, a_y, delivered moment, past and new command.

    In the ECU's units, with the rounding to them.

    Raises:
        CanrollError: the steps are not known, or the bus lacks what the loop requires.
    """
    if steps is None:
        raise CanrollError(
            "the calibration does not have the resolutions of its bus: create it again with "
            "'canroll design', or give --bus"
        )
    command = "bar" if record.actuator == fw.BARS else "force"
    required = {
        "roll_rate": record.measurements & 1,
        "lateral_acceleration": record.measurements & 2,
        "delivered": record.timeout_ticks[RX_ACTUATOR_STATE],
        command: 1,
    }
    lacking = [name for name, needed in required.items() if needed and not getattr(steps, name)]
    if lacking:
        raise CanrollError(f"no signal of its bus is mapped to {lacking[0]}: map one")
    tracks = vehicle.geometry.half_track_front + vehicle.geometry.half_track_rear
    moment = 2.0 * (steps.bar if command == "bar" else steps.force * tracks)
    wide = (
        steps.roll_rate * (1 << fw.Q_RATE),
        steps.lateral_acceleration * (1 << fw.Q_ACCELERATION),
        *(of * (1 << fw.Q_MOMENT) for of in (2.0 * steps.delivered, moment, moment)),
    )
    # the split over axles and corners rounds a few times more
    return [str(math.ceil(0.5 * (1.0 + SCALING) * step) + 4) for step in wide]


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
