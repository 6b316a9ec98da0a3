"""``canroll export-fmu ecu|plant|bus|vehicle OUT.fmu``: parts of a run as FMUs."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import vehicles
from canroll.errors import CanrollError, VerdictError
from codegen.fmu import ecu
from hil.cli.options import DEFAULT_SCENARIO, add_choices, choices_of, path_named, scenario
from hil.cli.parsers import OF_A_DESIGN
from hil.cli.terminal import show_warnings
from hil.exchange import body_fmu, bus_fmu, plant_fmu
from hil.runs.choices import CHOICES, chosen
from hil.runs.experiment import build_world, maneuver_of, plan, tick_offset_ns
from hil.runs.frozen import profile_of, refuse_authenticated
from hil.runs.virtual_time import RUN_TIME_NS
from plant_sim.bodies import own_body
from plant_sim.can_bus import NODES, Node, make_network
from plant_sim.can_bus.kernel.network import add_node
from plant_sim.can_bus.recorded_profile import RecordedProfile
from plant_sim.driving import maneuvers
from plant_sim.world.world_parts import command_of

OF_A_PLANT = (
    *("calibration", *OF_A_DESIGN, "dbc", "map", "seed", "plant", "plant_vehicle"),
    *("speed_kmh", "options", "faults", "conditions"),
)
OF_A_VEHICLE = ("vehicle", "plant", "speed_kmh")
OF_A_BUS = ("bus", "dbc", "map", "seed", "actuator")
MOST_FREE_NODES = 32
OF_AN_ECU = ("calibration", *OF_A_DESIGN, "dbc", "map", "phase_ms", "seed")


@dataclass(frozen=True, slots=True)
class Kind:
    """What can be exported: its writer, the options that apply to it, who has to have the key."""

    write: Callable[[argparse.Namespace], str]
    choices: tuple[str, ...]
    authenticates: bool = False


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "export-fmu", help="export a part of a run as a Functional Mock-up Unit (FMI 3.0)"
    )
    parser.add_argument("kind", choices=tuple(KINDS), help="part of the run")
    parser.add_argument("out", type=path_named, metavar="OUT.fmu", help="file to write")
    parser.add_argument(
        "--ports",
        choices=ecu.PORTS,
        default=ecu.CAN,
        help="CAN terminals (fmi-ls-bus), or plain signals (default: %(default)s)",
    )
    names = dict.fromkeys(name for kind in KINDS.values() for name in kind.choices)
    add_choices(parser, [name for name in CHOICES if name in names])
    parser.add_argument(
        "--scenario",
        type=scenario,
        default=DEFAULT_SCENARIO,
        help="plant and vehicle: the manoeuvre (default: %(default)s)",
    )
    parser.add_argument(
        "--nodes",
        type=int,
        default=0,
        metavar="N",
        help="bus: further nodes, on the first segment (default: %(default)s)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the FMU."""
    kind = KINDS[args.kind]
    for name in choices_of(args):
        if name not in kind.choices:
            raise CanrollError(f"{CHOICES[name].option} does not apply to the {args.kind}: omit it")
    if kind.authenticates:
        refuse_authenticated(profile_of(choices_of(args)), f"export-fmu {args.kind}")
    out: Path = args.out
    if out.suffix != ".fmu":
        raise CanrollError(f"{out}: the name of an FMU ends in .fmu")
    described = kind.write(args)
    print(f"{out}: {described}")
    return 0


def write_ecu(args: argparse.Namespace) -> str:
    """Write the ECU with its calibration."""
    settings, controller = plan(DEFAULT_SCENARIO, **choices_of(args, OF_AN_ECU))
    verified = bool(controller.tables["design"]["verified"])
    if not verified and not args.unverified:
        raise VerdictError(
            f"{controller.law} for {controller.vehicle.name} is not verified: see 'canroll "
            "margins', or export it anyway with --unverified"
        )
    show_warnings(controller.warnings)
    title = (
        f"roll-control ECU, {controller.law} for {controller.vehicle.name}, "
        f"{controller.actuator}{'' if verified else ', NOT VERIFIED'}"
    )
    ecu.write(
        args.out,
        settings.firmware,
        controller.record,
        title=title,
        ports=args.ports,
        phase_ns=tick_offset_ns(settings),
        run_time_ns=RUN_TIME_NS,
    )
    return f"{title}; a tick of {1e3 * controller.tick:g} ms, {args.ports}"


def write_bus(args: argparse.Namespace) -> str:
    """Write the network of a bus profile with its background traffic."""
    if args.ports != ecu.CAN:
        raise CanrollError("a bus has CAN terminals: omit --ports")
    given = choices_of(args, OF_A_BUS)
    name, profile = str(chosen(given, "bus")), profile_of(given)
    if isinstance(profile, RecordedProfile):
        raise CanrollError(f"{name}: a log is no network: choose a bus profile or network file")
    command = command_of(str(chosen(given, "actuator")), None)
    network = make_network(profile, seed=int(chosen(given, "seed")), command=command)
    ports = {node: number for number, node in enumerate(NODES)}
    if not 0 <= args.nodes <= MOST_FREE_NODES:
        raise CanrollError(f"--nodes must be 0 to {MOST_FREE_NODES}, got {args.nodes}")
    for number in range(1, args.nodes + 1):
        ports[f"Node{number}"] = add_node(network, Node(f"Node{number}", policy="priority"))
    title = f"CAN bus {name} with {len(ports)} nodes"
    bus_fmu.write(args.out, network, ports, title=title)
    return f"{title}: {', '.join(ports)}"


def write_plant(args: argparse.Namespace) -> str:
    """Write vehicle, driver, actuators and sensors in a manoeuvre."""
    settings, _ = plan(args.scenario, **choices_of(args, OF_A_PLANT))
    command = command_of(settings.actuator, settings.command)
    title = f"{args.scenario} of {settings.vehicle.name} with {settings.actuator}"
    plant_fmu.write(
        args.out,
        build_world(settings, enabled=True).parts,
        own_body(settings.plant, "an exported plant"),
        maneuver_of(settings),
        actuator=settings.actuator,
        command=command,
        title=title,
        ports=args.ports,
    )
    return f"{title}, {settings.plant}, {args.ports}"


def write_vehicle(args: argparse.Namespace) -> str:
    """Write the vehicle alone, with the map that takes it as the plant again."""
    if args.ports != ecu.CAN:
        raise CanrollError("a vehicle has plain signals: omit --ports")
    given = choices_of(args, OF_A_VEHICLE)
    vehicle, model = vehicles.load(chosen(given, "vehicle")), chosen(given, "plant")
    speed = given.get("speed_kmh")
    maneuver = maneuvers.build(
        args.scenario,
        vehicle,
        None if speed is None else speed / 3.6,
        0,
    )
    title = f"{vehicle.name} at {3.6 * maneuver.speed:.4g} km/h"
    found = body_fmu.write(
        args.out, vehicle, own_body(model, "an exported vehicle"), maneuver, title=title
    )
    return f"{title}, {model}; its map: {found}"


KINDS = {
    "ecu": Kind(write_ecu, OF_AN_ECU, authenticates=True),
    "plant": Kind(write_plant, OF_A_PLANT, authenticates=True),
    "bus": Kind(write_bus, OF_A_BUS),
    "vehicle": Kind(write_vehicle, OF_A_VEHICLE),
}
