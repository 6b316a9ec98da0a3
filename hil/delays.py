"""Bounds of the delay from a sensor's sample to the force that answers it."""

from math import ceil

from gain_gen.design import Delay
from plant_sim.can_bus.profiles import NODES, BusProfile, own_messages, profile_spec
from plant_sim.sensor_setup import SensorOptions, delay
from vehicles import Vehicle

RUN_TIME = 200e-6
"""From the start of a tick to its frames in the controller's queue, s: the loop takes 10 k to 20 k
instructions on a Cortex-M0, which is less at 100 MHz."""
ACTUATOR_PERIOD = 1e-3
IMU_PERIOD = 10e-3
COMMANDS = {
    "suspension": "SuspensionForceCommand",
    "bars": "AntiRollBarCommand",
    "dampers": "DamperCommand",
    "valves": "AntiRollBarCommand",
}


def frame_time(length: int, bitrate: int, *, stuffed: bool) -> float:
    """Return the time of an 11-bit frame with its interframe space, at most or at least stuffed, s.

    47 + 8 s bits, and a stuff bit for every four of 34 + 8 s − 1 (Davis et al. 2007).
    """
    bits = 47 + 8 * length + ((34 + 8 * length - 1) // 4 if stuffed else 0)
    return bits / bitrate


def worst_response(
    own: tuple[float, float], others: list[tuple[float, float]], blocking: float, bit: float
) -> float:
    """Return the worst-case response time of a message, s (Davis, Burns, Bril, Lukkien 2007).

    Args:
        own: its frame time and period, s.
        others: frame times and periods of all messages of higher priority.
        blocking: longest frame of lower priority.
        bit: length of one bit.
    """
    frame, period = own
    busy = frame
    while True:
        longer = blocking + sum(
            ceil(busy / every) * time for time, every in [*others, (frame, period)]
        )
        if longer <= busy:
            break
        busy = longer
        if busy > 10.0:
            return busy
    worst = 0.0
    for instance in range(ceil(busy / period)):
        wait = blocking + instance * frame
        while True:
            longer = (
                blocking
                + instance * frame
                + sum(ceil((wait + bit) / every) * time for time, every in others)
            )
            if longer <= wait:
                break
            wait = longer
        worst = max(worst, wait - instance * period + frame)
    return worst


def response_bounds(profile: BusProfile, name: str, *, segment: int, command: str) -> float:
    """Return the worst-case response time of message ``name`` on one segment of ``profile``, s."""
    bit = 1 / profile.bitrate
    spec = profile_spec(profile, command=command)
    home = {node.name: node.segment for node in spec.nodes}
    traffic = [
        (source.ident, frame_time(source.length, profile.bitrate, stuffed=True), source.period_ns)
        for source in spec.sources
        if home[source.node] == segment
    ]
    messages = own_messages(command)
    traffic += [
        (m.ident, frame_time(m.length, profile.bitrate, stuffed=True), m.period_ns)
        for m in messages
        if _on(profile, segment, m.sender) or any(_on(profile, segment, r) for r in m.receivers)
    ]
    mine = next(m for m in messages if m.name == name)
    higher = [(time, period * 1e-9) for ident, time, period in traffic if ident < mine.ident]
    lower = [time for ident, time, _ in traffic if ident > mine.ident]
    own = (frame_time(mine.length, profile.bitrate, stuffed=True), mine.period_ns * 1e-9)
    return worst_response(own, higher, max(lower, default=0.0), bit)


def _on(profile: BusProfile, segment: int, node: str) -> bool:
    if node not in NODES:
        return False
    return segment == (0 if node == "RollControl" or profile.segments == 1 else 1)


def sample_to_force(
    vehicle: Vehicle, actuator: str, profile: BusProfile, *, tick: float = 0.010
) -> Delay:
    """Return the bounds of the delay from motion to force, and its middle.

    At most: sensor delay, worst response of the Imu frame, a whole period (nothing is in step with
    the loop), run time, worst response of the command, one period of the actuator, and the
    gateway both ways. At least: the same with shortest frames and no waiting. The hold of the
    command over the next tick comes on top and is part of the sampled design model.

    Args:
        vehicle: its sensors.
        actuator: "suspension", "bars", "dampers" or "valves".
        profile: the bus.
        tick: period of the loop, s.
    """
    sensor = delay(vehicle.sensors.roll_rate, options=SensorOptions())
    command = COMMANDS[actuator]
    segments = range(profile.segments)
    responses = [
        response_bounds(profile, name, segment=segment, command=command)
        for name in ("Imu", command)
        for segment in segments
    ]
    shortest = frame_time(8, profile.bitrate, stuffed=False)
    gateway = profile.gateway_ms or (0.0, 0.0)
    least = sensor + 2 * profile.segments * shortest + RUN_TIME + 2e-3 * gateway[0]
    waits = max(tick, IMU_PERIOD) + ACTUATOR_PERIOD
    most = sensor + sum(responses) + waits + RUN_TIME + 2e-3 * gateway[1]
    return Delay((least + most) / 2, least, most)
