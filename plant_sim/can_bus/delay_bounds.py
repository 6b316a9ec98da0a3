"""Bounds of the total delay from a sensor's sample to the actuator's force.

τ_max = sensor filter + response of the sensor frame + wait for the tick that uses it + run time and
its jitter + response of the command frame + actuator period + lost sensor frames + gateways + one
tick, for which the command is held. τ_min is the same with the shortest frames and no waiting.
Responses over gateways come from the holistic analysis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from plant_sim.buses.profile import BusProfile
from plant_sim.buses.topology import NODES
from plant_sim.can_bus.analysis import ErrorModel, ResponseBound, response_bounds
from plant_sim.can_bus.holistic import Arrival, arrivals
from plant_sim.can_bus.own_frames import DEFAULT_COMMAND, MS, own_messages
from plant_sim.can_bus.profiles import routed_messages
from plant_sim.can_bus.routing import RoutedMessage
from plant_sim.can_bus.traffic.messages import BusMessage

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
    topology = profile.network
    own = own_messages(command, profile)
    routed = loop_routes(
        profile,
        command=command,
        command_period_ms=command_period_ms,
        command_jitter_ms=command_jitter_ms,
    )
    found = arrivals(topology, routed, errors=errors)
    paths = {}
    for message, there in zip(own, found, strict=False):
        ends = {topology.place(r) for r in message.receivers if r in NODES}
        times = [there[segment] for segment in ends or {topology.place(message.sender)}]
        greatest = [arrival.greatest_ns for arrival in times]
        if None not in greatest:
            most = max(bound for bound in greatest if bound is not None)
            paths[message.name] = Path(min(a.least_ns for a in times) * _NS, most * _NS)
    return paths


def loop_routes(
    profile: BusProfile,
    *,
    command: str,
    command_period_ms: float,
    command_jitter_ms: float = 0.0,
    seed: int = 0,
) -> list[RoutedMessage]:
    """Return ``routed_messages`` of a profile, with period and jitter of the loop's command."""
    routed = list(routed_messages(profile, command=command, seed=seed))
    for number, message in enumerate(own_messages(command, profile)):
        if message.name == command:
            sent = replace(
                message,
                period_ns=command_period_ms * MS,
                jitter_ns=message.jitter_ns + round(command_jitter_ms * MS),
            )
            routed[number] = replace(routed[number], message=sent)
    return routed


def path_of(arrival: Arrival) -> Path:
    """Return the bounds of an arrival that is bounded."""
    assert arrival.greatest_ns is not None
    return Path(arrival.least_ns * _NS, arrival.greatest_ns * _NS)


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
    periods = {m.name: m.period_ns * _NS for m in own_messages(command, profile)}
    if sensor not in periods:
        raise CanrollError(f"'{sensor}' is not a message of the bus: choose from {sorted(periods)}")
    paths = message_paths(
        profile,
        command=command,
        command_period_ms=tick_ms,
        command_jitter_ms=1e3 * (jitter_s + run_time_s),
        errors=errors,
    )
    for name in (sensor, command):
        if name not in paths:
            raise VerdictError(
                f"bus profile '{profile.name}': the response time of {name} is unbounded:"
                " reduce the load or raise the bit rate"
            )
    return total_delay(
        paths[sensor],
        paths[command],
        sensor_period_s=periods[sensor],
        tick_s=tick_ms * 1e-3,
        filter_delay_s=filter_delay_s,
        actuator_period_s=actuator_period_s,
        n_lost=n_lost,
    )


def delay_bounds_of_set(
    messages: Sequence[BusMessage],
    sensor: str,
    command: str,
    *,
    tick_ms: float,
    bitrate: int,
    data_bitrate: int = 0,
    errors: ErrorModel | None = None,
) -> DelayBounds | ResponseBound:
    """Return the bounds of the total delay over two messages of a set on one bus.

    If one of them has no response bound with the command sent in every tick, return its
    ``ResponseBound`` with the reason.

    Raises:
        CanrollError: ``sensor`` and ``command`` are not two messages of the set.
    """
    sent = loop_messages(messages, sensor, command, tick_ms=tick_ms)
    bounds = response_bounds(sent, bitrate=bitrate, data_bitrate=data_bitrate, errors=errors)
    found = {b.message.name: b for b in bounds}
    paths = []
    for bound in (found[sensor], found[command]):
        if bound.bound_ns is None:
            return bound
        least = bound.message.least_delivery_ns(bitrate, data_bitrate)
        paths.append(Path(least * _NS, bound.bound_ns * _NS))
    period_s = found[sensor].message.period_ns * _NS
    return total_delay(*paths, sensor_period_s=period_s, tick_s=tick_ms * 1e-3)


def loop_messages(
    messages: Sequence[BusMessage], sensor: str, command: str, *, tick_ms: float
) -> list[BusMessage]:
    """Return a set with the command sent in every tick, as by a control loop.

    Raises:
        CanrollError: ``sensor`` and ``command`` are not two messages of the set.
    """
    names = [message.name for message in messages]
    for name in (sensor, command):
        if name not in names:
            raise UnknownNameError("message of the set", name, names)
    if sensor == command:
        raise CanrollError(f"message '{sensor}' cannot be both sensor and command")
    return in_every_tick(messages, command, tick_ms=tick_ms)


def in_every_tick(
    messages: Sequence[BusMessage], command: str, *, tick_ms: float
) -> list[BusMessage]:
    """Return ``messages`` with the period of ``command``, if present, set to the tick."""
    return [
        replace(m, period_ns=float(round(tick_ms * MS))) if m.name == command else m
        for m in messages
    ]


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
    # a tick between two samples uses the older one: it waits a sensor period, not only a tick
    waiting = max(tick_s, sensor_period_s) + n_lost * sensor_period_s
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
