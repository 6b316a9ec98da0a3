"""A run in real time: plant and ECU started as two programs, watched, stopped and put together."""

import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from canroll.errors import CanrollError
from gain_gen.calibration import calibration_file
from hil.realtime import children as programs
from hil.realtime import plant_record, process, tick_trace, timing
from hil.realtime.children import Program
from hil.realtime.plant_record import PlantRecord
from hil.realtime.tick_trace import TickTrace
from hil.runs.frozen import Controller
from hil.runs.result import Settings
from hil.runs.trace import Trace
from hil.runs.virtual_time import Interrupted


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """How the two programs are run.

    Attributes:
        bus_options: python-can's options of both; empty: the plant's own bus.
        folder: where calibration, traces and results are put.
        cores: of plant and ECU; None: not pinned.
        duration: s, None: the manoeuvre's.
        announce: told in a few words what is under way.
        serve: ``HOST:PORT`` of the plant's own bus; None: a free port on loopback.
    """

    bus_options: Sequence[str]
    folder: Path
    cores: tuple[int, int] | None
    duration: float | None
    announce: Callable[[str], None]
    serve: str | None = None


def choose_cores() -> tuple[int, int] | None:
    """Return a core each for plant and ECU, None where there is only one."""
    cores = process.cores()
    return (cores[-2], cores[-1]) if len(cores) > 1 else None


def drive(
    settings: Settings, controller: Controller, setup: Setup, *, enabled: bool
) -> tuple[Trace, dict[str, Any]]:
    """Drive the manoeuvre once in real time; return its trace and the ``timing`` object.

    Raises:
        CanrollError: a program could not start or fell over; its own words.
        Interrupted: Ctrl-C; both have ended.
    """
    folder = setup.folder
    gains = folder / "calibration.toml"
    calibration_file.save(gains, controller.record, controller.tables)
    # what an earlier run left behind must not be taken for this one's
    record, ticks = folder / "plant.npz", folder / "ticks.npz"
    for old in (record, ticks):
        old.unlink(missing_ok=True)
    children: list[Program] = []
    try:
        plant = programs.start(
            children, "plant", plant_arguments(settings, controller, setup, enabled=enabled)
        )
        bus = list(setup.bus_options)
        if not bus:
            bus = programs.wait_for(plant, "serving ").split()[1:]
            setup.announce(f"to watch: canroll watch {' '.join(bus)}")
        programs.wait_for(plant, "plant waits")
        arguments = ["ecu", "--calibration", str(gains), "--backend", settings.backend]
        arguments += ["--trace", str(ticks), *_core(setup, 1), *bus]
        ecu = programs.start(children, "ECU", arguments)
        programs.wait_for(plant, "plant runs", ecu)
        setup.announce(f"{'with' if enabled else 'without'} control in real time")
        programs.wait_for(plant, "plant ends", ecu)
        ecu.ask_to_stop()
        for child in children:
            child.running.wait()
            # an ECU that had ended by itself, its files written, dies of being asked to
            if child.running.returncode not in (0, -signal.SIGTERM):
                raise CanrollError(f"{child.name}: {child.last_words()}")
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


def plant_arguments(
    settings: Settings, controller: Controller, setup: Setup, *, enabled: bool
) -> list[str]:
    """Return the command line of the plant that ``settings`` describe."""
    arguments = ["plant", settings.scenario, *setup.bus_options]
    if not setup.bus_options:
        arguments += ["--serve", setup.serve or "127.0.0.1:0"]
    options = {
        "vehicle": controller.tables["design"]["vehicle"],
        "actuator": settings.actuator,
        "command": settings.command,
        "plant": settings.plant,
        "speed": repr(settings.speed * 3.6),
        "bus": settings.bus,
        "seed": settings.seed,
        "record": setup.folder / "plant.npz",
    }
    for name, value in options.items():
        arguments += [f"--{name}", str(value)]
    for name, value in settings.options:
        arguments += ["--set", f"{name}={value}"]
    for fault in settings.faults:
        arguments += ["--fault", fault]
    for name, value in settings.conditions:
        arguments += ["--condition", f"{name}={value}"]
    if setup.duration is not None:
        arguments += ["--duration", str(setup.duration)]
    if not enabled:
        arguments.append("--passive")
    return arguments + _core(setup, 0)


def _core(setup: Setup, which: int) -> list[str]:
    return [] if setup.cores is None else ["--cpu", str(setup.cores[which])]


def assemble(
    plant: PlantRecord,
    ecu: TickTrace,
    settings: Settings,
    setup: Setup,
    *,
    complete: bool = True,
) -> tuple[Trace, dict[str, Any]]:
    """Return a run's trace and its ``timing`` object from what both programs left.

    The ECU's estimates come from running its tick trace again, which has to give the same frames.

    Raises:
        CanrollError: it does not.
    """
    start = int(plant.about["start_ns"])
    again = tick_trace.replay(ecu, settings.backend, start_ns=start)
    if again.difference is not None:
        raise CanrollError(f"the tick trace does not replay: {again.difference}")
    length = float(plant.signals["time"][-1])
    ages = timing.latencies(
        ecu,
        plant.commands,
        plant.frames,
        start_ns=start,
        sensor_latency_ns=_sensor_latency_ns(settings),
    )
    during = (again.rows["t"] >= 0) & (again.rows["t"] <= length)
    trace = Trace(
        signals=plant.signals,
        frames=plant.frames,
        ages=ages,
        ticks=again.rows[during],
        duration=length,
        complete=complete,
    )
    return trace, timing_object(plant, ecu, ages, during, setup)


def _sensor_latency_ns(settings: Settings) -> int:
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
    """Return what ``canroll hil --json`` prints under "timing"; only ticks of the run count.

    Beside it, under "jitterdebugger", what timing.json holds.
    """
    ran = TickTrace(ecu.calibration, ecu.ticks[during], ecu.frames, ecu.about)
    notes = [*plant.about["notes"], *ecu.about["notes"]]
    if setup.cores is None:
        notes.append("one core for both programs: not pinned, misses are not judged")
    if ecu.about["full"]:
        notes.append("the tick trace was full before the end")
    return {
        "deadline_misses": timing.misses(ran),
        "ticks": len(ran.ticks),
        "start_jitter_us": timing.quantiles(timing.start_jitter(ran)),
        "tick_us": timing.quantiles(timing.durations(ran)),
        "latency_us": timing.quantiles(ages),
        "plant_jitter_us": timing.quantiles(plant.loop[:, 0]),
        "plant_step_us": timing.quantiles(plant.loop[:, 1]),
        "frames_lost": frames_lost(plant, ecu),
        "cores": dict(zip(("plant", "ecu"), setup.cores, strict=True)) if setup.cores else None,
        "judged": setup.cores is not None,
        "notes": sorted(set(notes)),
        "bus": {"ecu": _bus_seen(ecu, plant), "plant": _bus_seen(plant, plant)},
        "histograms": {
            "start_jitter": timing.histogram(timing.start_jitter(ran)),
            "tick": timing.histogram(timing.durations(ran)),
            "latency": timing.histogram(ages),
            "plant_jitter": timing.histogram(plant.loop[:, 0]),
        },
        "jitterdebugger": timing.jitterdebugger(
            {
                (setup.cores or (0, 0))[0]: plant.loop[:, 0],
                (setup.cores or (0, 0))[1]: timing.start_jitter(ran),
            }
        ),
    }


def _bus_seen(program: PlantRecord | TickTrace, plant: PlantRecord) -> dict[str, Any] | None:
    """Return what a program saw of the real bus while the plant ran.

    In lock step the plant's time is not the clock's: all of it counts, but neither load nor waits.
    """
    about = program.about.get("bus")
    if about is not None and plant.about.get("pace") == "lockstep":
        return timing.bus_figures(program.bus, {**about, "real_time": False})
    read = program.bus["read_ns"]
    ran = (read >= int(plant.about["start_ns"])) & (read <= int(plant.about["end_ns"]))
    return timing.bus_figures(program.bus[ran], about)


def frames_lost(plant: PlantRecord, ecu: TickTrace) -> int:
    """Return how many frames one side sent and the other never saw, send failures included."""
    end = int(plant.about["end_ns"])
    to_ecu = max(0, int(plant.about["sent"]) - int(ecu.about["received"]))
    early = ecu.ticks["start_ns"] < end - 10_000_000
    last = int(ecu.ticks["frames"][early].sum())
    to_plant = max(0, int(ecu.frames["sent"][:last].sum()) - int(plant.about["received"]))
    return to_ecu + to_plant
