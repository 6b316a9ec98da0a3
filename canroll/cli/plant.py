"""``canroll plant``: the vehicle alone, in real time, on any python-can bus or its own."""

import argparse

import numpy as np

from canroll import vehicles
from canroll.cli.ecu import check_memory, nanoseconds, peer_timeout
from canroll.cli.options import choices_of
from canroll.cli.parser import refuse
from canroll.errors import CanrollError, VerdictError, writing
from canroll.hil import lockstep, own_bus, plant_loop, plant_record, process, warm
from canroll.hil.bus_link import Link, open_link
from canroll.hil.hardware import bus_record, lasting
from canroll.hil.hardware.bus_options import has_bus, parsed_options
from canroll.hil.hardware.interfaces import is_loopback
from canroll.hil.plant_loop import PlantOutcome
from canroll.plant_sim.faults import parse_all
from canroll.plant_sim.world import archive
from canroll.plant_sim.world.fault_parts import outages
from canroll.plant_sim.world.world import World
from canroll.report import signal_files
from canroll.report.staging import check_parent
from canroll.runs import logs, phase
from canroll.runs.experiment import build_world
from canroll.runs.result import Run
from canroll.runs.trace import entries
from canroll.setup.bus_frames import firmware_of, profile_of
from canroll.setup.choices import chosen

ECU = "RollControl"
"""Name of the ECU among the senders that the vehicle's nodes remember."""


def run(args: argparse.Namespace) -> int:
    """Simulate until the manoeuvre is over, the ECU is lost or a signal arrives.

    Raises:
        VerdictError: a run in lock step is not one run with one ECU; its files are written.
    """
    for path, check in ((args.log, logs.check_suffix), (args.signals, signal_files.check_suffix)):
        if path is not None:
            check_parent(check(path))
    peer_timeout(args)
    nanoseconds(args.duration, "--duration")
    check_memory(args, profile_of(choices_of(args)))
    memory = lasting.read(args.memory)
    if has_bus(args):
        refuse(args, "serve", "it is of the plant's own bus, not of -i")
    # compiled before the clock runs: this world is thrown away
    rehearsed = world_of(args)
    rehearsed.advance(plant_loop.STEP_NS)
    _ = rehearsed.signals
    if args.prepare:
        return 0
    world = world_of(args, memory)
    settings = process.paced(args.pace, cpu=args.cpu, priority=process.PLANT_PRIORITY)
    with process.stop_on_signals() as stop, settings as notes:
        if args.pace == "realtime":
            warm.rehearse_plant(lambda: world_of(args), firmware_of(profile_of(choices_of(args))))
        for note in notes:
            print(f"note: {note}", flush=True)
        link = _link(args)
        try:
            with warm.counted_compilations() as compiled:
                lasting.write(args.memory, _memory_of(world))
                drive = _drive_granting if args.pace == "lockstep" else _drive
                outcome = drive(args, world, link, stop)
        finally:
            link.close()
        lasting.write(args.memory, _memory_of(world))
        if outcome is None:
            return 0
        late = outcome.loop[:, 0].max(initial=0) / 1e6
        print(
            f"plant ends ({outcome.reason}) after {world.now_ns * 1e-9:.2f} s"
            + (f", at most {late:.1f} ms late" if len(outcome.loop) else ""),
            flush=True,
        )
        if outcome.refused:
            print(
                f"note: {outcome.refused} frames with identifiers of the ECU were ignored: too "
                "long, or too many at once",
                flush=True,
            )
        if args.record is not None:
            about = {
                "reason": outcome.reason,
                "not_valid": outcome.not_valid,
                "start_ns": outcome.start_ns,
                "end_ns": outcome.end_ns,
                "wall_ns": outcome.wall_ns,
                "notes": notes,
                "cpu": args.cpu,
                "sent": link.sent,
                "received": link.received,
                "failed": link.failed,
                "compilations": compiled.count,
                "pace": args.pace,
                "bus": bus_record.about_of(link.record),
                "not_authentic": world.refused,
            }
            record = plant_record.PlantRecord(
                signals=world.signals,
                frames=world.frames,
                ages=world.ages,
                commands=np.asarray(world.commands),
                loop=outcome.loop,
                about=about,
                bus=bus_record.entries_of(link.record),
            )
            with writing(args.record):
                archive.write(args.record, entries(record), compressed=False)
        if args.log is not None:
            logs.write_log(args.log, world.frames)
        if args.signals is not None:
            signal_files.write_signals(args.signals, world.signals)
    if outcome.not_valid:
        raise VerdictError(f"not valid: {outcome.not_valid}")
    return 0


def _drive(
    args: argparse.Namespace, world: World, link: Link, stop: process.Stop
) -> PlantOutcome | None:
    """Drive in step with the clock once an ECU is heard; None if stopped before."""
    firmware = firmware_of(profile_of(choices_of(args)))
    if args.wait > 0:
        print("plant waits for the ECU", flush=True)
        if not plant_loop.wait_for_ecu(link, stop=stop, timeout=args.wait, firmware=firmware):
            _check_stopped(args, stop)
            return None
    return plant_loop.run(
        world,
        link,
        stop=stop,
        duration_ns=_duration_ns(args, world),
        peer_timeout_ns=nanoseconds(peer_timeout(args), "--peer-timeout"),
        announce=lambda: print("plant runs", flush=True),
        firmware=firmware,
    )


def _drive_granting(
    args: argparse.Namespace, world: World, link: Link, stop: process.Stop
) -> PlantOutcome | None:
    """Drive in lock step with the ECU that answers; None if stopped before."""
    firmware = firmware_of(profile_of(choices_of(args)))
    idents = plant_loop.sent_by(firmware)
    channel = lockstep.GrantChannel(
        link,
        sends=lockstep.GRANT,
        hears=lockstep.ACKNOWLEDGEMENT,
        idents=idents.union(firmware.slots),
    )
    ecu = lockstep.GrantedEcu(
        link, channel, idents=idents, stop=stop, peer_timeout=peer_timeout(args)
    )
    print("plant waits for the ECU", flush=True)
    if not ecu.greet(args.wait or None):
        _check_stopped(args, stop)
        return None
    offset = 0
    if args.phase_ms is not None:
        offset = phase.offset_ns(world_of(args), 1000 * ecu.tick_us, round(1e6 * args.phase_ms))
    print("plant runs", flush=True)
    duration_ns = min(_duration_ns(args, world), world.duration_ns)
    return plant_loop.run_granting(world, ecu, stop=stop, duration_ns=duration_ns, offset_ns=offset)


def _duration_ns(args: argparse.Namespace, world: World) -> int:
    return nanoseconds(args.duration, "--duration") or world.duration_ns


def _check_stopped(args: argparse.Namespace, stop: process.Stop) -> None:
    if not stop.requested:
        raise CanrollError(f"no ECU found within {args.wait:g} s: start 'canroll ecu'")


def _memory_of(world: World) -> lasting.LastingCounts:
    """Return what the vehicle's nodes remember: the start that runs, and that of the ECU."""
    return lasting.LastingCounts(max(world.starts, 1), {ECU: world.ecu_starts})


def world_of(args: argparse.Namespace, memory: lasting.LastingCounts = lasting.FIRST) -> World:
    """Return the world that the options describe, at time 0, after the starts in ``memory``.

    Raises:
        CanrollError: an invalid name or number.
    """
    choices = choices_of(args)
    vehicle = vehicles.load(chosen(choices, "vehicle"))
    settings = Run.of(
        choices, scenario=args.scenario, vehicle=vehicle, command=args.command_message
    )
    if outages(parse_all(settings.faults)):
        raise CanrollError(lockstep.POWER)
    starts, ecu_starts = memory.starts + 1, memory.senders.get(ECU, 0)
    return build_world(settings, enabled=not args.passive, starts=starts, ecu_starts=ecu_starts)


def _link(args: argparse.Namespace) -> Link:
    fd = firmware_of(profile_of(choices_of(args))).fd
    if has_bus(args):
        return open_link(args, fd)
    if fd:
        refuse(args, "serve", own_bus.NOT_SERVED)
        options = own_bus.fd_options()
        link = open_link(parsed_options(options), fd)
        print(f"serving {' '.join(options)}", flush=True)
        return link
    server = own_bus.serve(args.serve)
    if not is_loopback(args.serve.rpartition(":")[0]):
        print(f"note: anyone who can reach {args.serve} can drive this plant", flush=True)
    print(f"serving {server.options}", flush=True)
    return server
