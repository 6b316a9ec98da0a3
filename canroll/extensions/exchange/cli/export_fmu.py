"""``canroll export-fmu ecu|plant|bus|vehicle OUT.fmu``: parts of a run as FMUs."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from canroll import vehicles
from canroll.cli.options import DEFAULT_SCENARIO, choices_of
from canroll.cli.parser import check_mode
from canroll.cli.terminal import show, warnings
from canroll.errors import CanrollError
from canroll.extensions.exchange import body_fmu, bus_fmu, plant_fmu
from canroll.extensions.exchange.fmu import ecu
from canroll.plant_sim.bodies import own_body
from canroll.plant_sim.can_bus import NODES, Node, make_network
from canroll.plant_sim.can_bus.kernel.network import add_node
from canroll.plant_sim.can_bus.network.recorded_profile import RecordedProfile
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world.world_parts import command_of
from canroll.runs.experiment import build_world, maneuver_of, plan, tick_offset_ns
from canroll.runs.virtual_time import RUN_TIME_NS
from canroll.setup.bus_frames import profile_of, refuse_authenticated
from canroll.setup.choices import chosen

MOST_FREE_NODES = 32


@dataclass(frozen=True, slots=True)
class FmuKind:
    """What can be exported: its writer, and whether it has to have the key."""

    write: Callable[[argparse.Namespace], str]
    authenticates: bool = False


def run(args: argparse.Namespace) -> int:
    """Write the FMU."""
    kind = KINDS[args.kind]
    check_mode(args, args.kind, why=f"it does not apply to the {args.kind}")
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
    settings, controller = plan(DEFAULT_SCENARIO, **choices_of(args))
    verified = controller.exportable(unverified=args.unverified)
    show(warnings(controller.warnings))
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
    given = choices_of(args)
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
    settings, _ = plan(args.scenario, **choices_of(args))
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
    given = choices_of(args)
    vehicle, model = vehicles.load(chosen(given, "vehicle")), chosen(given, "plant")
    speed = given.get("speed_kmh")
    maneuver = maneuvers.build(
        args.scenario,
        vehicle,
        None if speed is None else speed / 3.6,
        0,
    )
    title = f"{vehicle.name} at {3.6 * maneuver.speed:.4g} km/h"
    map_path = body_fmu.write(
        args.out, vehicle, own_body(model, "an exported vehicle"), maneuver, title=title
    )
    return f"{title}, {model}; its map: {map_path}"


KINDS = {
    "ecu": FmuKind(write_ecu, authenticates=True),
    "plant": FmuKind(write_plant, authenticates=True),
    "bus": FmuKind(write_bus),
    "vehicle": FmuKind(write_vehicle),
}
