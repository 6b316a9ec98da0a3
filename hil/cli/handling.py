"""``canroll understeer`` and ``canroll response``: what a vehicle does without control."""

import argparse
import json
from dataclasses import asdict
from math import degrees

import numpy as np

import vehicles
from canroll.errors import CanrollError
from hil.cli.options import choices_of
from hil.runs.choices import chosen
from plant_sim import bodies
from plant_sim.bodies.ports import Body
from plant_sim.world import handling
from vehicles import Vehicle


def _vehicle_and_body(args: argparse.Namespace) -> tuple[Vehicle, Body]:
    """Return the vehicle that is asked for and the model that it is driven by."""
    return vehicles.load(chosen(choices_of(args), "vehicle")), bodies.body(args.plant)


def understeer(args: argparse.Namespace) -> int:
    """Run the constant-radius test of ISO 4138 and print its table."""
    vehicle, body = _vehicle_and_body(args)
    result = handling.constant_radius(vehicle, body, radius=args.radius)
    if args.json:
        print(json.dumps({"vehicle": vehicle.name, "plant": body.name, **asdict(result)}))
        return 0
    print(f"{vehicle.title}\ncircle of {args.radius:g} m, {body.name} plant\n")
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


def response(args: argparse.Namespace) -> int:
    """Run the frequency-response test of ISO 7401 and print its table."""
    if not 20.0 <= args.speed <= 200.0:
        raise CanrollError(f"speed {args.speed:g} km/h: the test is driven at 20 to 200 km/h")
    vehicle, body = _vehicle_and_body(args)
    result = handling.frequency_response(vehicle, body, speed=args.speed / 3.6)
    rows = {
        "yaw_rate": result.yaw_rate / vehicle.steering.ratio,
        "lateral_acceleration": result.lateral_acceleration / vehicle.steering.ratio,
        "roll": result.roll / vehicle.steering.ratio,
    }
    if args.json:
        answer = {"vehicle": vehicle.name, "plant": body.name, "speed_kmh": args.speed}
        answer |= {"frequency_hz": result.frequency.tolist()}
        for name, row in rows.items():
            answer[name] = {
                "gain": np.abs(row).tolist(),
                "phase_deg": np.degrees(np.unwrap(np.angle(row))).tolist(),
            }
        print(json.dumps(answer))
        return 0
    print(f"{vehicle.title}\n{args.speed:g} km/h, {body.name} plant, per steering-wheel angle\n")
    print("    Hz   yaw rate 1/s  phase °   a_y m/s²/°  phase °   roll °/°  phase °")
    phases = [np.degrees(np.unwrap(np.angle(row))) for row in rows.values()]
    for i, frequency in enumerate(result.frequency):
        gains = [abs(row[i]) for row in rows.values()]
        print(
            f"{frequency:6.2f}{gains[0]:15.4f}{phases[0][i]:9.0f}"
            f"{gains[1] / degrees(1):13.4f}{phases[1][i]:9.0f}{gains[2]:11.4f}{phases[2][i]:9.0f}"
        )
    return 0
