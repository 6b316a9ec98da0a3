"""``canroll limit``, ``understeer``, ``response`` and ``severe``: tests of vehicles."""

import argparse
import json
import sys
from dataclasses import asdict
from math import degrees

import numpy as np

import vehicles
from canroll.cli import handling_pair, terminal
from canroll.cli.cases import driven
from canroll.cli.options import choices_of
from canroll.cli.run_parsers import CONTROL
from canroll.errors import CanrollError
from canroll.handling import vehicle_tests as handling_study
from canroll.handling.linear_response import linear_response, to_json
from canroll.handling.linear_response_view import draw, tables, trim_of
from canroll.report.page import PageTable
from canroll.report.run_folder import write_page
from canroll.report.staging import page_folder
from canroll.setup.choices import chosen
from canroll.studies import severe as severe_manoeuvres
from plant_sim import bodies
from plant_sim.bodies.ports import Body
from plant_sim.driving import maneuvers
from plant_sim.world import handling
from vehicles import Vehicle
from vehicles.unladen import unladen

LARGEST_ACCELERATION = 12.0
"""Above the grip of any tyre on a road (m/s²)."""


def _vehicle_and_body(args: argparse.Namespace) -> tuple[Vehicle, Body]:
    """Return the requested vehicle and the body that simulates it."""
    return vehicles.load(chosen(choices_of(args), "vehicle")), bodies.own_body(
        chosen(choices_of(args), "plant"), "a test of vehicles"
    )


def _with_control(args: argparse.Namespace) -> bool:
    """Whether the controlled vehicle is driven as well."""
    return any(name in args.given for name in CONTROL)


def understeer(args: argparse.Namespace) -> int:
    """Run the constant-radius test of ISO 4138 and print its table."""
    vehicle, body = _vehicle_and_body(args)
    if _with_control(args):
        return handling_pair.understeer(args)
    result = handling.constant_radius(vehicle, handling.passive(vehicle, body), radius=args.radius)
    if args.json:
        print(json.dumps({"vehicle": vehicle.name, "plant": body.name, **asdict(result)}))
        return 0
    terminal.show_warnings(body.left_out(vehicle))
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
    """Run the frequency-response test of ISO 7401 and print its table, or linearise."""
    handling_study.check_speed(args.speed)
    vehicle, body = _vehicle_and_body(args)
    if _with_control(args):
        return handling_pair.response(args)
    if args.load == "empty":
        vehicle = unladen(vehicle)
    if args.linear:
        return _linear(args, vehicle, body)
    result = handling.frequency_response(
        vehicle, handling.passive(vehicle, body), speed=args.speed / 3.6
    )
    rows = handling_pair.per_steering_wheel(result, vehicle)
    if args.json:
        answer = {"vehicle": vehicle.name, "plant": body.name, "speed_kmh": args.speed}
        answer |= {"load": args.load, "frequency_hz": result.frequency.tolist()}
        for name, row in rows.items():
            answer[name] = handling_pair.gain_and_phase(row)
        print(json.dumps(answer))
        return 0
    print(
        f"{vehicle.title}, {args.load}\n"
        f"{args.speed:g} km/h, {body.name} plant, per steering-wheel angle\n"
    )
    print("    Hz   yaw rate 1/s  phase °   a_y m/s²/°  phase °   roll °/°  phase °")
    phases = [np.degrees(np.unwrap(np.angle(row))) for row in rows.values()]
    for i, frequency in enumerate(result.frequency):
        gains = [abs(row[i]) for row in rows.values()]
        print(
            f"{frequency:6.2f}{gains[0]:15.4f}{phases[0][i]:9.0f}"
            f"{gains[1] / degrees(1):13.4f}{phases[1][i]:9.0f}{gains[2]:11.4f}{phases[2][i]:9.0f}"
        )
    return 0


def _linear(args: argparse.Namespace, vehicle: Vehicle, body: Body) -> int:
    """Linearise ``body``, print and write the requested results, and return 0."""
    lateral = 0.0 if args.lateral_acceleration is None else args.lateral_acceleration
    friction = 1.0 if args.friction is None else args.friction
    if not 0.0 <= lateral <= LARGEST_ACCELERATION:
        raise CanrollError(
            f"--lateral-acceleration {lateral:g} m/s²: must be 0 to {LARGEST_ACCELERATION:g} m/s²"
        )
    if not 0.05 <= friction <= 1.5:
        raise CanrollError(f"--friction {friction:g}: must be 0.05 to 1.5")
    answer = linear_response(
        vehicle,
        body,
        speed=args.speed / 3.6,
        lateral_acceleration=lateral,
        friction=friction,
    )
    where = f"{vehicle.name}, {args.load}, {body.name} plant, {args.speed:g} km/h, " + (
        f"steady curve of {lateral:g} m/s², friction {friction:g}" if lateral else "straight ahead"
    )
    if args.out is not None:
        draw(answer, where, args.out / handling_pair.PICTURE)
    if args.json:
        asked = {
            "vehicle": vehicle.name,
            "plant": body.name,
            "load": args.load,
            "speed_kmh": args.speed,
            "lateral_acceleration": lateral,
            "friction": friction,
        }
        print(json.dumps(asked | to_json(answer)))
        return 0
    print(f"{where}\n{trim_of(answer)}")
    for table in tables(answer):
        terminal.show_titled(table)
    if answer.distance is None:
        print(f"\nno design model at this trim: {answer.why_not}")
    if args.out is not None:
        print(f"\nwritten: {args.out / handling_pair.PICTURE}")
    return 0


def limit(args: argparse.Namespace) -> int:
    """Bisect without and with control; print both limits and what limited them; return 0."""
    result = handling_study.limit(
        args.scenario,
        low_kmh=args.low,
        high_kmh=args.high,
        tolerance_kmh=args.tolerance,
        **choices_of(args),
    )
    if args.json:
        print(json.dumps(result.to_json()))
        return 0
    settings = result.settings
    print(f"{maneuvers.title(settings.scenario)}, {settings.vehicle.name}, {settings.plant} plant")
    for name, one in result.runs.items():
        print(f"  {name:11}{one.sentence}")
    return 0


def severe(args: argparse.Namespace) -> int:
    """Drive the severe manoeuvres and print their table: Markdown where it is not a terminal."""
    out = page_folder(args.out)
    with driven(args, out) as cases:
        answer = severe_manoeuvres.study(
            runs=args.runs, spread=dict(args.spread), cases=cases, **choices_of(args)
        )
    data = write_page(out, "severe", {}, severe_manoeuvres.to_json(answer))
    if answer.note:
        print(f"note: {answer.note}", file=sys.stderr)
    if args.json:
        print(json.dumps(data))
    else:
        print(
            f"{answer.vehicles['vehicle']}, {answer.actuator}, bus {answer.bus}, {answer.runs} "
            f"vehicles, {answer.law} as designed, plain feedforward at its RMS moment of "
            f"{answer.effort:.0f} N·m, bar: {answer.bar:g} times the roll stiffness"
        )
        if sys.stdout.isatty():
            rows: list[tuple[str, ...]] = []
            for title, name, *figures in severe_manoeuvres.lines(answer):
                rows += [("",), (title,)] if title else []
                rows.append((name, *figures))
            terminal.show_table(PageTable("", ("", *severe_manoeuvres.HEAD[2:]), rows))
        else:
            print("\n".join(severe_manoeuvres.markdown(answer)))
    return 0
