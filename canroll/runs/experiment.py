"""One manoeuvre, without and with control, in virtual time."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from canroll import vehicles
from canroll.arguments import checked
from canroll.codegen.run.backends import open_backend
from canroll.errors import CanrollError, UnknownNameError
from canroll.firmware.calibration import ONE
from canroll.firmware.state import SAFE
from canroll.gain_gen.models.task import Delay
from canroll.plant_sim.bodies import body
from canroll.plant_sim.driving import MANEUVERS, maneuvers, tyre_limits
from canroll.plant_sim.faults import parse_all
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.world.recording import EVERYTHING, NOTHING, Kept
from canroll.plant_sim.world.spool import pieces
from canroll.plant_sim.world.world import World
from canroll.plant_sim.world.world_parts import check_body
from canroll.reaction import reaction
from canroll.runs import conditions as conditions_of
from canroll.runs import limit_cycle, metrics, phase, standard, steering_replay
from canroll.runs.limit_cycle import LimitCycle
from canroll.runs.result import Result, Run
from canroll.runs.trace import Trace
from canroll.runs.virtual_time import closed_loop
from canroll.setup.bus_frames import check_frames, names_of, profile_of, refuse_useless_key
from canroll.setup.choices import PASSIVE, Choices, check, chosen
from canroll.setup.controller import COMMAND_TIMEOUT, Controller, prepare
from canroll.setup.delay import sample_to_force
from canroll.typing import Progress

AT_THE_LIMIT = ("fishhook", "j_turn", "sine_with_dwell", "moose")
"""Manoeuvres made to find the limit of tyres and wheel loads."""
OF_THE_CONTROLLER = ("law", "actuator", "observer", "tick", "command", "stage")
"""Settings that a calibration fixes."""


@checked
def run(scenario: str, *, progress: Progress | None = None, **choices: Unpack[Choices]) -> Result:
    """Drive a manoeuvre without and with control and return the result.

    Args:
        scenario: name of the manoeuvre, such as "double_lane_change" or "roundabout".
        progress: called with "passive", "controlled" or "replay" and the fraction done.
        choices: vehicle, law, bus, seed, … : see :class:`canroll.setup.choices.Choices`.

    Raises:
        CanrollError: an invalid name, number or file; the message names the remedy.
        VerdictError: the design fails its own checks.
        Interrupted: Ctrl-C; it carries the trace so far.
    """
    settings, controller = plan(scenario, **choices)
    return simulate(settings, controller, duration=choices.get("duration"), progress=progress)


def plan(scenario: str, **choices: Unpack[Choices]) -> tuple[Run, Controller]:
    """Return settings and controller of :func:`run` with the same arguments.

    Raises:
        CanrollError: an invalid name, number or file; the message names the remedy.
        VerdictError: the design fails its own checks.
    """
    check(choices)
    if scenario not in MANEUVERS:
        raise UnknownNameError("scenario", scenario, MANEUVERS)
    # reject invalid input before any slow work
    speed_kmh, options = choices.get("speed_kmh"), choices.get("options") or {}
    speed = None if speed_kmh is None else speed_kmh / 3.6
    maneuvers.check_inputs(scenario, speed, dict(options))
    profile = profile_of(choices)
    refuse_useless_key(choices, profile)
    conditions_of.fault_texts(choices)
    conditions_of.options(choices.get("conditions"))
    plant = body(chosen(choices, "plant"))
    check_body(plant, chosen(choices, "actuator"))
    if "friction" in options and not plant.friction:
        raise CanrollError(
            f"option friction: {plant.name} has no tyres that friction limits: "
            "omit it, or choose --plant nonlinear"
        )
    controller = prepare(choices)
    vehicle, warnings = controller.vehicle, [*check_frames(profile, controller.record)]
    other, phase_ms = choices.get("plant_vehicle"), choices.get("phase_ms")
    if other is not None:
        vehicle = vehicles.load(other)
        warnings.append(
            f"{controller.law} is designed for {controller.vehicle.name} and drives "
            f"{vehicle.name}: its margins and checks are those of {controller.vehicle.name}"
        )
    maneuver = maneuvers.build(scenario, vehicle, speed, chosen(choices, "seed"), **options)
    warnings += [*plant.left_out(vehicle), *maneuver.remarks]
    if plant.lacks:
        warnings.append(
            f"{plant.name} has no {', '.join(plant.lacks)}: pitch and heave are 0 then, figures of "
            "the others left out"
        )
    settings = Run.of(
        choices,
        scenario=scenario,
        vehicle=vehicle,
        speed=maneuver.speed,
        plant_vehicle=None if other is None else vehicle.reference,
        designed_for=controller.vehicle.name,
        phase=None if phase_ms is None else 1e-3 * phase_ms,
        **{name: getattr(controller, name) for name in OF_THE_CONTROLLER},
    )
    if settings.phase is not None:
        phase.checked_cycle_ns(round(settings.tick * 1e9), round(settings.phase * 1e9))
    return settings, replace(controller, warnings=(*controller.warnings, *warnings))


def simulate(
    settings: Run,
    controller: Controller,
    *,
    duration: float | None = None,
    progress: Progress | None = None,
    passive: Trace | None = None,
) -> Result:
    """Run ``controller`` under ``settings``; ``passive`` is reused instead of driven again."""
    if passive is None:
        fault_free = healthy(settings)
        passive = drive(fault_free, controller, enabled=False, duration=duration, progress=progress)
    if settings.law == PASSIVE:
        return assess(settings, controller, passive, None)
    controlled = drive(settings, controller, enabled=True, duration=duration, progress=progress)
    replayed = None
    if steering_replay.differs(maneuver_of(settings), passive, controlled):
        replayed = drive(
            settings,
            controller,
            enabled=True,
            duration=duration,
            progress=progress,
            steer=passive.signals["steer"],
        )
    cycle = limit_cycle_of(settings, controller, controlled, passive.signals)
    return assess(settings, controller, passive, controlled, replayed, cycle=cycle)


def healthy(settings: Run) -> Run:
    """Return the settings of the fault-free vehicle that what faults do is measured against."""
    return settings if settings.law == PASSIVE else replace(settings, faults=())


def limit_cycle_of(
    settings: Run,
    controller: Controller,
    controlled: Trace,
    passive: Mapping[str, NDArray[np.float64]],
) -> LimitCycle | None:
    """Return the limit cycle of the controlled run, or None.

    Only a run whose command oscillates is driven once more, from one period of the oscillation
    on without noise and straight on.

    ``passive``: at least "time" (s) and "roll" (rad) of the run without control.
    """
    candidates = limit_cycle.oscillations(controlled.ticks["t"], controlled.ticks["moment"])
    cycles = limit_cycle.unexcited(
        candidates, lambda: ((t, roll) for t, roll in pieces(passive, "time", "roll"))
    )
    own = (cycle for cycle in cycles if _goes_on(settings, controller, controlled, cycle))
    return next(own, None)


def _goes_on(settings: Run, controller: Controller, controlled: Trace, cycle: LimitCycle) -> bool:
    """Whether the oscillation of the controlled run goes on without noise and straight on."""
    driven = max(1, round(cycle.established * 1e9) // STEP_NS)
    straight = maneuvers.straightened(
        maneuver_of(settings),
        controlled.signals["steer"][:driven],
        controlled.signals["vx"][:driven],
        cycle.established + cycle.watched,
    )
    quiet = _without_noise(settings, cycle.established)
    ticks = drive(quiet, controller, enabled=True, maneuver=straight, kept=NOTHING).ticks
    t, moment = ticks["t"], ticks["moment"]
    opened = np.flatnonzero((ticks["mode"] == SAFE) & (t > cycle.established))
    end = opened[0] if len(opened) else len(t)
    return limit_cycle.goes_on(t[:end], moment[:end], cycle.established)


def _without_noise(settings: Run, since: float) -> Run:
    """Return the settings without noise from ``since`` (s) on or faults that act repeatedly."""
    lasting = (
        fault
        for fault in parse_all(settings.faults)
        if fault.kind not in ("burst", "spike") and not fault.every
    )
    return replace(
        settings,
        conditions=(*settings.conditions, ("noise_end", since)),
        faults=tuple(map(str, lasting)),
    )


def drive(
    settings: Run,
    controller: Controller,
    *,
    enabled: bool,
    duration: float | None = None,
    progress: Progress | None = None,
    maneuver: maneuvers.Maneuver | None = None,
    steer: NDArray[np.float64] | None = None,
    kept: Kept = EVERYTHING,
) -> Trace:
    """Drive the manoeuvre once; without control the actuators are disabled but frames exchanged.

    ``maneuver`` is driven instead of that of the settings. ``steer``: angle at the road wheels,
    rad, one value per millisecond, replayed instead of the driver's steering. ``kept``: what the
    trace has of signals and frames.
    """
    maneuver = maneuver or maneuver_of(settings)
    stage = "controlled" if enabled else "passive"
    if steer is not None:
        maneuver, stage = maneuvers.replay(maneuver, steer), "replay"
    trace = closed_loop(
        build_world(settings, enabled=enabled, maneuver=maneuver, kept=kept),
        open_backend(settings.backend, controller.record, settings.firmware, key=settings.secret),
        tick_ns=round(settings.tick * 1e9),
        offset_ns=tick_offset_ns(settings),
        duration_ns=None if duration is None else round(duration * 1e9),
        progress=None if progress is None else lambda share: progress(stage, share),
    )
    return trace if steer is None else steering_replay.with_path_error(trace, maneuver.drive)


def tick_offset_ns(settings: Run) -> int:
    """Return the instant of tick 0 for the chosen phase, else 0, ns."""
    if settings.phase is None:
        return 0
    world = build_world(replace(settings, faults=()), enabled=False)
    return phase.offset_ns(world, round(settings.tick * 1e9), round(settings.phase * 1e9))


def tick_phase_ns(settings: Run) -> int:
    """Return the phase of the ticks of virtual time under ``settings``, ns.

    Raises:
        CanrollError: they have no phase.
    """
    if settings.phase is not None:
        return round(settings.phase * 1e9)
    world = build_world(replace(settings, faults=()), enabled=False)
    return phase.phase_ns(world, round(settings.tick * 1e9))


def build_world(settings: Run, *, enabled: bool, **others: Any) -> World:  # noqa: ANN401
    """Return the world for ``settings`` at time 0, with :func:`world_options`."""
    return World(**world_options(settings, enabled=enabled, **others))


def world_options(settings: Run, *, enabled: bool, **others: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return the arguments of the world for ``settings``; the ``others`` stand instead."""
    sensors, actuators = conditions_of.options(dict(settings.conditions))
    options = dict(
        vehicle=settings.vehicle,
        body=settings.plant,
        actuator=settings.actuator,
        maneuver=others.get("maneuver") or maneuver_of(settings),
        profile=settings.profile,
        seed=settings.seed,
        enabled=enabled,
        command=settings.command,
        command_timeout_ms=1e3 * COMMAND_TIMEOUT,
        sensors=sensors,
        actuators=actuators,
        faults=parse_all(settings.faults),
        key=settings.secret,
    )
    return options | others


def maneuver_of(settings: Run) -> maneuvers.Maneuver:
    """Return the manoeuvre of ``settings``."""
    return maneuvers.build(
        settings.scenario,
        settings.vehicle,
        settings.speed,
        settings.seed,
        **dict(settings.options),
    )


def delay_of(settings: Run) -> Delay:
    """Return the bounds of the sample-to-force delay under ``settings``, s."""
    return sample_to_force(settings.vehicle, settings.command, settings.profile, tick=settings.tick)


def assess(
    settings: Run,
    controller: Controller,
    passive: Trace,
    controlled: Trace | None,
    replayed: Trace | None = None,
    *,
    cycle: LimitCycle | None = None,
) -> Result:
    """Return the figures of a pair of runs and of the replay, if any.

    ``cycle`` is the limit cycle of the controlled run (:func:`limit_cycle_of`).
    """
    maneuver = maneuver_of(settings)
    seen = passive if controlled is None else controlled
    delay = delay_of(settings)
    names = names_of(settings.profile)
    imu = next(ident for ident, name in names.items() if name == "Imu")
    warnings = list(controller.warnings)
    if settings.plant == "roll1" and settings.scenario in AT_THE_LIMIT:
        warnings.append("roll1 has no tyre limits and no wheel lift: use --plant nonlinear")
    if settings.plant == "nonlinear":
        warnings.extend(tyre_limits.beyond(settings.vehicle, seen.signals))
    if cycle is not None:
        warnings.append(str(cycle))
    without_roll = metrics.load_transfer_without_roll(
        passive, settings.vehicle, controller.record.schedule_front_share[0] / ONE
    )
    drive = maneuver.drive
    # what a level road without wind does not have
    if any(map(np.any, (drive.road_left, drive.road_right, drive.grade, drive.wind))):
        without_roll = dict.fromkeys(without_roll)
    return Result(
        settings=settings,
        record=controller.record,
        tables=controller.tables,
        delay=delay,
        passive=passive,
        controlled=controlled,
        passive_metrics=metrics.judge(passive),
        controlled_metrics=None if controlled is None else metrics.judge(controlled),
        without_roll=without_roll,
        can=metrics.can(seen, names),
        trigger=metrics.trigger(seen, heartbeat_ticks=controller.record.heartbeat_ticks),
        limit_cycle=cycle,
        options=_effective_options(settings, maneuver),
        standard=standard.assess(maneuver, settings.vehicle, passive, controlled),
        replay=replayed,
        replay_metrics=None if replayed is None else metrics.judge(replayed),
        warnings=tuple(warnings),
        reaction=None
        if controlled is None
        else reaction.observe(controlled, passive, parse_all(settings.faults)),
        phase=phase.measured(seen.ticks["t"], seen.frames, imu),
    )


def _effective_options(settings: Run, maneuver: maneuvers.Maneuver) -> dict[str, Any]:
    """Return the options of the manoeuvre that have an effect on this plant."""
    without = set() if body(settings.plant).friction else {"friction"}
    return {key: value for key, value in maneuver.options.items() if key not in without}


def with_files(result: Result, files: dict[str, str]) -> Result:
    """Return the result with the paths of its files."""
    return replace(result, files=files)
