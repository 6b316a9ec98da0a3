"""The controller of a run, designed or read from a calibration file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from canroll import dbc, vehicles
from canroll.build_cache import kept, key, recalled
from canroll.codegen.generated import own_stage
from canroll.codegen.generated.mailbox import SAMPLE_COUNTERS
from canroll.codegen.generated.own_stage import OwnStage
from canroll.errors import CanrollError, VerdictError
from canroll.firmware import calibration as fw
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_IMU, RX_SUSPENSION_RATE
from canroll.gain_gen.calibration.calibration_file import LoadedCalibration, load
from canroll.gain_gen.calibration.options import ACTUATOR_NUMBER, QuantiseOptions
from canroll.gain_gen.laws import LAWS, WITHOUT_ROLL_RATE, is_of_user
from canroll.gain_gen.models.task import PERIODS, Delay, Design, Task, made_of
from canroll.gain_gen.monitors.uncertainty import BY_STEERING, EVERY, of_vehicle, stated
from canroll.plant_sim.can_bus.network.own_frames import bus_map
from canroll.setup.bus_frames import absent, profile_of, stage_of
from canroll.setup.choice import StateSpace
from canroll.setup.choices import CHOICES, PASSIVE, check, chosen
from canroll.setup.delay import sample_to_force
from canroll.vehicles import Vehicle

COMMANDS = {
    fw.SUSPENSION: "SuspensionForceCommand",
    fw.BARS: "AntiRollBarCommand",
    fw.DAMPERS: "DamperCommand",
    fw.VALVES: "ValveCommand",
}
"""Message that a calibration's actuator is commanded by."""
COMMAND_TIMEOUT = 0.160
"""Age at which actuators release a command, s."""
COUNTS = 15
"""Largest value of the sample counters that the firmware can follow over lost frames."""


@dataclass(frozen=True, slots=True)
class Controller:
    """A calibration with its vehicle and law; ``warnings`` refer to the chosen bus."""

    vehicle: Vehicle
    law: str
    actuator: str
    record: Calibration
    tables: Mapping[str, Any]
    warnings: tuple[str, ...]

    @property
    def observer(self) -> str:
        """The roll observer; "" in the files of a user without one."""
        return str(self.tables["design"].get("observer", ""))

    @property
    def tick(self) -> float:
        """Period of the loop, s."""
        return float(self.tables["design"]["tick_s"])

    @property
    def stage(self) -> OwnStage | None:
        """The own stage of the loop."""
        return own_stage.carried(self.tables)

    @property
    def command(self) -> str:
        """Message that commands the actuators."""
        return COMMANDS[self.record.actuator]

    def front_share(self, speed: float) -> float:
        """Return the front axle's share of the moment at ``speed`` (m/s)."""
        record = self.record
        points = slice(record.schedule_points)
        share = np.interp(
            speed,
            np.array(record.schedule_speed[points]) / (1 << fw.Q_SPEED),
            np.array(record.schedule_front_share[points]) / (1 << fw.Q_UNIT),
        )
        return float(share)

    def exportable(self, *, unverified: bool) -> bool:
        """Return whether every check of the design held.

        Raises:
            VerdictError: one did not, and ``unverified`` does not ask for it anyway.
        """
        verified = bool(self.tables["design"]["verified"])
        if not verified and not unverified:
            raise VerdictError(
                f"{self.law} for {self.vehicle.name} is not verified: see 'canroll margins', or "
                "export it anyway with --unverified"
            )
        return verified


def prepare(choices: Mapping[str, Any]) -> Controller:
    """Return the controller for ``choices`` (:class:`canroll.setup.choices.Choices`).

    Raises:
        CanrollError: unknown names, contradicting choices, an unreadable calibration.
        VerdictError: the design fails its own checks.
    """
    check(choices)
    path = choices.get("calibration")
    loaded = None if path is None else load(path)
    stage = stage_of({} if loaded is None else loaded.tables, choices)
    controller = _designed(choices) if loaded is None else _loaded(loaded, choices)
    return replace(controller, tables=own_stage.added(controller.tables, stage))


def task_of(choices: Mapping[str, Any], delay: Delay | None = None) -> Task:
    """Return the design task for ``choices``, with ``delay`` or that of their bus.

    Raises:
        CanrollError: an unknown vehicle, or an invalid tick.
    """
    vehicle = vehicles.load(chosen(choices, "vehicle"))
    actuator = chosen(choices, "actuator")
    tick = 1e-3 * chosen(choices, "tick_ms")
    if round(tick * 1e9) % 1000:
        raise CanrollError(f"tick {1e3 * tick:g} ms: must be 1 to 20 ms, in whole µs")
    profile = profile_of(choices)
    if delay is None:
        command = COMMANDS[ACTUATOR_NUMBER[actuator]]
        delay = sample_to_force(vehicle, command, profile, tick=tick)
    resolution, periods = None, PERIODS
    own = bus_map(profile)
    if own is not None:
        from canroll.gain_gen.calibration.resolution import of_bus  # noqa: PLC0415

        resolution = of_bus(own)
        first = zip(own.received[: len(PERIODS)], PERIODS, strict=True)
        periods = tuple(1e-3 * box.cycle_ms or usual for box, usual in first)
    return Task(
        vehicle=vehicle,
        delay=delay,
        tick=tick,
        actuator=actuator,
        observer=chosen(choices, "observer"),
        gains=chosen(choices, "gains"),
        feedforward=chosen(choices, "feedforward"),
        moment_share=choices.get("moment_share"),
        matrices=_matrices_of(choices.get("matrices"), tick),
        unverified=chosen(choices, "unverified"),
        resolution=resolution,
        periods=periods,
    )


def _matrices_of(given: Any, tick: float) -> str | dict[str, Any]:  # noqa: ANN401
    """Return the file of a law's matrices, or themselves as plain data; empty: none are given.

    Raises:
        CanrollError: a system that is continuous, or of another tick.
    """
    if given is None or isinstance(given, str | Path):
        return str(given or "")
    if isinstance(given, StateSpace):
        period = getattr(given, "dt", None)
        if period is not None and period is not True and not np.isclose(period, tick, rtol=1e-6):
            what = f"sampled every {1e3 * period:g} ms" if period else "continuous"
            raise CanrollError(
                f"matrices: the system is {what}, the loop's tick is {1e3 * tick:g} ms: convert it "
                f"to a sample time of {tick:g} s"
            )
        given = {name: getattr(given, name) for name in "ABCD"}
    return {name: np.asarray(value).tolist() for name, value in given.items()}


def options_of(choices: Mapping[str, Any], vehicle: Vehicle) -> QuantiseOptions:
    """Return the calibration options in ``choices`` for ``vehicle`` that no law changes.

    Raises:
        CanrollError: an invalid heartbeat, or one without events; an invalid uncertainty.
    """
    tick, heartbeat = (1e-3 * chosen(choices, name) for name in ("tick_ms", "heartbeat_ms"))
    if not tick <= heartbeat < COMMAND_TIMEOUT:
        raise CanrollError(
            f"--heartbeat {1e3 * heartbeat:g}: it must be at least the tick and below the "
            f"{1e3 * COMMAND_TIMEOUT:g} ms after which actuators release"
        )
    identification, observer = chosen(choices, "identification"), chosen(choices, "observer")
    if identification and observer in WITHOUT_ROLL_RATE:
        raise CanrollError(
            f"--identification needs the measured roll rate, which --observer {observer} does "
            "without: omit one of them"
        )
    event = chosen(choices, "trigger") == "event"
    every_tick = not event or chosen(choices, "actuator") == "dampers"
    if every_tick and choices.get("heartbeat_ms") is not None:
        where = "to dampers" if event else "with --trigger every"
        raise CanrollError(f"--heartbeat: {where} a command is sent every tick: omit it")
    watched, given = _response_watch(choices), choices.get("uncertainty") or {}
    box = of_vehicle(vehicle, (EVERY if watched else BY_STEERING) - set(given))
    return QuantiseOptions(
        event_trigger=event,
        identification=identification,
        offset_learning=chosen(choices, "offset_learning"),
        response_watch=watched,
        sample_period=_sample_period(choices),
        moment_reported=not _unreported(choices),
        uncertainty=stated(given, box),
        heartbeat=heartbeat,
    )


def _response_watch(choices: Mapping[str, Any]) -> bool:
    """Return whether the body's response is judged: by default wherever it can be."""
    given = choices.get("response_watch")
    never, lacking = _unwatchable(choices), _not_measured(choices)
    option = "watch-response=on" if given else CHOICES["response_watch"].option
    if never and given is not None:
        raise CanrollError(f"{option}: {never}: omit it")
    if lacking and given:
        raise CanrollError(f"{option}: {lacking}: omit it")
    return not never and not lacking and given is not False


def _unwatchable(choices: Mapping[str, Any]) -> str:
    """Return why reported moments cannot be judged by the body's response; "" if they can."""
    if chosen(choices, "actuator") not in ("bars", "suspension"):
        return "the commands of dampers and valves are no moments"
    if chosen(choices, "observer") == "reference":
        return "observer reference reads no inertial unit"
    return ""


def _not_measured(choices: Mapping[str, Any]) -> str:
    """Return why strokes of suspensions on tyres are not measured here; "" if they are."""
    if chosen(choices, "plant") == "roll1":
        return "plant roll1 has no tyres"
    profile = profile_of(choices)
    bus = bus_map(profile)
    if bus is not None and absent(bus, RX_SUSPENSION_RATE):
        return f"{profile.map_file} maps no stroke rates of the suspension"
    if _unreported(choices):
        return f"{profile.map_file} maps no delivered moments"
    return ""


def _unreported(choices: Mapping[str, Any]) -> bool:
    """Return whether the bus has no delivered moments, and the actuators' commands are moments."""
    bus = bus_map(profile_of(choices))
    moments = chosen(choices, "actuator") in ("bars", "suspension")
    return bus is not None and moments and bool(absent(bus, RX_ACTUATOR_STATE))


def _sample_period(choices: Mapping[str, Any]) -> float:
    """Return the time between two counts of the inertial unit, s; 0 where it cannot be judged."""
    if chosen(choices, "observer") == "reference":
        return 0.0
    bus = bus_map(profile_of(choices))
    if bus is None:
        return dbc.period("Imu")
    box = bus.received[RX_IMU]
    for signal in box.signals:
        if signal.place.text == SAMPLE_COUNTERS[box.slot] and signal.raw_hi == COUNTS:
            return 1e-3 * box.cycle_ms
    return 0.0


def _designed(choices: Mapping[str, Any]) -> Controller:
    law = chosen(choices, "law")
    task = task_of(choices)
    options = options_of(choices, task.vehicle)
    _, record, tables = calibrated(law, task, options)
    warnings = tuple(tables["design"]["warnings"])
    return Controller(task.vehicle, law, task.actuator, record, tables, warnings)


def calibrated(
    law: str, task: Task, options: QuantiseOptions
) -> tuple[Design, Calibration, Mapping[str, Any]]:
    """Return the verified design of a law, its record for the ECU, and the tables of its file.

    They are made once and kept: those of a built-in law on disk, of the user's in this process.

    Raises:
        CanrollError: options that contradict the law; numbers beyond the fixed-point formats.
        VerdictError: the design fails its own checks.
    """

    def make() -> tuple[Design, Calibration, Mapping[str, Any]]:
        # solvers, verification and the integer loop, for what is not kept from before
        from canroll.gain_gen.calibration.freeze import calibrate  # noqa: PLC0415
        from canroll.gain_gen.design import design, without_control  # noqa: PLC0415

        # without control the frames go on all the same
        answer = without_control(task) if law == PASSIVE else design(law, task)
        if task.actuator == "valves" and not answer.controller.commands_axles:
            # a moment law drives the bars' own torque loop: a current is the rate of a moment
            answer = replace(answer, task=replace(task, actuator="bars"))
        return answer, *calibrate(answer, options)

    if is_of_user(law, task):
        return recalled(key(law, id(LAWS[law]), task, options), make)
    return kept("calibrations", made_of(law, task, options), make)


def _loaded(calibration: LoadedCalibration, choices: Mapping[str, Any]) -> Controller:
    vehicle, note = calibration.vehicle, ""
    if choices.get("plant_vehicle") is None:
        note = vehicles.note_of_change(vehicle, "calibration")
    command = COMMANDS[calibration.record.actuator]
    delay = sample_to_force(vehicle, command, profile_of(choices), tick=calibration.tick)
    warnings = [line for line in calibration.warnings if "expect a limit cycle" not in line]
    beyond = calibration.delay_warning(delay.most) or _other_delay(calibration, choices, delay)
    return Controller(
        vehicle=vehicle,
        law=choices.get("law") or calibration.law,
        actuator=calibration.actuator,
        record=calibration.record,
        tables=calibration.tables,
        warnings=(*warnings, *(line for line in (beyond, note) if line)),
    )


def _other_delay(calibration: LoadedCalibration, choices: Mapping[str, Any], delay: Delay) -> str:
    """Return a note where the delay designed for does not occur on the chosen bus, or ""."""
    table = calibration.tables["design"]
    nominal = table.get("delay_s")
    if nominal is None or delay.least <= nominal <= delay.most:
        return ""
    least, most = table.get("delay_min_s", nominal), table.get("delay_max_s", nominal)
    designed = f"{1e3 * least:.3g}" if least == most else f"{1e3 * least:.3g} to {1e3 * most:.3g}"
    bus = chosen(choices, "bus") if choices.get("bus") else f"{chosen(choices, 'bus')} (default)"
    return (
        f"the calibration is designed for {designed} ms from sample to force, bus {bus} has "
        f"{1e3 * delay.least:.3g} to {1e3 * delay.most:.3g} ms: choose the bus designed for by "
        "--bus"
    )
