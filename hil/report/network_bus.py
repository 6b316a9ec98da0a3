"""``canroll bus`` for a network: response times by segment, and over its gateways."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from canroll.errors import VerdictError
from hil.report.bus_answer import (
    Delay,
    cells_of,
    check_ages,
    delay_json,
    delay_line,
    extremes,
    milliseconds,
)
from plant_sim.buses.profile import BusProfile
from plant_sim.buses.topology import BusSegment, Topology
from plant_sim.can_bus.ages import simulate_ages_of_routes
from plant_sim.can_bus.analysis import ErrorModel, worst_case_utilisation
from plant_sim.can_bus.delay_bounds import delay_bounds, loop_routes
from plant_sim.can_bus.holistic import Arrival, arrivals
from plant_sim.can_bus.routing import RoutedMessage
from plant_sim.can_bus.simulation import NetworkSimulation, SimulatedResponse, simulate_network

_MS = 1e-6
_ACTUATOR = "Actuator"
"""The node that applies the command."""


@dataclass(frozen=True, slots=True)
class NetworkAnswer:
    """Results of a network.

    ``arrivals``: of each message in ``routed``, by segment; ``path``: sensor, command, tick in ms.
    """

    topology: Topology
    routed: Sequence[RoutedMessage]
    arrivals: Sequence[dict[int, Arrival]]
    simulation: NetworkSimulation | None
    delay: Delay
    path: tuple[str, str, float]

    @property
    def failed(self) -> bool:
        """Whether a message has no bound."""
        bounds = [a.here for found in self.arrivals for a in found.values()]
        return self.delay.failed or any(b.bound_ns is None and b.covered for b in bounds)

    def on(self, segment: int) -> Iterator[int]:
        """Yield the numbers of the messages on a segment, the most urgent first."""
        here = (n for n, found in enumerate(self.arrivals) if segment in found)
        return iter(sorted(here, key=lambda n: self.routed[n].message.arbitration_key))

    def here(self, number: int, segment: int) -> SimulatedResponse | None:
        """Return the simulated times of a message on a segment, from its queueing there."""
        return None if self.simulation is None else self.simulation.arrivals[number][segment].here

    def whole(self, number: int, segment: int) -> SimulatedResponse | None:
        """Return the simulated times of a message to a segment, from its first queueing."""
        return None if self.simulation is None else self.simulation.arrivals[number][segment].whole

    def utilisation(self, segment: int) -> float:
        """Return the load of a segment with the longest frames."""
        place = self.topology.segments[segment]
        here = [self.arrivals[n][segment].here.message for n in self.on(segment)]
        return worst_case_utilisation(here, bitrate=place.bitrate, data_bitrate=place.data_bitrate)


def analyse(
    profile: BusProfile,
    path: tuple[str, str, float],
    *,
    errors: ErrorModel | None,
    duration_s: float,
    seed: int,
    worst_case_lengths: bool,
) -> NetworkAnswer:
    """Return bounds and simulated times of all messages of a network.

    Args:
        profile: the network, with our messages and its background.
        path: names of sensor and command message, and the tick in ms.
        errors: disturbed frames included in the bounds.
        duration_s: simulated time, 0: no simulation.
        seed: of payloads, jitter and latencies.
        worst_case_lengths: simulate classic frames with the maximum number of stuff bits.

    Raises:
        CanrollError: the sensor or the command is not a message of the network.
    """
    sensor, command, tick_ms = path
    topology = profile.network
    routed = loop_routes(profile, command=command, command_period_ms=tick_ms, seed=seed)
    bounds, reason = None, ""
    try:
        bounds = delay_bounds(
            profile, tick_ms=tick_ms, command=command, sensor=sensor, errors=errors
        )
    except VerdictError as error:
        reason = str(error)
    simulation, ages = None, np.array([], np.int64)
    if duration_s > 0.0:
        simulation = simulate_network(
            topology,
            routed,
            duration_s=duration_s,
            seed=seed,
            worst_case_lengths=worst_case_lengths,
        )
        ages = simulate_ages_of_routes(
            topology,
            routed,
            sensor,
            command,
            actuator_segment=topology.place(_ACTUATOR),
            duration_s=duration_s,
            seed=seed,
            worst_case_lengths=worst_case_lengths,
        )
    least, _, most = extremes(ages)
    return NetworkAnswer(
        topology,
        routed,
        arrivals(topology, routed, errors=errors),
        simulation,
        Delay(bounds, reason, bool(reason), least, most),
        path,
    )


def check(answer: NetworkAnswer) -> None:
    """Reject a bound that the simulation exceeds.

    Raises:
        VerdictError: it does.
    """
    check_ages(answer.delay)
    for number, segment in _arrivals(answer):
        arrival = answer.arrivals[number][segment]
        for seen, limit in (
            (answer.here(number, segment), arrival.here.bound_ns),
            (answer.whole(number, segment), arrival.greatest_ns),
        ):
            if seen is None or limit is None:
                continue
            _, _, most = extremes(seen.responses)
            if most > limit:
                name = answer.topology.segments[segment].name
                raise VerdictError(
                    f"{seen.name} on {name}: simulated response {most * _MS:.3f} ms above its bound"
                    f" {limit * _MS:.3f} ms"
                )


def _arrivals(answer: NetworkAnswer) -> Iterator[tuple[int, int]]:
    """Yield number and segment of every arrival."""
    return ((n, segment) for n, found in enumerate(answer.arrivals) for segment in found)


def as_json(answer: NetworkAnswer) -> dict[str, Any]:
    """Return the object that ``--json`` prints."""
    segments = {}
    for number, place in enumerate(answer.topology.segments):
        row: dict[str, Any] = {
            "bitrate": place.bitrate,
            "data_bitrate": place.data_bitrate,
            "utilisation": answer.utilisation(number),
            "messages": [_message(answer, n, number) for n in answer.on(number)],
        }
        if answer.simulation is not None:
            row["simulated_load"] = answer.simulation.loads[number]
        segments[place.name] = row
    return {"segments": segments, "delay": delay_json(answer.delay)}


def _message(answer: NetworkAnswer, number: int, segment: int) -> dict[str, Any]:
    arrival = answer.arrivals[number][segment]
    message = arrival.here.message
    return {
        "name": message.name,
        "id": message.ident,
        "sender": message.sender,
        "jitter_ms": message.jitter_ns * _MS,
        "response_bound_ms": milliseconds(arrival.here.bound_ns),
        **_extremes("response", answer.here(number, segment)),
        "way": [answer.topology.segments[s].name for s in _way(answer, number, segment)],
        "arrival_bound_ms": milliseconds(arrival.greatest_ns),
        **_extremes("arrival", answer.whole(number, segment)),
        "reason": arrival.here.reason or None,
    }


def _extremes(what: str, seen: SimulatedResponse | None) -> dict[str, float | None]:
    if seen is None:
        return {}
    keys = (f"{what}_min_ms", f"{what}_mean_ms", f"{what}_max_ms")
    return dict(zip(keys, map(milliseconds, extremes(seen.responses)), strict=True))


def _way(answer: NetworkAnswer, number: int, segment: int) -> list[int]:
    """Return the segments that a message passes to one of them."""
    found = answer.routed[number]
    return [found.home, *(hop.target for hop in found.way_to(segment))]


def show(answer: NetworkAnswer, name: str) -> None:
    """Print a table for every segment, one of the ways over gateways, and the lines below."""
    console = Console()
    for number, place in enumerate(answer.topology.segments):
        console.print(_segment_table(answer, name, number, place))
        line = f"load with the longest frames {answer.utilisation(number):.1%}"
        if answer.simulation is not None:
            line += f", simulated {answer.simulation.loads[number]:.1%}"
        console.print(line, highlight=False)
    if any(found.hops for found in answer.routed):
        console.print(_ways_table(answer))
    unbounded: dict[str, list[str]] = {}
    for n, segment in _arrivals(answer):
        bound = answer.arrivals[n][segment].here
        if bound.bound_ns is None:
            where = f"{bound.message.name} on {answer.topology.segments[segment].name}"
            unbounded.setdefault(bound.reason, []).append(where)
    for reason, places in unbounded.items():
        console.print(f"without a bound, {reason}: {', '.join(places)}", highlight=False)
    console.print(delay_line(answer.delay, *answer.path))


def _segment_table(answer: NetworkAnswer, name: str, number: int, place: BusSegment) -> Table:
    rate = f"{place.bitrate / 1000:g}"
    if place.data_bitrate:
        rate += f" and {place.data_bitrate / 1000:g}"
    table = _table(
        f"{name}, segment {place.name} at {rate} kbit/s: response times, ms",
        ("message", "id", "period", "jitter", "bound", "min", "99 %", "max"),
        left=1,
    )
    for n in answer.on(number):
        bound = answer.arrivals[n][number].here
        message = bound.message
        least, _, most, greatest = cells_of(answer.here(n, number))
        table.add_row(
            message.name,
            f"{message.ident:X}",
            f"{message.period_ns * _MS:.4g}",
            f"{message.jitter_ns * _MS:.4g}",
            _limit(bound.bound_ns),
            least,
            most,
            greatest,
        )
    return table


def _ways_table(answer: NetworkAnswer) -> Table:
    table = _table(
        "over gateways, from queueing by the first sender, ms",
        ("message", "way", "bound", "min", "mean", "99 %", "max"),
        left=2,
    )
    for n, segment in _arrivals(answer):
        way = _way(answer, n, segment)
        if len(way) > 1:
            table.add_row(
                answer.routed[n].message.name,
                " → ".join(answer.topology.segments[s].name for s in way),
                _limit(answer.arrivals[n][segment].greatest_ns),
                *cells_of(answer.whole(n, segment)),
            )
    return table


def _table(title: str, headings: Sequence[str], *, left: int) -> Table:
    """Return an empty table whose first columns are text."""
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="left" if place < left else "right")
    return table


def _limit(bound: int | None) -> str:
    return "none" if bound is None else f"{bound * _MS:.3f}"
