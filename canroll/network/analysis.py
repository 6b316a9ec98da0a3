"""Bounds and simulation of a traffic set or a network; the delay over either, or over a log."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from canroll.errors import UnknownNameError
from canroll.network import COMMANDS, SENSOR
from canroll.network.answer import LoopNames, MessageRow, PathDelay, SegmentAnswer, Times
from canroll.plant_sim.can_bus.bounds.analysis import ErrorModel, ResponseBound
from canroll.plant_sim.can_bus.bounds.delay_bounds import loop_delay
from canroll.plant_sim.can_bus.bounds.holistic import HolisticArrival, arrivals
from canroll.plant_sim.can_bus.network.routing import RoutedNetwork
from canroll.plant_sim.can_bus.simulation.ages import simulate_ages_of_network
from canroll.plant_sim.can_bus.simulation.response_times import NetworkSimulation, simulate_network
from canroll.plant_sim.can_bus.traffic.log_playback import Recording
from canroll.plant_sim.can_bus.traffic.messages import BusMessage

BESIDE_RECORDING = "the periods of a recording are unknown"
"""Why a message added to a recording has no bound."""
_ACTUATOR = "Actuator"
"""The node that applies the command."""


@dataclass(frozen=True, slots=True)
class AnalysisOptions:
    """What is computed for any network.

    ``command`` None: the first of ``COMMANDS`` that is present. ``errors``: included in the bounds.
    ``duration_s``: simulated time, 0: no simulation; ``seed``: of payloads, jitter and latencies;
    ``worst_case_lengths``: classic frames have the maximum number of stuff bits.
    """

    sensor: str
    command: str | None
    tick_ms: float
    errors: ErrorModel | None
    duration_s: float
    seed: int
    worst_case_lengths: bool

    def loop(self, messages: Sequence[BusMessage]) -> LoopNames:
        """Return the loop, its command chosen among ``messages``."""
        return LoopNames(self.sensor, self.command or command_among(messages), self.tick_ms)

    def check_names(self, messages: Sequence[BusMessage]) -> None:
        """Reject a sensor or command that is given and not among ``messages``.

        Raises:
            UnknownNameError: there is no such message.
        """
        known = [message.name for message in messages]
        for option, name, default in (
            ("--sensor", self.sensor, SENSOR),
            ("--command", self.command, None),
        ):
            if name not in (default, *known):
                raise UnknownNameError(f"{option} message", str(name), known)

    def simulate(
        self, network: RoutedNetwork, recording: Recording | None = None
    ) -> NetworkSimulation | None:
        """Simulate a network; None: there is nothing to simulate."""
        if self.duration_s <= 0.0 or not network.messages:
            return None
        return simulate_network(network, recording=recording, **self._simulation)

    def simulate_ages(
        self, network: RoutedNetwork, loop: LoopNames, recording: Recording | None = None
    ) -> Times:
        """Simulate the age of a sample when its force acts."""
        if self.duration_s <= 0.0:
            return Times()
        ages = simulate_ages_of_network(
            network,
            loop.sensor,
            loop.command,
            actuator_segment=network.topology.place(_ACTUATOR),
            recording=recording,
            **self._simulation,
        )
        return Times.of(ages)

    @property
    def _simulation(self) -> dict[str, Any]:
        names = ("duration_s", "seed", "worst_case_lengths")
        return {name: getattr(self, name) for name in names}


def command_among(messages: Sequence[BusMessage]) -> str:
    """Return the actuators' command among messages, the default one if there is none."""
    names = {message.name for message in messages}
    return next((name for name in COMMANDS if name in names), COMMANDS[0])


def segments_of(
    network: RoutedNetwork,
    options: AnalysisOptions,
    *,
    recording: Recording | None = None,
    offsets: bool = False,
) -> tuple[SegmentAnswer, ...]:
    """Return the response times of all messages on every segment.

    Args:
        network: all messages are bounded and simulated.
        options: errors in the bounds, and the simulation.
        recording: replayed on the first segment; no bounds are computed with it.
        offsets: whether the messages of one node keep their offsets.
    """
    bounds = arrivals(network, errors=options.errors, offsets=offsets)
    if recording is not None:
        bounds = [{s: _without_bound(there) for s, there in places.items()} for places in bounds]
    simulation = options.simulate(network, recording)
    places = network.topology.segments
    rows: list[list[MessageRow]] = [[] for _ in places]
    for number, r in enumerate(network.messages):
        for segment, arrival in bounds[number].items():
            here = end_to_end = Times()
            if simulation is not None:
                here, end_to_end = map(Times.of, simulation.arrivals[number][segment])
            way = (r.home, *(hop.target for hop in r.way_to(segment)))
            names = tuple(places[passed].name for passed in way)
            rows[segment].append(
                MessageRow(arrival.here, here, names, arrival.greatest_ns, end_to_end)
            )
    return tuple(
        SegmentAnswer(
            place.name,
            place.bitrate,
            place.data_bitrate,
            sorted(rows[number], key=lambda row: row.message.arbitration_key),
            None if simulation is None else simulation.loads[number],
            0 if simulation is None else simulation.frames[number],
        )
        for number, place in enumerate(places)
    )


def _without_bound(arrival: HolisticArrival) -> HolisticArrival:
    """Return an arrival on a bus with recorded frames; reasons of its set remain."""
    if arrival.here.bound_ns is None:
        return arrival
    here = replace(arrival.here, bound_ns=None, reason=BESIDE_RECORDING, covered=False)
    return replace(arrival, greatest_ns=None, here=here)


def delay_over(
    network: RoutedNetwork,
    loop: LoopNames,
    options: AnalysisOptions,
    recording: Recording | None = None,
) -> PathDelay | None:
    """Return the delay over a loop, its command sent in every tick; None: a message is missing.

    ``recording``: replayed on the first segment; no bounds are computed with it.
    """
    if not {loop.sensor, loop.command} <= {r.message.name for r in network.messages}:
        return None
    network = network.in_every_tick(loop.command, tick_ms=loop.tick_ms)
    bounds = loop_delay(network, loop.sensor, loop.command, errors=options.errors)
    age = options.simulate_ages(network, loop, recording)
    if isinstance(bounds, ResponseBound):
        return PathDelay(None, age, f"{bounds.message.name}: {bounds.reason}", bounds.covered)
    return PathDelay(bounds, age) if recording is None else PathDelay(None, age, BESIDE_RECORDING)
