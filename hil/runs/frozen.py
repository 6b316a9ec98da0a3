"""The controller of a run: designed on the spot, or read from a calibration file."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import vehicles
from canroll.errors import CanrollError, UnknownNameError
from firmware import calibration as fw
from firmware.calibration import Calibration
from gain_gen.calibration.calibration_file import LoadedCalibration, load
from gain_gen.calibration.freeze import calibrate
from gain_gen.calibration.quantise import ACTUATOR_NUMBER, Options, law_kind
from gain_gen.design import design
from gain_gen.laws import LAWS, OBSERVERS
from gain_gen.models.task import Delay, Design, Task
from plant_sim.can_bus import BusProfile, load_profile
from plant_sim.can_bus.delay_bounds import delay_bounds
from plant_sim.nodes.sensors import SensorOptions, delay
from vehicles import Vehicle

COMMANDS = {
    fw.SUSPENSION: "SuspensionForceCommand",
    fw.BARS: "AntiRollBarCommand",
    fw.DAMPERS: "DamperCommand",
    fw.VALVES: "ValveCommand",
}
"""Message that a calibration's actuator is commanded by."""
RECENT: deque[tuple[str, Task, Design]] = deque(maxlen=32)
"""Designs of this process: a sweep asks for the same one at every speed."""
PASSIVE = "passive"
DEFAULT_VEHICLE = "van_real"
DEFAULT_LAW = "lqg_delay"
DESIGNED = (
    *("vehicle", "law", "actuator", "observer", "tick_ms", "trigger"),
    *("gains", "feedforward", "identification", "heartbeat_ms"),
)
"""What a calibration fixes."""
COMMAND_TIMEOUT = 0.160
"""Age at which actuators let go of a command, s."""
GAINS = ("computed", "as_printed")
TRIGGERS = {"event": True, "every": False}
LAW_OF_PASSIVE = "lqr"
"""Without control the frames go on all the same, so some law must fill them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What controller is asked for; None: the default, or what the calibration says.

    Attributes:
        vehicle: name or TOML file.
        law: name, or "passive".
        calibration: file of ``canroll design``; excludes all the others.
        actuator: "suspension", "bars", "dampers" or "valves".
        observer: "two_sensors", "one_sensor", "propagated" or "reference".
        tick_ms: period of the loop.
        trigger: "event" or "every".
        gains: "computed" or "as_printed": the numbers of the law's paper, verified or not.
        feedforward: whether the disturbance feedforward is on; it is.
        identification: whether roll stiffness and damping are identified; they are not.
        heartbeat_ms: a command at the latest after; 50.
    """

    vehicle: str | None = None
    law: str | None = None
    calibration: str | Path | None = None
    actuator: str | None = None
    observer: str | None = None
    tick_ms: float | None = None
    trigger: str | None = None
    gains: str | None = None
    feedforward: bool | None = None
    identification: bool | None = None
    heartbeat_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Controller:
    """A calibration and what it is for; ``warnings`` concern the bus it was asked for."""

    vehicle: Vehicle
    law: str
    actuator: str
    observer: str
    trigger: str
    tick: float
    record: Calibration
    tables: Mapping[str, Any]
    warnings: tuple[str, ...]

    @property
    def command(self) -> str:
        """Message that commands the actuators."""
        return COMMANDS[self.record.actuator]


def choose(what: str, name: str, known: Mapping[str, Any] | tuple[str, ...]) -> str:
    """Return ``name`` if it is known; the error suggests the nearest."""
    if name not in known:
        raise UnknownNameError(what, name, known)
    return name


def prepare(request: Request, *, bus: str) -> Controller:
    """Return the controller that was asked for.

    Raises:
        CanrollError: unknown names, contradicting requests, an unreadable calibration.
        VerdictError: a design that fails its own checks.
    """
    if request.calibration is None:
        return _designed(request, bus)
    given = [
        name
        for name in DESIGNED
        if getattr(request, name) is not None and (name, request.law) != ("law", PASSIVE)
    ]
    if given:
        option = given[0].removesuffix("_ms")
        raise CanrollError(f"--calibration fixes the {option}: leave --{option} out")
    return _loaded(load(request.calibration), request, bus)


def _designed(request: Request, bus: str) -> Controller:
    law = request.law or DEFAULT_LAW
    choose("law", law, {**LAWS, PASSIVE: None})
    vehicle = vehicles.load(request.vehicle or DEFAULT_VEHICLE)
    actuator = choose("actuator", request.actuator or "suspension", ACTUATOR_NUMBER)
    observer = choose("observer", request.observer or "two_sensors", OBSERVERS)
    trigger = choose("trigger", request.trigger or "event", TRIGGERS)
    tick = 1e-3 * (request.tick_ms if request.tick_ms is not None else 10.0)
    if not 0.001 <= tick <= 0.020 or round(tick * 1e9) % 1000:
        raise CanrollError(f"--tick {1e3 * tick:g}: must be 1 to 20 ms, in whole µs")
    task = Task(
        vehicle=vehicle,
        delay=sample_to_force(
            vehicle, COMMANDS[ACTUATOR_NUMBER[actuator]], load_profile(bus), tick=tick
        ),
        tick=tick,
        actuator=actuator,
        observer=observer,
        gains=choose("kind of gains", request.gains or "computed", GAINS),
        feedforward=request.feedforward is not False,
    )
    heartbeat = 1e-3 * (request.heartbeat_ms or Options().heartbeat * 1e3)
    if not tick <= heartbeat < COMMAND_TIMEOUT:
        raise CanrollError(
            f"--heartbeat {1e3 * heartbeat:g}: it must be at least the tick and below the "
            f"{1e3 * COMMAND_TIMEOUT:g} ms after which actuators release"
        )
    options = Options(
        event_trigger=TRIGGERS[trigger],
        identification=bool(request.identification),
        heartbeat=heartbeat,
    )
    answer = _design(LAW_OF_PASSIVE if law == PASSIVE else law, task)
    if actuator == "valves" and law_kind(answer) != "dynamic":
        # a moment law drives the bars' own torque loop, for a current is the rate of a moment
        answer = replace(answer, task=replace(task, actuator="bars"))
    record, tables = calibrate(answer, options)
    warnings = () if law == PASSIVE else answer.warnings
    return Controller(
        vehicle, law, actuator, observer, trigger, tick, record, tables, tuple(warnings)
    )


def _design(law: str, task: Task) -> Design:
    """Return the verified design, that of an equal task where one was made before."""
    for known_law, known_task, answer in RECENT:
        if (known_law, known_task) == (law, task):
            return answer
    answer = design(law, task)
    RECENT.append((law, task, answer))
    return answer


def _loaded(calibration: LoadedCalibration, request: Request, bus: str) -> Controller:
    vehicle = vehicles.load(calibration.vehicle)
    command = COMMANDS[calibration.record.actuator]
    delay = sample_to_force(vehicle, command, load_profile(bus), tick=calibration.tick)
    warnings = [line for line in calibration.warnings if "expect a limit cycle" not in line]
    beyond = calibration.delay_warning(delay.most)
    return Controller(
        vehicle=vehicle,
        law=request.law or calibration.law,
        actuator=calibration.actuator,
        observer=str(calibration.tables["design"].get("observer", "")),
        trigger="event" if calibration.record.event_trigger else "every",
        tick=calibration.tick,
        record=calibration.record,
        tables=calibration.tables,
        warnings=(*warnings, *([beyond] if beyond else [])),
    )


RUN_TIME = 200e-6
"""From the start of a tick to its frames in the controller's queue, s: the loop takes 10 k to 20 k
instructions on a Cortex-M0, which is less at 100 MHz."""


def sample_to_force(
    vehicle: Vehicle, command: str, profile: BusProfile, *, tick: float = 0.010
) -> Delay:
    """Return the bounds of the delay on this bus, and their middle.

    The low-pass of the roll-rate sensor and its latency are in it; the hold of the command over
    the next tick is not, for the sampled design model has it already.

    Args:
        vehicle: its sensors.
        command: message that commands the actuators.
        profile: the bus.
        tick: period of the loop, s.

    Raises:
        VerdictError: the bus is so loaded that there is no bound.
    """
    bounds = delay_bounds(profile, tick_ms=1e3 * tick, command=command, run_time_s=RUN_TIME)
    sensor = delay(vehicle.sensors.roll_rate, options=SensorOptions())
    least, most = sensor + bounds.age_min, sensor + bounds.age_max
    return Delay((least + most) / 2, least, most)
