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

# Slots of Memory.clock.
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

# Memory.roles: who takes in a frame of each standard identifier.
NOBODY, FOR_ACTUATOR, FOR_ECU, FOR_ECU_IMU = range(4)
STANDARD_IDENT = 0x7FF

# Columns of Memory.outbox and of Memory.flight (commands on their way, a ring).
OUT_TIME, OUT_IDENT, OUT_LENGTH, OUT_WORD, N_OUTBOX = range(5)
FLIGHT_SUBMITTED, FLIGHT_SAMPLE, N_FLIGHT = range(3)


class Memory(NamedTuple):
    """What the loop works on besides body, driver and bus; becomes one record."""

    clock: NDArray[np.int64]
    outbox: NDArray[np.int64]
    flight: NDArray[np.int64]
    roles: NDArray[np.uint8]
    sensors: Sensors
    actuators: Actuators
    tables: Codec


class Parts(NamedTuple):
    """Everything the loop works on, in place; ``memory`` is a record of ``Memory``."""

    memory: NDArray[Any]
    state: NDArray[np.float64]
    inputs: NDArray[np.float64]
    parameters: NDArray[np.float64]
    outputs: NDArray[np.float64]
    rows: NDArray[np.float64]
    commands: NDArray[np.int64]
    received: NDArray[Any]
    payload: NDArray[np.uint8]
    drive: Drive
    network: bus.Network


@njit
def word_of(payload: NDArray[np.uint8]) -> int:
    """Payload bytes as one 64-bit word, byte 0 lowest."""
    word = 0
    for byte in range(8):
        word |= int(payload[byte]) << (8 * byte)
    return word


@njit
def _send(  # noqa: PLR0917
    network: bus.Network,
    payload: NDArray[np.uint8],
    node: int,
    t_ns: int,
    ident: int,
    length: int,
    word: int,
) -> None:
    for byte in range(8):
        payload[byte] = (word >> (8 * byte)) & 0xFF
    bus.enqueue(network, node, t_ns, ident, length, payload, 0)


@njit
def _post(world: Memory, network: bus.Network, payload: NDArray[np.uint8]) -> None:
    """Queue what the ECU has submitted, and note which sample each command can know of."""
    clock = world.clock
    for k in range(clock[OUTBOX]):
        out = world.outbox[k]
        ident = out[OUT_IDENT]
        _send(network, payload, bus.ECU, out[OUT_TIME], ident, out[OUT_LENGTH], out[OUT_WORD])
        if world.roles[ident & STANDARD_IDENT] == FOR_ACTUATOR:
            flight = world.flight[clock[SUBMISSIONS] % len(world.flight)]
            flight[FLIGHT_SUBMITTED] = out[OUT_TIME]
            flight[FLIGHT_SAMPLE] = clock[IMU_SAMPLE]
            clock[SUBMISSIONS] += 1
    clock[OUTBOX] = 0


@njit
def _accepted(world: Memory, row: NDArray[np.int64], t_origin: int, t_received: int) -> None:
    """Note a command that the actuators will apply in the next step."""
    clock = world.clock
    row[recording.SAMPLED] = NOTHING
    for back in range(1, min(clock[SUBMISSIONS], len(world.flight)) + 1):
        flight = world.flight[(clock[SUBMISSIONS] - back) % len(world.flight)]
        if flight[FLIGHT_SUBMITTED] == t_origin:
            row[recording.SAMPLED] = flight[FLIGHT_SAMPLE]
            break
    row[recording.SUBMITTED] = t_origin
    row[recording.RECEIVED] = t_received
    row[recording.COUNTER] = world.actuators.flag[actuators.COUNTER]
    clock[PENDING] = 1


@njit
def _deliver(
    world: Memory,
    network: bus.Network,
    received: NDArray[Any],
    commands: NDArray[np.int64],
) -> None:
    """Hand frames that the bus has delivered since the last call to the actuators and the ECU."""
    clock, log = world.clock, network.log
    total = bus.logged(network)
    for number in range(clock[LOG_CURSOR], total):
        entry = log[number % len(log)]
        role = world.roles[entry.ident & STANDARD_IDENT]
        if role == NOBODY or entry.outcome != bus.DELIVERED or entry.flags != 0:
            continue
        if role == FOR_ACTUATOR:
            if entry.segment != clock[ACTUATOR_SEGMENT]:
                continue
            which = actuators.listens(world.actuators, world.tables, entry.ident)
            word = word_of(entry.payload)
            if actuators.receive(world.actuators, world.tables, which, word, entry.t_received):
                row = commands[clock[APPLIED_COMMANDS]]
                _accepted(world, row, entry.t_origin, entry.t_received)
        elif entry.segment == clock[ECU_SEGMENT]:
            frame = received[clock[RECEIVED]]
            frame.t_ns = entry.t_received
            frame.ident = entry.ident
            frame.length = entry.length
            for byte in range(8):
                frame.payload[byte] = entry.payload[byte]
            clock[RECEIVED] += 1
            if role == FOR_ECU_IMU:
                clock[IMU_SAMPLE] = entry.t_origin - clock[IMU_LATENCY]
    clock[LOG_CURSOR] = total


@njit
def _sense(
    world: Memory, network: bus.Network, payload: NDArray[np.uint8], number: int, now_ns: int
) -> None:
    """Sample at every instant of the node's clock up to ``now_ns`` and queue the frames."""
    clock = world.clock
    node = world.sensors.node[number]
    message = world.tables.message[node[sensors.MESSAGE]]
    while node[sensors.NEXT] <= now_ns:
        t_ns = node[sensors.NEXT]
        word = 0
        if number == clock[STATE_NODE]:
            word = actuators.report(world.actuators, world.tables)
        word = sensors.sample(world.sensors, world.tables, number, t_ns, now_ns, clock[SEED], word)
        if not sensors.silent(world.sensors, number, t_ns):
            t_queued = t_ns + node[sensors.LATENCY]
            ident, length = message[codec.IDENT], message[codec.LENGTH]
            _send(network, payload, node[sensors.BUS_NODE], t_queued, ident, length, word)
        node[sensors.NEXT] += node[sensors.PERIOD]


@njit
def advance(step: Any, parts: Parts, until_ns: int) -> None:  # noqa: ANN401
    """Let everything happen up to and including ``until_ns``; the body ends on the next full ms."""
    world = parts.memory[0]
    clock = world.clock
    inputs, outputs = parts.inputs, parts.outputs
    clock[RECEIVED] = 0
    _post(world, parts.network, parts.payload)
    while clock[PLANT_NS] < until_ns:
        t_ns = clock[PLANT_NS]
        bus.advance(parts.network, t_ns)
        _deliver(world, parts.network, parts.received, parts.commands)
        actuators.supervise(world.actuators, t_ns)
        act(world.actuators, outputs, inputs, t_ns)
        if clock[PENDING]:
            parts.commands[clock[APPLIED_COMMANDS], recording.APPLIED] = t_ns
            clock[APPLIED_COMMANDS] += 1
            clock[PENDING] = 0
        if outputs[ports.ROLLOVER] == 0.0:
            drive(t_ns, outputs, inputs, parts.drive)
            step(parts.state, inputs, parts.parameters, outputs, 1e-3)
        t_ns += STEP_NS
        clock[PLANT_NS] = t_ns
        sensors.observe(world.sensors, inputs, outputs)
        for number in range(len(world.sensors.node)):
            if world.sensors.node[number, sensors.NEXT] <= t_ns:
                _sense(world, parts.network, parts.payload, number, t_ns)
        recording.record(parts.rows, clock[ROWS], outputs, inputs, world.actuators)
        clock[ROWS] += 1
    bus.advance(parts.network, until_ns)
    _deliver(world, parts.network, parts.received, parts.commands)
