"""``canroll plant``: the vehicle alone, in real time, on any python-can bus or its own."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import vehicles
from canroll.errors import CanrollError
from hil.cli.ecu import add_loop_options, add_prepare_option, nanoseconds
from hil.cli.options import add_choices, add_recording, add_scenario, choices_of
from hil.realtime import process
from hil.realtime.bus_link import Link, add_bus_arguments, has_bus, open_link
from hil.runs.choices import CHOICES, chosen

WORLD = tuple(name for name, choice in CHOICES.items() if choice.of == "world")
"""What a run can be asked for that concerns the plant."""

if TYPE_CHECKING:
    from plant_sim.world.world import World


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "plant",
        help="the vehicle alone, on any python-can interface",
        description="Simulate the vehicle in real time for an ECU on a CAN bus.",
    )
    add_scenario(parser)
    add_bus_arguments(parser)
    parser.add_argument(
        "--serve",
        metavar="HOST:PORT",
        default="127.0.0.1:29536",
        help="without -i: the plant's own bus, for -i socketcand (default: %(default)s)",
    )
    add_choices(parser, (*WORLD, "duration"))
    parser.add_argument(
        "--command",
        dest="command_message",
        metavar="MESSAGE",
        help="what commands the actuators, where they take several messages",
    )
    parser.add_argument(
        "--passive", action="store_true", help="the actuators acknowledge and do nothing"
    )
    parser.add_argument(
        "--wait",
        type=float,
        default=60.0,
        metavar="S",
        help="for the first frame of the ECU, 0: start at once (default: %(default)g)",
    )
    add_loop_options(parser)
    add_prepare_option(parser)
    add_recording(parser)
    parser.add_argument("--record", type=Path, metavar="FILE", help=argparse.SUPPRESS)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Simulate until the manoeuvre is over, the ECU is lost or a signal comes."""
    from hil.realtime import plant_loop, plant_record  # noqa: PLC0415
    from hil.realtime.hardware import bus_record  # noqa: PLC0415
    from hil.report.run_folder import check_parent  # noqa: PLC0415
    from hil.runs import logs, signal_files  # noqa: PLC0415 - loads compiled kernels

    for path, check in ((args.log, logs.check_suffix), (args.signals, signal_files.check_suffix)):
        if path is not None:
            check_parent(check(path))
    peer_timeout = nanoseconds(args.peer_timeout, "--peer-timeout")
    duration = nanoseconds(args.duration, "--duration")
    # compiled before the clock runs: this world is thrown away
    world_of(args).advance(plant_loop.STEP_NS)
    if args.prepare:
        return 0
    world = world_of(args)
    with process.stop_on_signals() as stop:
        notes = process.prepare(cpu=args.cpu, priority=process.PLANT_PRIORITY)
        for note in notes:
            print(f"note: {note}", flush=True)
        link = _link(args)
        try:
            if args.wait > 0:
                print("plant waits for the ECU", flush=True)
                if not plant_loop.wait_for_ecu(link, stop=stop, timeout=args.wait):
                    if stop.requested:
                        return 0
                    raise CanrollError(f"no ECU within {args.wait:g} s: start 'canroll ecu'")
            print("plant runs", flush=True)
            outcome = plant_loop.run(
                world,
                link,
                stop=stop,
                duration_ns=duration or world.duration_ns,
                peer_timeout_ns=peer_timeout,
            )
        finally:
            link.close()
        late = outcome.loop[:, 0].max() / 1e6
        print(
            f"plant ends ({outcome.reason}) after {world.now_ns * 1e-9:.2f} s, "
            f"at most {late:.1f} ms late",
            flush=True,
        )
        if args.record is not None:
            about = {
                "reason": outcome.reason,
                "start_ns": outcome.start_ns,
                "end_ns": outcome.end_ns,
                "notes": notes,
                "cpu": args.cpu,
                "sent": link.sent,
                "received": link.received,
                "failed": link.failed,
                "bus": bus_record.about_of(link.record),
            }
            plant_record.save(
                args.record, world, outcome, about, bus_record.entries_of(link.record)
            )
        if args.log is not None:
            logs.write_log(args.log, world.frames)
        if args.signals is not None:
            signal_files.write_signals(args.signals, world.signals)
    return 0


def world_of(args: argparse.Namespace) -> "World":
    """Return the world that the options describe, at time 0.

    Raises:
        CanrollError: a name or number that cannot be.
    """
    from hil.runs import conditions  # noqa: PLC0415
    from plant_sim import can_bus  # noqa: PLC0415
    from plant_sim.driving import maneuvers  # noqa: PLC0415
    from plant_sim.world.world import World  # noqa: PLC0415

    choices = choices_of(args)
    vehicle = vehicles.load(chosen(choices, "vehicle"))
    speed = maneuvers.default_speed(args.scenario, vehicle)
    if args.speed_kmh is not None:
        speed = args.speed_kmh / 3.6
    seed = chosen(choices, "seed")
    sensors, actuators = conditions.options(
        choices.get("faults", ()), choices.get("conditions", {})
    )
    return World(
        vehicle=vehicle,
        body=chosen(choices, "plant"),
        actuator=chosen(choices, "actuator"),
        command=args.command_message,
        maneuver=maneuvers.build(args.scenario, vehicle, speed, seed, **choices.get("options", {})),
        profile=can_bus.load_profile(chosen(choices, "bus")),
        seed=seed,
        enabled=not args.passive,
        sensors=sensors,
        actuators=actuators,
    )


def _link(args: argparse.Namespace) -> Link:
    if has_bus(args):
        return open_link(args)
    from hil.realtime import own_bus  # noqa: PLC0415

    server = own_bus.serve(args.serve)
    print(f"serving {server.options}", flush=True)
    return server
