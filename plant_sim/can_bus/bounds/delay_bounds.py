"""Bounds of the total delay from a sensor's sample to the actuator's force.

τ_max = sensor filter + response of the sensor frame + sensor period until the next + run time and
its jitter + response of the command frame + actuator period + lost sensor frames + gateways + one
tick, for which the command is held. τ_min is the same with the shortest frames and no waiting.
Responses over gateways come from the holistic analysis.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from canroll.errors import CanrollError, VerdictError
from canroll.plant_sim.buses.profile import BusProfile
from canroll.plant_sim.buses.topology import NODES, Topology
from canroll.plant_sim.can_bus.bounds.analysis import ErrorModel, ResponseBound
from canroll.plant_sim.can_bus.bounds.holistic import HolisticArrival, arrivals
from canroll.plant_sim.can_bus.network.own_frames import DEFAULT_COMMAND, own_messages
from canroll.plant_sim.can_bus.network.profiles import routed_messages
from canroll.plant_sim.can_bus.network.routing import RoutedMessage, RoutedNetwork
from canroll.plant_sim.kernels.instants import MS

_NS: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Path:
    """Least and greatest time from the queueing of a message to its last receiver, seconds."""

    least: float
    greatest: float


@dataclass(frozen=True, slots=True)
class DelayBounds:
    """Total delay in seconds.

    ``tau_min``, ``tau_max``: from the motion to the force, the hold of one tick included.
    ``age_min``, ``age_max``: from a sample to the instant the actuator applies what was computed
    from it; simulated sample-to-force ages lie between them.
    """

    tau_min: float
    tau_max: float
    age_min: float
    age_max: float
    sensor: Path
    command: Path


def message_paths(
    profile: BusProfile,
    *,
    command: str = DEFAULT_COMMAND,
    command_period_ms: float = 10.0,
    command_jitter_ms: float = 0.0,
    errors: ErrorModel | None = None,
) -> dict[str, Path]:
    """Return the bounds from queueing to the farthest receiver for every own message, by name.

    Messages without a bound are left out.
    """
    network = loop_network(
        profile,
        command=command,
        command_period_ms=command_period_ms,
        command_jitter_ms=command_jitter_ms,
    )
    bounds = arrivals(network, errors=errors)
    own = len(own_messages(command, profile))
    paths = {
        r.message.name: path_to_receivers(network.topology, r, there)
        for r, there in zip(network.messages[:own], bounds[:own], strict=True)
    }
    return {name: path for name, path in paths.items() if isinstance(path, Path)}


def loop_network(
    profile: BusProfile,
    *,
    command: str,
    command_period_ms: float,
    command_jitter_ms: float = 0.0,
    seed: int = 0,
) -> RoutedNetwork:
    """Return the network of a profile, with period and jitter of the loop's command."""
    routed = list(routed_messages(profile, command=command, seed=seed))
    for number, message in enumerate(own_messages(command, profile)):
        if message.name == command:
            sent = replace(
                message,
                period_ns=command_period_ms * MS,
                jitter_ns=message.jitter_ns + round(command_jitter_ms * MS),
            )
            routed[number] = replace(routed[number], message=sent)
    return RoutedNetwork(profile.network, routed)


def path_of(arrival: HolisticArrival) -> Path:
    """Return the bounds of an arrival that is bounded."""
    assert arrival.greatest_ns is not None
    return Path(arrival.least_ns * _NS, arrival.greatest_ns * _NS)


def path_to_receivers(
    topology: Topology, routed: RoutedMessage, bounds: Mapping[int, HolisticArrival]
) -> Path | ResponseBound:
    """Return the bounds to the farthest receiver, or the response that has none."""
    receivers = {topology.place(r) for r in routed.message.receivers if r in NODES}
    ends = [bounds[segment] for segment in receivers or {routed.home}]
    for arrival in ends:
        if arrival.greatest_ns is None:
            return arrival.here
    paths = [path_of(arrival) for arrival in ends]
    return Path(min(p.least for p in paths), max(p.greatest for p in paths))


def delay_bounds(
    profile: BusProfile,
    *,
    tick_ms: float = 10.0,
    command: str = DEFAULT_COMMAND,
    sensor: str = "Imu",
    filter_delay_s: float = 0.0,
    run_time_s: float = 0.0,
    jitter_s: float = 0.0,
    actuator_period_s: float = 1e-3,
    n_lost: int = 0,
    errors: ErrorModel | None = None,
) -> DelayBounds:
    """Return the bounds of the total sensor-to-actuator delay on a bus profile.

    Args:
        profile: the bus, its background traffic included.
        tick_ms: period of the control loop, not synchronised with the sensors. A triggered
            command is taken as sent in every tick.
        command: the actuator command message.
        sensor: the sensor message whose samples count.
        filter_delay_s: of the sensor, before the sample.
        run_time_s: greatest time from the tick to the queueing of the command.
        jitter_s: greatest delay of a tick.
        actuator_period_s: the actuator reads its commands with this period.
        n_lost: number of consecutive sensor frames that may be lost.
        errors: disturbed frames included in the bounds.

    Raises:
        VerdictError: the bus is so loaded that no bound exists.
        CanrollError: ``tick_ms`` is not above 0, or ``sensor`` is not a message of the bus.
    """
    if tick_ms <= 0.0:
        raise CanrollError(f"the tick must be positive, got {tick_ms} ms")
    names = [m.name for m in own_messages(command, profile)]
    if sensor not in names:
        raise CanrollError(f"'{sensor}' is not a message of the bus: choose from {sorted(names)}")
    network = loop_network(
        profile,
        command=command,
        command_period_ms=tick_ms,
        command_jitter_ms=1e3 * (jitter_s + run_time_s),
    )
    total = loop_delay(
        network,
        sensor,
        command,
        errors=errors,
        filter_delay_s=filter_delay_s,
        actuator_period_s=actuator_period_s,
        n_lost=n_lost,
    )
    if isinstance(total, ResponseBound):
        raise VerdictError(
            f"bus profile '{profile.name}': the response time of {total.message.name} is"
            " unbounded: reduce the load or raise the bit rate"
        )
    return total


def loop_delay(
    network: RoutedNetwork,
    sensor: str,
    command: str,
    *,
    errors: ErrorModel | None = None,
    **times: Any,  # noqa: ANN401
) -> DelayBounds | ResponseBound:
    """Return the bounds of the total delay over two messages of a network.

    Args:
        network: the tick is the period of the command, see ``RoutedNetwork.in_every_tick``.
        sensor: name of the message with the samples.
        command: name of the actuator command.
        errors: disturbed frames included in the bounds.
        times: further parts of the delay, as of ``total_delay``.

    Returns:
        The bounds; if one of the two messages has none, its response with the reason.

    Raises:
        CanrollError: ``sensor`` and ``command`` are not two messages of the network.
    """
    pair = network.pair(sensor, command)
    bounds = arrivals(network, errors=errors)
    paths = []
    for r in pair:
        path = path_to_receivers(network.topology, r, bounds[network.messages.index(r)])
        if isinstance(path, ResponseBound):
            return path
        paths.append(path)
    sensor_period, tick = (r.message.period_ns * _NS for r in pair)
    return total_delay(*paths, sensor_period_s=sensor_period, tick_s=tick, **times)


def total_delay(
    sensor: Path,
    command: Path,
    *,
    sensor_period_s: float,
    tick_s: float,
    filter_delay_s: float = 0.0,
    actuator_period_s: float = 1e-3,
    n_lost: int = 0,
) -> DelayBounds:
    """Return the bounds of the total delay over two messages; see ``delay_bounds``.

    The command's greatest time runs from the nominal tick: run time and jitter are in it.
    """
    # a tick, however long, uses the newest sample received: the next one came a period later
    waiting = (1 + n_lost) * sensor_period_s
    age_min = sensor.least + command.least
    age_max = sensor.greatest + waiting + command.greatest + actuator_period_s
    return DelayBounds(
        tau_min=filter_delay_s + age_min,
        tau_max=filter_delay_s + age_max + tick_s,
        age_min=age_min,
        age_max=age_max,
        sensor=sensor,
        command=command,
    )
