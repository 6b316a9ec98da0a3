"""Handling tests of one vehicle, without and with control side by side: tables, lines, a figure."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.firmware.calibration import VALVES
from canroll.handling.controlled_handling import Control, Pair, limit_of
from canroll.handling.response_figure import Panel
from canroll.plant_sim.world.handling import LINEAR_ACCELERATION as UP_TO
from canroll.plant_sim.world.handling import (
    FrequencyResponse,
    SteadyState,
    Understeer,
    characteristic_speed,
)
from canroll.report.page import PageTable
from canroll.setup.controller import Controller
from canroll.vehicles import Vehicle

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
NONE = "–"
Row = NDArray[np.complex128]


def turns(vehicle: Vehicle, pair: Pair[Understeer]) -> PageTable:
    """Return the steady turns of each vehicle; "–": it does not hold this turn."""
    rows = []
    for number, states in enumerate(zip_longest(*(run.states for run in pair.runs.values()))):
        state = next(state for state in states if state is not None)
        figures = zip(*(_figures(vehicle, state) for state in states), strict=True)
        cells = [f"{3.6 * state.speed:.1f}", f"{state.lateral_acceleration:.2f}"]
        cells += [text for texts in figures for text in texts]
        if pair.controlled is not None:
            cells += _moment(None if states[1] is None else pair.control[number])
        rows.append(cells)
    title, more, last = "steady turns", [], []
    if pair.controlled is not None:
        title += (
            ", and the moment of the actuators with the front axle's share "
            f"({100 * vehicle.geometry.static_front_share:.0f} % of the static load)"
        )
        more, last = ["controlled"], ["moment (N·m)", "front (%)", "at its limit"]
    heads = ("steering wheel (°)", "roll (°)", "sideslip (°)")
    columns = [text for head in heads for text in (head, *more)]
    return PageTable(title, ("km/h", "a_y (m/s²)", *columns, *last), rows)


def _figures(vehicle: Vehicle, state: SteadyState | None) -> tuple[str, str, str]:
    if state is None:
        return NONE, NONE, NONE
    wheel = degrees(state.steer) * vehicle.steering.ratio
    return f"{wheel:.1f}", f"{degrees(state.roll):.2f}", f"{degrees(state.sideslip):.2f}"


def _moment(control: Control | None) -> list[str]:
    if control is None:
        return [NONE] * 3
    share = control.front_share
    front = NONE if share is None else f"{100 * share:.0f}"
    return [f"{sum(control.moment):.0f}", front, _percent(control.at_limit)]


def gradients(vehicle: Vehicle, pair: Pair[Understeer]) -> PageTable:
    """Return the gradients of the turns in the linear range, of each vehicle."""
    runs = pair.runs.values()
    speeds = [characteristic_speed(vehicle, each.gradient) for each in runs]
    return PageTable(
        f"gradients up to {UP_TO:g} m/s² (understeer of the linear car "
        f"{pair.passive.closed_form:.3f} °/g)",
        ("", *pair.runs),
        [
            ("understeer gradient at the road wheels (°/g)", *(f"{e.gradient:.3f}" for e in runs)),
            (
                "characteristic speed (km/h)",
                *("none" if each is None else f"{3.6 * each:.1f}" for each in speeds),
            ),
            ("roll gradient (°/g)", *(f"{each.roll_gradient:.2f}" for each in runs)),
            ("largest steady acceleration (m/s²)", *(f"{each.limit:.2f}" for each in runs)),
        ],
    )


def per_steering_wheel(result: FrequencyResponse, vehicle: Vehicle) -> dict[str, Row]:
    """Return the responses per steering-wheel angle (rad), SI units, by quantity."""
    return {name: getattr(result, name) / vehicle.steering.ratio for name in QUANTITIES}


def gain_and_phase(frequency: NDArray[np.float64], row: Row) -> dict[str, Any]:
    """Return a response as ``--json`` prints it."""
    return {
        "gain": np.abs(row).tolist(),
        "phase_deg": np.degrees(np.unwrap(np.angle(row))).tolist(),
        **_peak(frequency, row),
    }


def _peak(frequency: NDArray[np.float64], row: Row) -> dict[str, float]:
    """Return the largest gain at the tested frequencies, and where it is."""
    at = int(np.argmax(np.abs(row)))
    return {"peak": float(np.abs(row[at])), "peak_hz": float(frequency[at])}


def over_frequency(
    quantity: str, frequency: NDArray[np.float64], rows: Mapping[str, Mapping[str, Row]]
) -> PageTable:
    """Return gain and phase of a response of each vehicle, peaks in the title."""
    head, factor = QUANTITIES[quantity]
    gains = {name: each[quantity] * factor for name, each in rows.items()}
    peaks = [_peak(frequency, row) for row in gains.values()]
    words = [f"{peak['peak']:.4f} at {peak['peak_hz']:.2f} Hz" for peak in peaks]
    columns = []
    for row in gains.values():
        columns.append([f"{gain:.4f}" for gain in np.abs(row)])
        columns.append([f"{phase:.0f}" for phase in np.degrees(np.unwrap(np.angle(row)))])
    return PageTable(
        f"{head}: peak {', with control '.join(words)}",
        ("Hz", *(text for name in rows for text in (name, "phase (°)"))),
        list(zip([f"{each:.2f}" for each in frequency], *columns, strict=True)),
    )


def panels(rows: Mapping[str, Mapping[str, Row]]) -> list[list[Panel]]:
    """Return the responses of each vehicle, dashed without control, to be drawn."""
    styles = {"passive": "--", "controlled": "-"}
    return [
        [
            Panel(
                head,
                "gain per steering-wheel angle",
                {
                    name: (
                        styles[name],
                        np.abs(each[quantity] * factor),
                        np.degrees(np.unwrap(np.angle(each[quantity]))),
                    )
                    for name, each in rows.items()
                },
            )
            for quantity, (head, factor) in QUANTITIES.items()
        ]
    ]


def limits(
    controller: Controller,
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


def _percent(share: float) -> str:
    """Return a share in words; what is not zero is not shown as zero."""
    return f"{100 * share:.0f} %" if share == 0.0 or share >= 0.01 else "< 1 %"
