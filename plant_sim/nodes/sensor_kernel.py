"""Sensor nodes: from the plant's true motion to protected payloads at the DBC's cycle times.

Every channel is filtered by a first-order low-pass at 1 ms, sampled at its node's own clock
(interpolated linearly between two steps of the plant); noise, bias, drift, faults, range and LSB
follow.
Noise is white up to the low-pass: an Ornstein-Uhlenbeck process advanced exactly from sample to
sample, of variance density² · bandwidth · π/2.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.kernels import schedule
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.random import uniform
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.kernels.schedule import Faults
from canroll.plant_sim.nodes import codec, e2e
from canroll.plant_sim.nodes.codec import Codec
from canroll.plant_sim.nodes.imu_motion import FORCE, RATE, along, specific_motion

# Channels, in the order of the DBC's signals, node by node.
ROLL_RATE, LATERAL, YAW_RATE = 0, 1, 2
SPEED, STEERING, LONGITUDINAL = 3, 4, 5
STROKE_RATE, TRAVEL = 6, 10
REFERENCE = 14
N_CHANNELS = 17

CHANNEL = np.dtype(
    [
        *fields("f8", "keep old new noise noise_memory noise_end_ns bias drift_step range lsb"),
        *fields("f8", "to_bus filtered previous coloured drift last input"),
        *fields("i8", "missing signal"),
    ]
)
"""A channel: its data, from ``filtered`` on its state, and the row of its signal."""
NODE = np.dtype(
    fields(
        "i8",
        "message first_channel channels period latency next samples sample_signal bus_node "
        "held_sample held_counter sensor",
    )
)
"""A node; the message of one without channels is built elsewhere.

``sensor`` is the row of the node that has the faults: a further frame of a message has another row.
"""
# Kinds of faults of a channel, whose place is its bit, and of a node: that behind all channels.
SIGNAL_FAULTS = ("stuck", "invalid", "delay", "offset", "drift", "scale", "burst", "reversed")
STUCK, INVALID, DELAY, OFFSET, DRIFT_AWAY, SCALE, BURST, REVERSED = range(8)
MESSAGE_FAULTS = ("dropout", "frozen", "frozen_counter", "down", "clock_drift")
DROPOUT, FROZEN, FROZEN_COUNTER, DOWN, CLOCK_DRIFT = range(8, 13)
# Room for faults, and samples that a delayed signal may be late.
FAULTS = 32
HISTORY = 256

STEP = 1e-3


class SensorTables(NamedTuple):
    """Tables of every sensor node: rows of :data:`CHANNEL` and :data:`NODE`.

    ``fault`` has rows of :mod:`canroll.plant_sim.kernels.schedule`, ``history`` (FAULTS, HISTORY)
    the newest samples of delayed signals. ``mounting`` (9) rotates body axes to the IMU's, ``arm``
    (3) is its position (m from the sprung CG), ``motion`` (6) the motion there.
    """

    channel: NDArray[Any]
    node: NDArray[Any]
    fault: Faults
    history: NDArray[np.float64]
    mounting: NDArray[np.float64]
    arm: NDArray[np.float64]
    motion: NDArray[np.float64]
    steering_ratio: NDArray[np.float64]


@njit
def normal(seed: int, stream: int, count: int) -> float:
    """Standard normal draw number ``count`` of ``stream`` (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(seed, stream, 2 * count)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, stream, 2 * count + 1))


@njit
def _low_pass(channel: NDArray[Any], index: int, value: float) -> None:
    # Exact for an input that is linear over the step.
    row = channel[index]
    row.previous = row.filtered
    row.filtered = row.keep * row.filtered + row.old * row.input + row.new * value
    row.input = value


@njit
def observe(
    sensors: SensorTables, inputs: NDArray[np.float64], outputs: NDArray[np.float64]
) -> None:
    """Read the plant's motion at the end of a step and advance the channels' low-passes."""
    motion, turn, channel = sensors.motion, sensors.mounting, sensors.channel
    specific_motion(inputs, outputs, sensors.arm, motion)
    _low_pass(channel, ROLL_RATE, along(turn, 0, motion, RATE))
    _low_pass(channel, YAW_RATE, along(turn, 2, motion, RATE))
    _low_pass(channel, LONGITUDINAL, along(turn, 0, motion, FORCE))
    _low_pass(channel, LATERAL, along(turn, 1, motion, FORCE))
    _low_pass(channel, SPEED, outputs[ports.VX])
    _low_pass(channel, STEERING, inputs[ports.STEER] * sensors.steering_ratio[0])
    for wheel in range(4):
        _low_pass(channel, STROKE_RATE + wheel, outputs[ports.TRAVEL_RATE + wheel])
        _low_pass(channel, TRAVEL + wheel, outputs[ports.TRAVEL + wheel])
    _low_pass(channel, REFERENCE, outputs[ports.ROLL])
    _low_pass(channel, REFERENCE + 1, outputs[ports.ROLL_RATE])
    _low_pass(channel, REFERENCE + 2, outputs[ports.AY])


@njit
def _faulty(  # noqa: PLR0917
    sensors: SensorTables, index: int, value: float, t_ns: int, count: int, seed: int
) -> float:
    """Apply the faults of a channel to its value; nan if the sensor reports failure."""
    last = sensors.channel[index].last
    measured = value
    for number in range(FAULTS):
        fault = sensors.fault[number]
        if fault.places == 0:
            break
        if fault.places != 1 << index:
            continue
        kind, amount = fault.kind, fault.value
        if kind == DELAY:
            sensors.history[number, count % HISTORY] = value
        share = schedule.severity(fault, t_ns)
        if share == 0.0:
            continue
        if kind == STUCK:
            return float(last)
        if kind == INVALID:
            return math.nan
        if kind == DELAY:
            late = min(int(amount), count)
            measured += sensors.history[number, (count - late) % HISTORY] - value
        elif kind == OFFSET:
            measured += share * amount
        elif kind == DRIFT_AWAY:
            measured += amount * (t_ns - fault.start) * 1e-9
        elif kind == SCALE:
            measured *= 1.0 + share * (amount - 1.0)
        elif kind == REVERSED:
            measured *= 1.0 - 2.0 * share
        elif kind == BURST:
            measured += share * amount * normal(seed, 2 * N_CHANNELS + number, count)
    return measured


@njit
def measure(  # noqa: PLR0917
    sensors: SensorTables, index: int, back: float, t_ns: int, count: int, seed: int
) -> float:
    """Value of a channel at a sample in the unit of the bus; nan if the sensor reports failure.

    ``back`` is the time from the instant ``t_ns`` to the last step, as a fraction of a step.
    """
    row = sensors.channel[index]
    value = row.filtered + back * (row.previous - row.filtered)
    if row.noise > 0.0 and t_ns < row.noise_end_ns:
        fresh = math.sqrt(1.0 - row.noise_memory**2) * normal(seed, index, count)
        row.coloured = row.noise_memory * row.coloured + fresh
        value += row.noise * row.coloured
    if row.drift_step > 0.0:
        row.drift += row.drift_step * normal(seed, N_CHANNELS + index, count)
    value += row.bias + row.drift
    value = _faulty(sensors, index, value, t_ns, count, seed)
    if math.isnan(value):
        return value
    value = min(max(value, -row.range), row.range)
    if row.lsb > 0.0:
        value = math.floor(value / row.lsb + 0.5) * row.lsb
    row.last = value
    return float(value * row.to_bus)


@njit
def node_fault(sensors: SensorTables, node: int, kind: int, t_ns: int) -> float:
    """Strength times value of a node's faults of ``kind`` at ``t_ns``; 0 where none acts."""
    return schedule.total(sensors.fault, kind, 1 << N_CHANNELS + sensors.node[node].sensor, t_ns)


@njit
def silent(sensors: SensorTables, node: int, t_ns: int) -> bool:
    """Whether a fault keeps the node's sample of ``t_ns`` off the bus; if down, it restarts."""
    if node_fault(sensors, node, DOWN, t_ns) > 0.0:
        sensors.node[node].samples = 0
        return True
    return node_fault(sensors, node, DROPOUT, t_ns) > 0.0


@njit
def period(sensors: SensorTables, node: int, t_ns: int) -> int:
    """Time (ns) from the node's sample at ``t_ns`` to its next."""
    nominal = sensors.node[node].period
    drift = node_fault(sensors, node, CLOCK_DRIFT, t_ns)
    return int(nominal if drift == 0.0 else nominal * (1.0 + drift))


@njit
def sample(  # noqa: PLR0917
    sensors: SensorTables,
    tables: Codec,
    node: int,
    t_ns: int,
    now_ns: int,
    seed: int,
    payload: NDArray[np.uint8],
) -> None:
    """Write the node's sample at ``t_ns`` to a payload and advance its sample counter.

    ``now_ns`` is the end of the last step.
    """
    row = sensors.node[node]
    count = row.samples
    back = (now_ns - t_ns) / STEP_NS
    frozen = node_fault(sensors, node, FROZEN, t_ns) > 0.0
    if not frozen:
        row.held_sample = count
    if node_fault(sensors, node, FROZEN_COUNTER, t_ns) == 0.0:
        row.held_counter = count
    for index in range(row.first_channel, row.first_channel + row.channels):
        signal = sensors.channel[index].signal
        if tables.field[signal].frame != row.message:
            continue
        held = sensors.channel[index].last
        value = measure(sensors, index, back, t_ns, count, seed)
        if frozen:
            sensors.channel[index].last = held
            value = held * sensors.channel[index].to_bus
        codec.put_value(tables, row.message, signal, payload, value)
        sensors.channel[index].missing = math.isnan(value)
    for index in range(row.first_channel, row.first_channel + row.channels):
        if sensors.channel[index].missing:
            codec.invalidate(tables, row.message, sensors.channel[index].signal, payload)
    codec.put(tables, row.message, row.sample_signal, payload, row.held_sample % 16)
    row.samples += 1


@njit
def finish(sensors: SensorTables, tables: Codec, node: int, payload: NDArray[np.uint8]) -> None:
    """Give the frame of the node's newest sample its page and its protection."""
    row = sensors.node[node]
    number = row.message
    message = tables.message[number]
    if message.selector >= 0:
        codec.insert(tables, message.selector, payload, message.selected)
    e2e.protect(
        tables.protection[number],
        row.held_counter,
        payload,
    )
