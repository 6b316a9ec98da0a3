"""The compiled loop over vehicle, driver, sensors, actuators and bus.

Order within a step from t to t + 1 ms: frames received up to t reach actuators and ECU, the
actuator node works, the driver steers, the body moves, and sensors that sample within the step
queue their frames. Nothing in a step depends on what happens later on the bus.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim import actuators, codec, ports, recording, sensors
from plant_sim import can_bus as bus
from plant_sim.actuator_models import act
from plant_sim.actuators import Actuators
from plant_sim.codec import Codec
from plant_sim.driver import Drive, drive
from plant_sim.jit import njit
from plant_sim.sensors import Sensors

STEP_NS = 1_000_000

FRAME = np.dtype([("t_ns", "i8"), ("ident", "u4"), ("length", "u1"), ("payload", "u1", (8,))])
"""A frame received at the ECU at ``t_ns``."""

# Slots of Parts.clock.
(
    PLANT_NS,
    ROWS,
    LOG_CURSOR,
    RECEIVED,
    OUTBOX,
    SUBMISSIONS,
    APPLIED_COMMANDS,
    PENDING,
    IMU_SAMPLE,
    IMU_LATENCY,
    ECU_SEGMENT,
    ACTUATOR_SEGMENT,
    SEED,
    STATE_NODE,
    N_CLOCK,
) = range(15)
NOTHING = -1

# Columns of Parts.outbox and of Parts.flight (commands on their way, a ring).
OUT_TIME, OUT_IDENT, OUT_LENGTH, OUT_WORD, N_OUTBOX = range(5)
FLIGHT_SUBMITTED, FLIGHT_SAMPLE, N_FLIGHT = range(3)


class Parts(NamedTuple):
    """Everything the loop works on, in place."""

    clock: NDArray[np.int64]
    state: NDArray[np.float64]
    inputs: NDArray[np.float64]
    parameters: NDArray[np.float64]
    outputs: NDArray[np.float64]
    rows: NDArray[np.float64]
    commands: NDArray[np.int64]
    outbox: NDArray[np.int64]
    flight: NDArray[np.int64]
    payload: NDArray[np.uint8]
    received: NDArray[Any]
    listens: NDArray[np.int64]
    drive: Drive
    sensors: Sensors
    actuators: Actuators
    tables: Codec
    network: bus.Network


@njit
def word_of(payload: NDArray[np.uint8]) -> int:
    """Payload bytes as one 64-bit word, byte 0 lowest."""
    word = np.int64(0)
    for byte in range(8):
        word |= np.int64(payload[byte]) << (8 * byte)
    return word


@njit
def _send(parts: Parts, node: int, t_ns: int, ident: int, length: int, word: int) -> None:
    for byte in range(8):
        parts.payload[byte] = (word >> (8 * byte)) & 0xFF
    bus.enqueue(parts.network, node, t_ns, ident, length, parts.payload, 0)


@njit
def _post(parts: Parts) -> None:
    """Queue what the ECU has submitted, and note which sample each command can know of."""
    clock = parts.clock
    for k in range(clock[OUTBOX]):
        out = parts.outbox[k]
        _send(parts, bus.ECU, out[OUT_TIME], out[OUT_IDENT], out[OUT_LENGTH], out[OUT_WORD])
        if actuators.listens(parts.actuators, parts.tables, out[OUT_IDENT]) >= 0:
            flight = parts.flight[clock[SUBMISSIONS] % len(parts.flight)]
            flight[FLIGHT_SUBMITTED] = out[OUT_TIME]
            flight[FLIGHT_SAMPLE] = clock[IMU_SAMPLE]
            clock[SUBMISSIONS] += 1
    clock[OUTBOX] = 0


@njit
def _accepted(parts: Parts, t_origin: int, t_received: int) -> None:
    """Note a command that the actuators will apply in the next step."""
    clock = parts.clock
    row = parts.commands[clock[APPLIED_COMMANDS]]
    row[recording.SAMPLED] = NOTHING
    for back in range(1, min(clock[SUBMISSIONS], len(parts.flight)) + 1):
        flight = parts.flight[(clock[SUBMISSIONS] - back) % len(parts.flight)]
        if flight[FLIGHT_SUBMITTED] == t_origin:
            row[recording.SAMPLED] = flight[FLIGHT_SAMPLE]
            break
    row[recording.SUBMITTED] = t_origin
    row[recording.RECEIVED] = t_received
    row[recording.COUNTER] = parts.actuators.flag[actuators.COUNTER]
    clock[PENDING] = 1


@njit
def _deliver(parts: Parts) -> None:
    """Hand frames that the bus has delivered since the last call to the actuators and the ECU."""
    clock, log = parts.clock, parts.network.log
    total = bus.logged(parts.network)
    imu = parts.listens[0]
    for number in range(clock[LOG_CURSOR], total):
        entry = log[number % len(log)]
        if entry.outcome != bus.DELIVERED:
            continue
        ident = np.int64(entry.ident)
        if entry.segment == clock[ACTUATOR_SEGMENT]:
            which = actuators.listens(parts.actuators, parts.tables, ident)
            if which >= 0 and actuators.receive(
                parts.actuators, parts.tables, which, word_of(entry.payload), entry.t_received
            ):
                _accepted(parts, entry.t_origin, entry.t_received)
        if entry.segment == clock[ECU_SEGMENT]:
            for known in parts.listens:
                if ident == known:
                    frame = parts.received[clock[RECEIVED]]
                    frame.t_ns = entry.t_received
                    frame.ident = entry.ident
                    frame.length = entry.length
                    for byte in range(8):
                        frame.payload[byte] = entry.payload[byte]
                    clock[RECEIVED] += 1
                    if ident == imu:
                        clock[IMU_SAMPLE] = entry.t_origin - clock[IMU_LATENCY]
    clock[LOG_CURSOR] = total


@njit
def _sense(parts: Parts, now_ns: int) -> None:
    """Let every sensor node whose clock has come queue its sample."""
    node_table, clock = parts.sensors.node, parts.clock
    sensors.observe(parts.sensors, parts.inputs, parts.outputs)
    for number in range(len(node_table)):
        node = node_table[number]
        while node[sensors.NEXT] <= now_ns:
            t_ns = node[sensors.NEXT]
            word = 0
            if number == clock[STATE_NODE]:
                word = actuators.report(parts.actuators, parts.tables)
            word = sensors.sample(
                parts.sensors, parts.tables, number, t_ns, now_ns, clock[SEED], word
            )
            message = parts.tables.message[node[sensors.MESSAGE]]
            if not sensors.silent(parts.sensors, number, t_ns):
                t_queued = t_ns + node[sensors.LATENCY]
                ident, length = message[codec.IDENT], message[codec.LENGTH]
                _send(parts, node[sensors.BUS_NODE], t_queued, ident, length, word)
            node[sensors.NEXT] += node[sensors.PERIOD]


@njit
def _step(step: Any, parts: Parts) -> None:  # noqa: ANN401
    clock = parts.clock
    t_ns = clock[PLANT_NS]
    actuators.supervise(parts.actuators, t_ns)
    act(parts.actuators, parts.outputs, parts.inputs, t_ns)
    if clock[PENDING]:
        parts.commands[clock[APPLIED_COMMANDS], recording.APPLIED] = t_ns
        clock[APPLIED_COMMANDS] += 1
        clock[PENDING] = 0
    if parts.outputs[ports.ROLLOVER] == 0.0:
        drive(t_ns, parts.outputs, parts.inputs, parts.drive)
        step(parts.state, parts.inputs, parts.parameters, parts.outputs, 1e-3)
    clock[PLANT_NS] = t_ns + STEP_NS
    _sense(parts, clock[PLANT_NS])
    recording.record(parts.rows[clock[ROWS]], parts.outputs, parts.inputs, parts.actuators)
    clock[ROWS] += 1


@njit
def advance(step: Any, parts: Parts, until_ns: int) -> None:  # noqa: ANN401
    """Let everything happen up to and including ``until_ns``; the body ends on the next full ms."""
    clock = parts.clock
    clock[RECEIVED] = 0
    _post(parts)
    while clock[PLANT_NS] < until_ns:
        bus.advance(parts.network, clock[PLANT_NS])
        _deliver(parts)
        _step(step, parts)
    bus.advance(parts.network, until_ns)
    _deliver(parts)
