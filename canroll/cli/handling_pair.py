"""``canroll understeer`` and ``response`` without and with control, side by side."""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import zip_longest
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.cli import terminal
from canroll.cli.options import choices_of
from canroll.errors import CanrollError, writing
from canroll.handling.controlled_handling import Control, Pair, compared, limit_of
from canroll.report.page import PageTable
from canroll.runs import experiment
from canroll.runs.result import Settings
from canroll.setup.choices import PASSIVE
from canroll.setup.controller import PreparedController
from firmware.calibration import VALVES
from plant_sim.world import handling
from plant_sim.world.handling import LINEAR_ACCELERATION as UP_TO
from plant_sim.world.handling import FrequencyResponse, SteadyState, Understeer
from vehicles import Vehicle
from vehicles.unladen import unladen

PICTURE = "response.png"
TICKS = (0.2, 0.5, 1, 2, 4)
"""Frequencies named on the axis of the picture, Hz."""
KINDS = {
    "at_limit": "command at its limit",
    "actuators_limited": "an actuator does not follow its command",
    "inactive": "ECU not in mode ACTIVE",
}
"""What limits control, by the share of :class:`Control` that says so."""
QUANTITIES = {
    "yaw_rate": ("yaw rate (1/s)", 1.0),
    "lateral_acceleration": ("a_y (m/s² per °)", np.radians(1.0)),
    "roll": ("roll (°/°)", 1.0),
}
"""Responses with their heads, and what their gains per radian are multiplied with."""


def planned(
    args: argparse.Namespace, scenario: str, speed_kmh: float | None = None
) -> tuple[Settings, PreparedController]:
    """Return settings and controller of the runs.

    Raises:
        CanrollError: an invalid choice, or the law of no control.
    """
    choices = choices_of(args)
    if choices.get("law") == PASSIVE:
        raise CanrollError(f"--law {PASSIVE} has no control: omit it")
    return experiment.plan(scenario, speed_kmh=speed_kmh, **choices)


def understeer(args: argparse.Namespace) -> int:
    """Run the constant-radius test with both vehicles and print its tables."""
    settings, controller = planned(args, "constant_radius")
    vehicle = settings.vehicle
    test = partial(handling.constant_radius, vehicle, radius=args.radius)
    with terminal.progress(quiet=args.json) as progress:
        pair = compared(settings, controller, test, progress)
    if args.json:
        answer = driven(settings, controller) | {"radius": args.radius}
        for name, result in (("passive", pair.passive), ("controlled", pair.controlled)):
            speed = handling.characteristic_speed(vehicle, result.gradient)
            answer[name] = asdict(result) | {"characteristic_speed": speed}
        print(json.dumps(answer | {"control": [_control(each) for each in pair.control]}))
        return 0
    print(f"{_title(settings)}, circle of {args.radius:g} m")
    terminal.show_warnings(controller.warnings)
    terminal.show_titled(_turns(vehicle, pair))
    terminal.show_titled(_gradients(vehicle, pair))
    turns = [state.lateral_acceleration for state in pair.controlled.states]
    for line in limits(controller, pair.control, turns, "turns", "m/s²"):
        print(line)
    fitted = sum(lateral <= UP_TO for lateral in turns)
    limited = sum(each.limited for each in pair.control[:fitted])
    if limited:
        print(f"gradients of {fitted} turns, with control at such a limit in {limited} of them")
    return 0


def response(args: argparse.Namespace) -> int:
    """Run the frequency-response test with both vehicles, print its tables and draw them."""
    settings, controller = planned(args, "sine_sweep", args.speed)
    if args.load == "empty":
        settings = replace(settings, vehicle=unladen(settings.vehicle))
    vehicle = settings.vehicle
    test = partial(handling.frequency_response, vehicle, speed=args.speed / 3.6)
    with terminal.progress(quiet=args.json) as progress:
        pair = compared(settings, controller, test, progress)
    frequency = pair.passive.frequency
    rows = {
        "passive": per_steering_wheel(pair.passive, vehicle),
        "controlled": per_steering_wheel(pair.controlled, vehicle),
    }
    lines = list(limits(controller, pair.control, frequency, "sines", "Hz"))
    where = f"{_title(settings)}, {args.load}, {args.speed:g} km/h"
    if args.out is not None:
        draw(frequency, rows, "\n".join([where, *lines]), args.out / PICTURE)
    if args.json:
        answer = driven(settings, controller) | {"load": args.load, "speed_kmh": args.speed}
        answer["frequency_hz"] = frequency.tolist()
        for name, each in rows.items():
            answer[name] = {
                quantity: gain_and_phase(row) | _peak(frequency, row)
                for quantity, row in each.items()
            }
        print(json.dumps(answer | {"control": [_control(each) for each in pair.control]}))
        return 0
    print(f"{where}, per steering-wheel angle")
    terminal.show_warnings(controller.warnings)
    for quantity, (head, factor) in QUANTITIES.items():
        both = [each[quantity] * factor for each in rows.values()]
        terminal.show_titled(_over_frequency(head, frequency, both))
    for line in lines:
        print(line)
    if args.out is not None:
        print(f"\nwritten: {args.out / PICTURE}")
    return 0


def per_steering_wheel(
    result: FrequencyResponse, vehicle: Vehicle
) -> dict[str, NDArray[np.complex128]]:
    """Return the responses per steering-wheel angle (rad), SI units, by quantity."""
    return {name: getattr(result, name) / vehicle.steering.ratio for name in QUANTITIES}


def gain_and_phase(row: NDArray[np.complex128]) -> dict[str, Any]:
    """Return a response as ``--json`` prints it."""
    return {
        "gain": np.abs(row).tolist(),
        "phase_deg": np.degrees(np.unwrap(np.angle(row))).tolist(),
    }


def driven(settings: Settings, controller: PreparedController) -> dict[str, Any]:
    """Return what was driven, as ``--json`` prints it."""
    return {
        **settings.vehicles,
        "plant": settings.plant,
        "law": settings.law_name,
        "actuator": settings.actuator,
        "bus": settings.bus,
        "seed": settings.seed,
        "command_limit": limit_of(controller.record),
        "static_front_share": settings.vehicle.geometry.static_front_share,
        "warnings": list(controller.warnings),
    }


def limits(
    controller: PreparedController,
    control: Sequence[Control],
    places: Sequence[float] | NDArray[np.float64],
    manoeuvres: str,
    unit: str,
) -> Iterator[str]:
    """Yield in words what limits control, and where.

    ``places``: of the ``manoeuvres`` that have results, in their order and ``unit``.
    """
    largest = limit_of(controller.record)
    of = f" of {largest:.0f} {'mA' if controller.record.actuator == VALVES else 'N·m'}"
    for name, what in KINDS.items():
        shares = [getattr(each, name) for each in control[: len(places)]]
        where = [place for place, share in zip(places, shares, strict=True) if share > 0.0]
        if where:
            span = " to ".join(dict.fromkeys(f"{place:.2f}" for place in (where[0], where[-1])))
            yield (
                f"{what}{of if name == 'at_limit' else ''} in {len(where)} of {len(places)} "
                f"{manoeuvres}, {span} {unit}, {_percent(max(shares))} of the time at most"
            )


def _title(settings: Settings) -> str:
    return (
        f"{settings.vehicle_name}, {settings.plant} plant, without control and with "
        f"{settings.law_name} on {settings.actuator} over {settings.bus_name}"
    )


def _control(control: Control) -> dict[str, Any]:
    return asdict(control) | {"front_share": control.front_share}


def _percent(share: float) -> str:
    """Return a share in words; what is not zero is not shown as zero."""
    return f"{100 * share:.0f} %" if share == 0.0 or share >= 0.01 else "< 1 %"


def _turns(vehicle: Vehicle, pair: Pair[Understeer]) -> PageTable:
    """Return the steady turns of both vehicles; "–": one of them does not hold this turn."""
    rows = []
    for passive, controlled, control in zip_longest(
        pair.passive.states, pair.controlled.states, pair.control
    ):
        state = passive or controlled
        if state is None:
            break
        both = [_figures(vehicle, passive), _figures(vehicle, controlled)]
        share = None if controlled is None else control.front_share
        rows.append(
            (
                f"{3.6 * state.speed:.1f}",
                f"{state.lateral_acceleration:.2f}",
                *(text for texts in zip(*both, strict=True) for text in texts),
                "–" if controlled is None else f"{sum(control.moment):.0f}",
                "–" if share is None else f"{100 * share:.0f}",
                "–" if controlled is None else _percent(control.at_limit),
            )
        )
    heads = ("steering wheel (°)", "roll (°)", "sideslip (°)")
    return PageTable(
        "steady turns, and the moment of the actuators with the front axle's share "
        f"({100 * vehicle.geometry.static_front_share:.0f} % of the static load)",
        (
            *("km/h", "a_y (m/s²)"),
            *(text for head in heads for text in (head, "controlled")),
            *("moment (N·m)", "front (%)", "at its limit"),
        ),
        rows,
    )


def _figures(vehicle: Vehicle, state: SteadyState | None) -> tuple[str, str, str]:
    if state is None:
        return "–", "–", "–"
    wheel = degrees(state.steer) * vehicle.steering.ratio
    return f"{wheel:.1f}", f"{degrees(state.roll):.2f}", f"{degrees(state.sideslip):.2f}"


def _gradients(vehicle: Vehicle, pair: Pair[Understeer]) -> PageTable:
    both = pair.passive, pair.controlled
    speeds = [handling.characteristic_speed(vehicle, each.gradient) for each in both]
    return PageTable(
        f"gradients up to {UP_TO:g} m/s² (understeer of the linear car "
        f"{pair.passive.closed_form:.3f} °/g)",
        ("", "passive", "controlled"),
        [
            ("understeer gradient at the road wheels (°/g)", *(f"{e.gradient:.3f}" for e in both)),
            (
                "characteristic speed (km/h)",
                *("none" if each is None else f"{3.6 * each:.1f}" for each in speeds),
            ),
            ("roll gradient (°/g)", *(f"{each.roll_gradient:.2f}" for each in both)),
            ("largest steady acceleration (m/s²)", *(f"{each.limit:.2f}" for each in both)),
        ],
    )


def _peak(frequency: NDArray[np.float64], row: NDArray[np.complex128]) -> dict[str, float]:
    """Return the largest gain at the tested frequencies, and where it is."""
    at = int(np.argmax(np.abs(row)))
    return {"peak": float(np.abs(row[at])), "peak_hz": float(frequency[at])}


def _over_frequency(
    head: str, frequency: NDArray[np.float64], both: Sequence[NDArray[np.complex128]]
) -> PageTable:
    """Return gain and phase of a response without and with control, peaks in the title."""
    peaks = [_peak(frequency, row) for row in both]
    words = [f"{peak['peak']:.4f} at {peak['peak_hz']:.2f} Hz" for peak in peaks]
    phases = [np.degrees(np.unwrap(np.angle(row))) for row in both]
    rows = [
        (
            f"{frequency[i]:.2f}",
            *(
                text
                for row, phase in zip(both, phases, strict=True)
                for text in (f"{abs(row[i]):.4f}", f"{phase[i]:.0f}")
            ),
        )
        for i in range(len(frequency))
    ]
    return PageTable(
        f"{head}: peak {words[0]}, with control {words[1]}",
        ("Hz", "passive", "phase (°)", "controlled", "phase (°)"),
        rows,
    )


def draw(
    frequency: NDArray[np.float64],
    rows: Mapping[str, Mapping[str, NDArray[np.complex128]]],
    where: str,
    path: Path,
) -> None:
    """Write gains and phases of both vehicles as a PNG.

    Raises:
        CanrollError: the file cannot be written.
    """
    import matplotlib.figure  # noqa: PLC0415 - half a second that only a figure needs

    with matplotlib.rc_context({"font.size": 8, "axes.grid": True, "grid.alpha": 0.3}):
        figure = matplotlib.figure.Figure(figsize=(12, 6), layout="constrained")
        axes = figure.subplots(2, len(QUANTITIES), sharex=True, squeeze=False)
        for column, (quantity, (head, factor)) in enumerate(QUANTITIES.items()):
            gains, phases = axes[:, column]
            for name, style in (("passive", "--"), ("controlled", "-")):
                row = rows[name][quantity] * factor
                gains.plot(frequency, np.abs(row), style, label=name)
                phases.plot(frequency, np.degrees(np.unwrap(np.angle(row))), style)
            gains.set(xscale="log", ylim=(0.0, None), title=head)
            gains.set_xticks(TICKS, map(str, TICKS))
            gains.set_xticks([], minor=True)
            phases.set(xlabel="frequency (Hz)", ylabel="phase (°)")
        axes[0, 0].set_ylabel("gain per steering-wheel angle")
        axes[0, 0].legend()
        figure.suptitle(where)
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path, dpi=90, metadata={"Software": None})
