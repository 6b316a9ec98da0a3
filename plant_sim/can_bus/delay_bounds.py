"""Bounds of the total delay from a sensor's sample to the actuator's force.

τ_max = sensor filter + response of the sensor frame + wait for the tick that uses it + run time and
its jitter + response of the command frame + actuator period + lost sensor frames + gateways, and
the command is then held one more tick. τ_min likewise with the shortest frames and no waiting.
Responses across a gateway are bounded segment by segment, the response on the one being the
jitter on the other, until nothing changes (holistic analysis; Tindell, Clark 1994).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from canroll.errors import CanrollError, UnknownNameError, VerdictError
from plant_sim.buses.profile import BusProfile
from plant_sim.can_bus.analysis import ErrorModel, ResponseBound, response_bounds
from plant_sim.can_bus.own_frames import DEFAULT_COMMAND, MS, own_messages
from plant_sim.can_bus.profiles import background_of, crosses, segment_of
from plant_sim.can_bus.traffic.messages import BusMessage

_NS: Final = 1e-9
_MAX_ROUNDS: Final = 50


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
    from it; what a simulation measures as sample-to-force age lies between them.
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
    """Return for every own message the bounds from its queueing to its farthest receiver.

    Raises:
        VerdictError: some message on the way to the ECU or the actuators has no bound.
    """
    own = [
        replace(m, period_ns=command_period_ms * MS, jitter_ns=round(command_jitter_ms * MS))
        if m.name == command
        else m
        for m in own_messages(command, profile)
    ]
    low, high = (int(x * MS) for x in profile.gateway_ms or (0.0, 0.0))
    jitter: dict[str, int] = {}
    for _ in range(_MAX_ROUNDS):
        bounds: list[dict[str, tuple[int, int | None]]] = []
        for segment in range(profile.segments):
            here: list[BusMessage] = background_of(profile, segment, command=command)
            for message in own:
                if segment_of(profile, message.sender) == segment:
                    here.append(message)
                elif crosses(profile, message):
                    here.append(replace(message, jitter_ns=jitter.get(message.name, high - low)))
            bounds.append(
                {
                    b.message.name: (b.best_ns, b.bound_ns)
                    for b in response_bounds(
                        here,
                        bitrate=profile.bitrate,
                        data_bitrate=profile.data_bitrate,
                        errors=errors,
                    )
                }
            )
        update = {}
        for message in own:
            if crosses(profile, message):
                best, bound = bounds[segment_of(profile, message.sender)][message.name]
                update[message.name] = _finite(bound, message, profile) - best + high - low
        if update == jitter:
            break
        jitter = update
    else:
        raise VerdictError(f"bus profile '{profile.name}': the analysis over the gateway diverges")
    paths = {}
    for message in own:
        home = segment_of(profile, message.sender)
        best, bound = bounds[home][message.name]
        least = message.least_delivery_ns(profile.bitrate, profile.data_bitrate)
        if crosses(profile, message):
            _, far_bound = bounds[1 - home][message.name]
            bound = None if far_bound is None else best + low + far_bound
            least += low + least
        if bound is not None:
            paths[message.name] = Path(least * _NS, bound * _NS)
    return paths


def _finite(bound: int | None, message: BusMessage, profile: BusProfile) -> int:
    if bound is None:
        raise VerdictError(
            f"bus profile '{profile.name}': the response time of {message.name} is unbounded:"
            " reduce the load or raise the bit rate"
        )
    return bound


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
        filter_delay_s: of the sensor, in front of the sample.
        run_time_s: greatest time from the tick to the queueing of the command.
        jitter_s: greatest lateness of a tick.
        actuator_period_s: the actuator looks at its commands this often.
        n_lost: sensor frames that may be lost one after the other.
        errors: disturbed frames that the bounds allow for.

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

    Where one of them has no response bound with the command sent in every tick, return that one,
    with its reason.

    Raises:
        CanrollError: the two are not two messages of the set.
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
    """Return a set as a control loop sends it: the command in every tick.

    Raises:
        CanrollError: ``sensor`` and ``command`` are not two messages of the set.
    """
    names = [message.name for message in messages]
    for name in (sensor, command):
        if name not in names:
            raise UnknownNameError("message of the set", name, names)
    if sensor == command:
        raise CanrollError(f"message '{sensor}' cannot be both sensor and command")
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
