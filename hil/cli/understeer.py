"""``canroll understeer``: the constant-radius test of ISO 4138 on the passive vehicle."""

import argparse
import json
from dataclasses import asdict
from math import degrees

from hil.cli.passive_test import add_vehicle_options, vehicle_and_body


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "understeer",
        help="understeer and roll gradient on a circle (ISO 4138)",
        description="Drive a circle faster and faster; steering, roll and sideslip of each steady "
        "turn, and the gradients of their linear part.",
    )
    add_vehicle_options(parser)
    parser.add_argument("--radius", type=float, default=100.0, metavar="M", help="default: 100")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the test and print its table."""
    from plant_sim.world import handling  # noqa: PLC0415 - loads compiled kernels

    vehicle, body = vehicle_and_body(args)
    result = handling.constant_radius(vehicle, body, radius=args.radius)
    if args.json:
        print(json.dumps({"vehicle": vehicle.name, "plant": args.plant, **asdict(result)}))
        return 0
    print(f"{vehicle.title}\ncircle of {args.radius:g} m, {args.plant} plant\n")
    print("speed km/h   a_y m/s²   steering wheel °   roll °   sideslip °")
    for state in result.states:
        print(
            f"{state.speed * 3.6:10.1f}{state.lateral_acceleration:11.2f}"
            f"{degrees(state.steer) * vehicle.steering.ratio:19.1f}"
            f"{degrees(state.roll):9.2f}{degrees(state.sideslip):13.2f}"
        )
    print(
        f"\nundersteer gradient {result.gradient:.3f} °/g at the road wheels "
        f"(linear car {result.closed_form:.3f}), roll gradient {result.roll_gradient:.2f} °/g, "
        f"largest steady acceleration {result.limit:.2f} m/s²"
    )
    return 0
