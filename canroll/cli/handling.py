"""``canroll handling circle|response|limit``: tests of a vehicle without and with control."""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, Generic, TypeVar

from canroll import vehicles
from canroll.cli import terminal
from canroll.cli.options import choices_of
from canroll.cli.run_parsers import CONTROL
from canroll.cli.terminal import Part
from canroll.errors import CanrollError
from canroll.handling import handling_view, vehicle_tests
from canroll.handling import linear_response as linear
from canroll.handling import linear_response_view as linear_view
from canroll.handling.controlled_handling import Pair, compared, limit_of
from canroll.handling.response_figure import draw
from canroll.plant_sim import bodies
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world import handling
from canroll.plant_sim.world.handling import LINEAR_ACCELERATION as UP_TO
from canroll.plant_sim.world.handling import Drive
from canroll.runs import experiment
from canroll.setup.choices import PASSIVE, chosen
from canroll.setup.controller import Controller
from canroll.vehicles import Vehicle

LARGEST_ACCELERATION = 12.0
"""Above the grip of any tyre on a road (m/s²)."""
Test = TypeVar("Test")


@dataclass(frozen=True, slots=True)
class Driven(Generic[Test]):
    """A test that was driven: by which vehicle, in words and as JSON, with which controller."""

    vehicle: Vehicle
    title: str
    about: Mapping[str, Any]
    warnings: Sequence[str]
    pair: Pair[Test]
    controller: Controller | None = None


def run(args: argparse.Namespace) -> int:
    """Drive the test and print it; 0 whatever it finds."""
    if (args.what == "limit") != (args.scenario is not None):
        raise CanrollError(
            "limit needs a manoeuvre: canroll handling limit SCENARIO"
            if args.scenario is None
            else f"{args.scenario}: canroll handling {args.what} drives its own manoeuvre: omit it"
        )
    return {"circle": circle, "response": response, "limit": limit}[args.what](args)


def driven(
    args: argparse.Namespace,
    scenario: str,
    test: Callable[[Vehicle, Drive], Test],
    **more: Any,  # noqa: ANN401
) -> Driven[Test]:
    """Drive a test without control, and with it where a law or calibration is given.

    ``more``: choices of its runs.
    """
    choices = choices_of(args)
    if not any(name in args.given for name in CONTROL):
        plant = chosen(choices, "plant")
        vehicle, drive = vehicle_tests.alone(chosen(choices, "vehicle"), plant, args.load)
        body = bodies.body(plant)
        about: dict[str, Any] = {"vehicle": vehicle.name, "plant": body.name}
        title = f"{vehicle.title}, {body.name} plant"
        return Driven(vehicle, title, about, [*body.left_out(vehicle)], Pair(test(vehicle, drive)))
    if choices.get("law") == PASSIVE:
        raise CanrollError(f"--law {PASSIVE} has no control: omit it")
    settings, controller = experiment.plan(scenario, **choices, **more)
    vehicle = vehicle_tests.loaded(settings.vehicle, args.load)
    settings = replace(settings, vehicle=vehicle)
    with terminal.progress(quiet=args.json) as progress:
        pair = compared(settings, controller, partial(test, vehicle), progress)
    about = {
        **settings.vehicles,
        "plant": settings.plant,
        "law": settings.law_name,
        "actuator": settings.actuator,
        "bus": settings.bus,
        "seed": settings.seed,
        "command_limit": limit_of(controller.record),
        "static_front_share": vehicle.geometry.static_front_share,
        "warnings": list(controller.warnings),
        "control": [asdict(each) | {"front_share": each.front_share} for each in pair.control],
    }
    title = (
        f"{settings.vehicle_name}, {settings.plant} plant, without control and with "
        f"{settings.law_name} on {settings.actuator} over {settings.bus_name}"
    )
    return Driven(vehicle, title, about, controller.warnings, pair, controller)


def circle(args: argparse.Namespace) -> int:
    """Run the constant-radius test of ISO 4138."""
    test = driven(args, "constant_radius", partial(handling.constant_radius, radius=args.radius))
    runs = {
        name: asdict(result)
        | {"characteristic_speed": handling.characteristic_speed(test.vehicle, result.gradient)}
        for name, result in test.pair.runs.items()
    }
    data = {**test.about, "radius": args.radius, **runs}
    return terminal.emit(args, data, _circle(args.radius, test))


def _circle(radius: float, test: Driven[handling.Understeer]) -> Iterator[Part]:
    pair = test.pair
    yield f"{test.title}, circle of {radius:g} m"
    yield from terminal.warnings(test.warnings)
    yield from terminal.titled(handling_view.turns(test.vehicle, pair))
    yield from terminal.titled(handling_view.gradients(test.vehicle, pair))
    if pair.controlled is None or test.controller is None:
        return
    turns = [state.lateral_acceleration for state in pair.controlled.states]
    yield from handling_view.limits(test.controller, pair.control, turns, "turns", "m/s²")
    fitted = sum(lateral <= UP_TO for lateral in turns)
    if limited := sum(each.limited for each in pair.control[:fitted]):
        yield f"gradients of {fitted} turns, with control at such a limit in {limited} of them"


def response(args: argparse.Namespace) -> int:
    """Run the frequency-response test of ISO 7401, or linearise the plant."""
    vehicle_tests.check_speed(args.speed)
    if args.linear:
        return linearise(args)
    drive = partial(handling.frequency_response, speed=args.speed / 3.6)
    test = driven(args, "sine_sweep", drive, speed_kmh=args.speed)
    frequency, pair = test.pair.passive.frequency, test.pair
    rows = {
        name: handling_view.per_steering_wheel(result, test.vehicle)
        for name, result in pair.runs.items()
    }
    lines: list[str] = []
    if test.controller is not None:
        lines += handling_view.limits(test.controller, pair.control, frequency, "sines", "Hz")
    where = f"{test.title}, {args.load}, {args.speed:g} km/h"
    if args.out is not None:
        title = "\n".join([where, *lines])
        lines.append(f"\nwritten: {draw(frequency, handling_view.panels(rows), title, args.out)}")
    gains = {
        name: {
            quantity: handling_view.gain_and_phase(frequency, row) for quantity, row in each.items()
        }
        for name, each in rows.items()
    }
    asked = {"load": args.load, "speed_kmh": args.speed, "frequency_hz": frequency.tolist()}
    tables = (
        terminal.titled(handling_view.over_frequency(quantity, frequency, rows))
        for quantity in handling_view.QUANTITIES
    )
    parts: list[Part] = [f"{where}, per steering-wheel angle", *terminal.warnings(test.warnings)]
    parts += [part for table in tables for part in table]
    return terminal.emit(args, {**test.about, **asked, **gains}, [*parts, *lines])


def linearise(args: argparse.Namespace) -> int:
    """Linearise the plant about straight running or a steady curve."""
    lateral = 0.0 if args.lateral_acceleration is None else args.lateral_acceleration
    friction = 1.0 if args.friction is None else args.friction
    if not 0.0 <= lateral <= LARGEST_ACCELERATION:
        raise CanrollError(
            f"--lateral-acceleration {lateral:g} m/s²: must be 0 to {LARGEST_ACCELERATION:g} m/s²"
        )
    if not 0.05 <= friction <= 1.5:
        raise CanrollError(f"--friction {friction:g}: must be 0.05 to 1.5")
    choices = choices_of(args)
    body = bodies.own_body(chosen(choices, "plant"), "a test of vehicles")
    vehicle = vehicle_tests.loaded(vehicles.load(chosen(choices, "vehicle")), args.load)
    answer = linear.linear_response(
        vehicle,
        body,
        speed=args.speed / 3.6,
        lateral_acceleration=lateral,
        friction=friction,
    )
    curve = f"steady curve of {lateral:g} m/s², friction {friction:g}"
    where = f"{vehicle.name}, {args.load}, {body.name} plant, {args.speed:g} km/h, "
    where += curve if lateral else "straight ahead"
    parts: list[Part] = [where, linear_view.trim_of(answer)]
    parts += [part for table in linear_view.tables(answer) for part in terminal.titled(table)]
    if answer.distance is None:
        parts.append(f"\nno design model at this trim: {answer.why_not}")
    if args.out is not None:
        path = draw(linear.FREQUENCIES, linear_view.panels(answer), where, args.out)
        parts.append(f"\nwritten: {path}")
    asked = {
        "vehicle": vehicle.name,
        "plant": body.name,
        "load": args.load,
        "speed_kmh": args.speed,
        "lateral_acceleration": lateral,
        "friction": friction,
    }
    return terminal.emit(args, asked | linear.to_json(answer), parts)


def limit(args: argparse.Namespace) -> int:
    """Bisect the entry speed; print the limits and what limited them."""
    result = vehicle_tests.limit(
        args.scenario,
        low_kmh=args.low,
        high_kmh=args.high,
        tolerance_kmh=args.tolerance,
        **choices_of(args),
    )
    settings = result.settings
    title = f"{maneuvers.title(settings.scenario)}, {settings.vehicle.name}, {settings.plant} plant"
    lines = [f"  {name:11}{one.sentence}" for name, one in result.runs.items()]
    return terminal.emit(args, result.to_json(), [title, *lines])
