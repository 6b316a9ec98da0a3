"""``canroll response``: yaw and roll frequency response to steering (ISO 7401), passive vehicle."""

import argparse
import json
from math import degrees

from canroll.errors import CanrollError
from hil.cli.passive_test import add_vehicle_options, vehicle_and_body


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "response",
        help="yaw and roll frequency response to steering (ISO 7401)",
        description="Steer in sines of rising frequency; yaw rate, lateral acceleration and roll "
        "angle per steering-wheel angle.",
    )
    add_vehicle_options(parser)
    parser.add_argument("--speed", type=float, default=100.0, metavar="KMH", help="default: 100")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the test and print its table."""
    import numpy as np  # noqa: PLC0415 - loads compiled kernels

    from plant_sim.world import handling  # noqa: PLC0415

    if not 20.0 <= args.speed <= 200.0:
        raise CanrollError(f"speed {args.speed:g} km/h: the test is driven at 20 to 200 km/h")
    vehicle, body = vehicle_and_body(args)
    result = handling.frequency_response(vehicle, body, speed=args.speed / 3.6)
    rows = {
        "yaw_rate": result.yaw_rate / vehicle.steering.ratio,
        "lateral_acceleration": result.lateral_acceleration / vehicle.steering.ratio,
        "roll": result.roll / vehicle.steering.ratio,
    }
    if args.json:
        answer = {"vehicle": vehicle.name, "plant": args.plant, "speed_kmh": args.speed}
        answer |= {"frequency_hz": result.frequency.tolist()}
        for name, row in rows.items():
            answer[name] = {
                "gain": np.abs(row).tolist(),
                "phase_deg": np.degrees(np.unwrap(np.angle(row))).tolist(),
            }
        print(json.dumps(answer))
        return 0
    print(f"{vehicle.title}\n{args.speed:g} km/h, {args.plant} plant, per steering-wheel angle\n")
    print("    Hz   yaw rate 1/s  phase °   a_y m/s²/°  phase °   roll °/°  phase °")
    phases = [np.degrees(np.unwrap(np.angle(row))) for row in rows.values()]
    for i, frequency in enumerate(result.frequency):
        gains = [abs(row[i]) for row in rows.values()]
        print(
            f"{frequency:6.2f}{gains[0]:15.4f}{phases[0][i]:9.0f}"
            f"{gains[1] / degrees(1):13.4f}{phases[1][i]:9.0f}{gains[2]:11.4f}{phases[2][i]:9.0f}"
        )
    return 0
