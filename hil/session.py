"""A run of two programs: plant and ECU are started, watched and stopped, their results merged."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from canroll.errors import CanrollError
from canroll.gain_gen.calibration import calibration_file
from canroll.hil import children as programs
from canroll.hil import plant_record, process, tick_trace, timing
from canroll.hil.children import ChildProgram
from canroll.hil.plant_record import PlantRecord
from canroll.hil.tick_trace import TickTrace
from canroll.runs import experiment, validity
from canroll.runs.result import Run
from canroll.runs.trace import Trace
from canroll.runs.virtual_time import Interrupted
from canroll.setup import words
from canroll.setup.choices import CHOICES
from canroll.setup.controller import Controller
from canroll.vehicles import plausible

VEHICLE = "plant_vehicle.toml"
"""File of the vehicle that the plant drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Settings of the two programs.

    Attributes:
        bus_options: python-can's options of both; empty for the plant's own bus.
        folder: folder for calibration, traces and results.
        cores: of plant and ECU; None: not pinned.
        duration: s; None for the manoeuvre's.
        announce: called with the name of the current activity.
        pace: "realtime", or "lockstep": the plant grants the ECU's ticks.
        serve: ``HOST:PORT`` of the plant's own bus; None: a free port on loopback.
    """

    bus_options: Sequence[str]
    folder: Path
    cores: tuple[int, int] | None
    duration: float | None
    announce: Callable[[str], None]
    pace: str = "realtime"
    serve: str | None = None


def choose_cores() -> tuple[int, int] | None:
    """Return a core for the plant and one for the ECU, or None if there is only one."""
    cores = process.cores()
    return (cores[-2], cores[-1]) if len(cores) > 1 else None


def drive(
    settings: Run, controller: Controller, setup: Setup, *, enabled: bool
) -> tuple[Trace, dict[str, Any]]:
    """Drive the manoeuvre once as two programs; return its trace and the ``timing`` object.

    Raises:
        CanrollError: a program could not start or failed; the message is its own.
        VerdictError: it failed during the run, or frames of lock step were lost.
        Interrupted: Ctrl-C; both have ended.
    """
    folder = setup.folder
    gains = folder / "calibration.toml"
    calibration_file.save(gains, controller.record, controller.tables)
    save_vehicle(settings, setup)
    # what an earlier run left behind must not be taken for this one's
    record, ticks = folder / "plant.npz", folder / "ticks.npz"
    for old in (record, ticks):
        old.unlink(missing_ok=True)
    children: list[ChildProgram] = []
    try:
        plant = programs.start(children, "plant", plant_arguments(settings, setup, enabled=enabled))
        bus = list(setup.bus_options)
        if not bus:
            bus = programs.wait_for(plant, "serving ").split()[1:]
            setup.announce(f"to watch: canroll watch {' '.join(bus)}")
        programs.wait_for(plant, "plant waits")
        arguments = ["ecu", "--calibration", str(gains), "--backend", settings.backend]
        arguments += ["--trace", str(ticks), *_core(setup, 1), *bus, *_pace(setup)]
        frames = ("bus", "dbc", "map", "key")
        arguments += words.arguments({name: getattr(settings, name) for name in frames})
        if setup.pace == "realtime":
            arguments += _phase(settings)
        ecu = programs.start(children, "ECU", arguments)
        programs.wait_for(plant, "plant runs", ecu)
        how = "in lock step" if setup.pace == "lockstep" else "in real time"
        setup.announce(f"{'with' if enabled else 'without'} control {how}")
        programs.wait_for(plant, "plant ends", ecu)
        ecu.ask_to_stop()
        for child in children:
            programs.check_ended(child)
    except KeyboardInterrupt:
        # the ECU ends first, so that the plant still hears its last command
        programs.stop(children)
        if record.exists() and ticks.exists():
            trace, _ = assemble(
                plant_record.load(record), tick_trace.load(ticks), settings, setup, complete=False
            )
            raise Interrupted(trace) from None
        raise
    finally:
        programs.stop(children)
    return assemble(plant_record.load(record), tick_trace.load(ticks), settings, setup)


def save_vehicle(settings: Run, setup: Setup) -> None:
    """Write the vehicle that the plant drives."""
    # a drawn vehicle may be implausible
    text = tomli_w.dumps({"unusual": list(plausible.KEYS), **settings.vehicle.document})
    (setup.folder / VEHICLE).write_text(text, encoding="utf-8")


def plant_arguments(settings: Run, setup: Setup, *, enabled: bool) -> list[str]:
    """Return the plant's command line for ``settings``, with their vehicle in its file."""
    arguments = ["plant", settings.scenario, *setup.bus_options, *_pace(setup)]
    # its ECU is watched: it comes, or its end is noticed
    arguments += ["--wait", str(programs.START)]
    if not setup.bus_options and not settings.firmware.fd:
        arguments += ["--serve", setup.serve or "127.0.0.1:0"]
    arguments += ["--command", settings.command, "--record", str(setup.folder / "plant.npz")]
    asked = settings.choices() | {"vehicle": str(setup.folder / VEHICLE)}
    world = {name: value for name, value in asked.items() if CHOICES[name].of == "world"}
    arguments += words.arguments(world | {"duration": setup.duration})
    if not enabled:
        arguments.append("--passive")
    if setup.pace == "lockstep" and settings.phase is not None:
        arguments += words.arguments({"phase_ms": 1e3 * settings.phase})
    return arguments + _core(setup, 0)


def _pace(setup: Setup) -> list[str]:
    return ["--pace", setup.pace]


def _phase(settings: Run) -> list[str]:
    """Return the ECU's option for the phase of virtual time, "free" for a tick without one."""
    try:
        return words.arguments({"phase_ms": experiment.tick_phase_ns(settings) / 1e6})
    except CanrollError:
        return [CHOICES["phase_ms"].option, "free"]


def _core(setup: Setup, which: int) -> list[str]:
    return [] if setup.cores is None else ["--cpu", str(setup.cores[which])]


def assemble(
    plant: PlantRecord,
    ecu: TickTrace,
    settings: Run,
    setup: Setup,
    *,
    complete: bool = True,
) -> tuple[Trace, dict[str, Any]]:
    """Return a run's trace and its ``timing`` object from the files of both programs.

    The ECU's estimates come from replaying its tick trace, which must give the same frames.

    Raises:
        CanrollError: the replay differs.
    """
    start = int(plant.about["start_ns"])
    granted = setup.pace == "lockstep"
    if granted:
        # the ECU counts periods, and the first of them begins at tick 0
        start = -experiment.tick_offset_ns(settings)
    again = tick_trace.replay(
        ecu, settings.backend, start_ns=start, firmware=settings.firmware, key=settings.secret
    )
    if again.difference is not None:
        raise CanrollError(f"the tick trace does not replay: {again.difference}")
    length = float(plant.signals["time"][-1])
    ages = plant.ages
    if not granted:
        ages = timing.latencies(
            ecu,
            plant.commands,
            np.asarray(plant.frames),
            start_ns=start,
            sensor_latency_ns=_sensor_latency_ns(settings),
            firmware=settings.firmware,
        )
    during = (again.rows["t"] >= 0) & (again.rows["t"] <= length)
    trace = Trace(
        signals=plant.signals,
        frames=plant.frames,
        ages=ages,
        ticks=again.rows[during],
        duration=length,
        complete=complete,
        refused=_refused(plant, ecu) if settings.firmware.bus.secured else None,
    )
    summary = timing_object(plant, ecu, ages, during, setup)
    if complete:
        summary["not_valid"] = validity.reasons(_judged(settings, setup, plant, trace, summary))
        summary["valid"] = not summary["not_valid"]
    return trace, summary


def _refused(plant: PlantRecord, ecu: TickTrace) -> tuple[int, int]:
    return int(ecu.about["not_authentic"]), int(plant.about["not_authentic"])


def _judged(
    settings: Run,
    setup: Setup,
    plant: PlantRecord,
    trace: Trace,
    timing: Mapping[str, Any],
) -> validity.RunTiming:
    """Return the timing that decides the validity of a run."""
    full = experiment.build_world(settings, enabled=False).duration_ns * 1e-9
    planned = full if setup.duration is None else setup.duration
    if setup.pace == "lockstep":
        planned = min(planned, full)
    delay = experiment.delay_of(settings)
    tick = settings.tick
    p99 = timing["latency_us"] and 1e-6 * timing["latency_us"]["p99"]
    return validity.RunTiming(
        due=int((planned + 1e-9) / tick) - 1,
        ticks=int(timing["ticks"]),
        tick=tick,
        plant_late=(plant.loop[:, 0] * 1e-9).tolist(),
        frames=int(timing["frames"]),
        lost=int(timing["frames_lost"]),
        planned=planned,
        driven=trace.duration,
        rolled_over=bool(plant.signals["rollover"][-1]),
        commands=len(plant.commands),
        latencies=len(trace.ages),
        latency_p99=p99,
        # a sensor that fails makes samples old on any bus
        latency_bound=math.inf if settings.faults else delay.most,
        # time stands still in lock step while something is compiled
        compilations=int(timing["compilations"]) if setup.pace == "realtime" else 0,
    )


def _sensor_latency_ns(settings: Run) -> int:
    sensors = settings.vehicle.sensors
    channels = (sensors.roll_rate, sensors.lateral_acceleration, sensors.yaw_rate)
    return round(max(channel.latency for channel in channels) * 1e9)


def timing_object(
    plant: PlantRecord,
    ecu: TickTrace,
    ages: timing.Times,
    during: np.ndarray[Any, np.dtype[np.bool_]],
    setup: Setup,
) -> dict[str, Any]:
    """Return the object "timing" of ``canroll hil --json``; only ticks of the run count.

    Its "jitterdebugger" is the content of timing.json.
    """
    ran = TickTrace(ecu.calibration, ecu.ticks[during], ecu.frames, ecu.about)
    notes = [*plant.about["notes"], *ecu.about["notes"]]
    # granted ticks have no deadline that they could be late for
    jitter = timing.start_jitter(ran) if setup.pace == "realtime" else np.zeros(0, np.int64)
    if setup.cores is None and setup.pace == "realtime":
        notes.append("one core for both programs: not pinned, the budget is not judged")
    if ecu.about["full"]:
        notes.append("the tick trace ends early: its temporary file could not be written")
    return {
        "deadline_misses": timing.misses(ran),
        "ticks": len(ran.ticks),
        "start_jitter_us": timing.quantiles(jitter),
        "tick_us": timing.quantiles(timing.durations(ran)),
        "latency_us": timing.quantiles(ages),
        "plant_jitter_us": timing.quantiles(plant.loop[:, 0]),
        "plant_step_us": timing.quantiles(plant.loop[:, 1]),
        "pace": setup.pace,
        "speed": 1e9 * float(plant.signals["time"][-1]) / int(plant.about["wall_ns"]),
        "frames": int(plant.about["sent"]) + int(ecu.about["sent"]),
        "frames_lost": 0 if setup.pace == "lockstep" else frames_lost(plant, ecu),
        "compilations": int(plant.about["compilations"]) + int(ecu.about["compilations"]),
        "cores": dict(zip(("plant", "ecu"), setup.cores, strict=True)) if setup.cores else None,
        "judged": setup.cores is not None and setup.pace == "realtime",
        "notes": sorted(set(notes)),
        "bus": {"ecu": _bus_seen(ecu, plant), "plant": _bus_seen(plant, plant)},
        "histograms": {
            "start_jitter": timing.histogram(jitter),
            "tick": timing.histogram(timing.durations(ran)),
            "latency": timing.histogram(ages),
            "plant_jitter": timing.histogram(plant.loop[:, 0]),
        },
        "jitterdebugger": timing.jitterdebugger(
            {
                (setup.cores or (0, 0))[0]: plant.loop[:, 0],
                (setup.cores or (0, 0))[1]: jitter,
            }
        ),
    }


def _bus_seen(program: PlantRecord | TickTrace, plant: PlantRecord) -> dict[str, Any] | None:
    """Return a program's record of the real bus while the plant ran.

    In lock step plant time is not clock time: the whole record counts, without load and waits.
    """
    about = program.about.get("bus")
    if about is not None and plant.about.get("pace") == "lockstep":
        return timing.bus_figures(program.bus, {**about, "real_time": False})
    read = program.bus["read_ns"]
    ran = (read >= int(plant.about["start_ns"])) & (read <= int(plant.about["end_ns"]))
    return timing.bus_figures(program.bus[ran], about)


def frames_lost(plant: PlantRecord, ecu: TickTrace) -> int:
    """Return the number of frames sent by one side and not received, including send failures."""
    end = int(plant.about["end_ns"])
    to_ecu = max(0, int(plant.about["sent"]) - int(ecu.about["received"]))
    early = ecu.ticks["start_ns"] < end - 10_000_000
    last = int(ecu.ticks["frames"][early].sum())
    to_plant = max(0, int(ecu.frames["sent"][:last].sum()) - int(plant.about["received"]))
    return to_ecu + to_plant
