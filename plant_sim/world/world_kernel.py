"""The compiled loop over vehicle, driver, sensors, actuators and bus.

Order within a step from t to t + 1 ms: frames received up to t reach actuators and ECU, the
actuator node runs, the driver steers, the body moves, and sensors that sample within the step
queue their frames. Nothing in a step depends on later events on the bus.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim import can_bus as bus
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.can_bus.wire.frame import ERROR_STATE, EXTENDED, RECESSIVE_INDICATOR
from canroll.plant_sim.driving.driver import DriveInputs, drive, uncounted
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import borrowed, njit, step_at
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes import actuator_kernel, authentication, codec, envelope, sensor_kernel
from canroll.plant_sim.nodes.actuator_kernel import ActuatorNode
from canroll.plant_sim.nodes.actuator_models import act
from canroll.plant_sim.nodes.authentication import NodeAuthentication
from canroll.plant_sim.nodes.codec import Codec
from canroll.plant_sim.nodes.sensor_kernel import SensorTables
from canroll.plant_sim.world import frame_kernel, recording

FRAME = np.dtype(
    [
        ("t_ns", "i8"),
        ("ident", "u4"),
        ("length", "u1"),
        ("forged", "u1"),
        ("payload", "u1", (codec.MAX_PAYLOAD,)),
    ]
)
"""A frame that the ECU receives or sends at ``t_ns``; bit 30 of ``ident``: one of 29 bits;
``forged``: an attacker sent it."""

CLOCK = np.dtype(
    fields(
        "i8",
        "plant_ns rows log_cursor received outbox submissions applied_commands pending forged "
        "imu_sample imu_latency ecu_segment actuator_segment seed state_node step states "
        "parameters",
    )
)
"""How far the loop is, then what stays.

``states`` and ``parameters`` count those of the body in use, ``step`` is the address of its step.
"""
NOTHING = -1
SENDER_STATE = ERROR_STATE | RECESSIVE_INDICATOR
"""Flags that say nothing of what a frame is."""

# Memory.roles: who takes in the frame of each message of the tables.
NOBODY, FOR_ACTUATOR, FOR_ECU, FOR_ECU_IMU = range(4)
EXTENDED_KEY = 1 << 30

FLIGHT = np.dtype(fields("i8", "t_submitted t_sample"))
"""A command on its way, in a ring."""


class LoopMemory(NamedTuple):
    """State of the loop besides driver and bus; becomes one record.

    ``state`` and ``parameters`` have room for every body's.
    """

    clock: Any
    state: NDArray[np.float64]
    inputs: NDArray[np.float64]
    parameters: NDArray[np.float64]
    outputs: NDArray[np.float64]
    received: NDArray[Any]
    payload: NDArray[np.uint8]
    outbox: NDArray[Any]
    flight: NDArray[Any]
    roles: NDArray[np.uint8]
    frames: Any
    sensors: SensorTables
    actuators: ActuatorNode
    authentication: NodeAuthentication
    tables: Codec


class Parts(NamedTuple):
    """All data of the loop, changed in place; ``memory`` is a record of ``LoopMemory``.

    Only arrays whose size differs between runs are outside the record.
    """

    memory: NDArray[Any]
    rows: NDArray[np.float64]
    commands: NDArray[Any]
    drive: DriveInputs
    network: bus.Network


@njit
def row_of(tables: Codec, key: int) -> int:
    """Row of the first message in the frame ``key`` of the tables; -1 for a foreign frame."""
    for row in range(len(tables.message)):
        if tables.message[row].key == key:
            return row
    return -1


@njit
def _key(ident: int, flags: int) -> int:
    return ident | EXTENDED_KEY if flags & EXTENDED else ident


@njit
def _post(world: LoopMemory, network: bus.State) -> None:
    """Queue the frames submitted by the ECU, and record the newest sample each command can use."""
    clock = world.clock
    for k in range(clock.outbox):
        out = world.outbox[k]
        key = int(out.ident)
        row = row_of(world.tables, key)
        flags = EXTENDED if key & EXTENDED_KEY else 0
        if row >= 0:
            flags = world.tables.message[row].flags
        frame_kernel.send(
            world.frames,
            world.tables,
            network,
            bus.ECU,
            row,
            out.t_ns,
            key & ~EXTENDED_KEY,
            int(out.length),
            out.payload,
            flags,
            clock.seed,
        )
        if row >= 0 and world.roles[row] == FOR_ACTUATOR:
            flight = world.flight[clock.submissions % len(world.flight)]
            flight.t_submitted = out.t_ns
            flight.t_sample = clock.imu_sample
            clock.submissions += 1
    clock.outbox = 0


@njit
def _accepted(world: LoopMemory, row: Any, t_origin: int, t_received: int) -> None:  # noqa: ANN401
    """Record a command that the actuators will apply in the next step."""
    clock = world.clock
    row.t_sample = NOTHING
    for back in range(1, min(clock.submissions, len(world.flight)) + 1):
        flight = world.flight[(clock.submissions - back) % len(world.flight)]
        if flight.t_submitted == t_origin:
            row.t_sample = flight.t_sample
            break
    row.t_submitted = t_origin
    row.t_received = t_received
    row.counter = world.actuators.counter
    clock.pending = 1


@njit
def _forged(world: LoopMemory, entry: Any) -> bool:  # noqa: ANN401
    """Whether an attacker has sent a frame."""
    at_ecu = world.frames.attacker_at_ecu
    at_actuator = world.frames.attacker_at_actuator
    return bool(at_ecu >= 0 and entry.sender in (at_ecu, at_actuator))


@njit
def _take(
    world: LoopMemory,
    row: int,
    entry: Any,  # noqa: ANN401
    payload: NDArray[np.uint8],
    commands: NDArray[Any],
) -> None:
    """Pass a frame of message ``row`` with ``payload`` to its receiver."""
    clock = world.clock
    role = world.roles[row]
    if role == FOR_ACTUATOR:
        which = actuator_kernel.listens(world.actuators, row)
        if not authentication.verify(
            world.authentication, world.tables, row, payload, entry.t_received
        ):
            return
        if actuator_kernel.receive(world.actuators, world.tables, which, payload, entry.t_received):
            if _forged(world, entry):
                clock.forged += 1
            applied = commands[clock.applied_commands]
            _accepted(world, applied, entry.t_origin, entry.t_received)
        return
    _hand_over(world, row, entry, payload)
    if role == FOR_ECU_IMU:
        clock.imu_sample = entry.t_origin - clock.imu_latency


@njit
def _hand_over(
    world: LoopMemory,
    row: int,
    entry: Any,  # noqa: ANN401
    payload: NDArray[np.uint8],
) -> None:
    """Pass a frame of message ``row`` with ``payload`` to the ECU."""
    clock = world.clock
    frame = world.received[clock.received]
    frame.t_ns = entry.t_received
    frame.ident = world.tables.message[row].key
    frame.length = entry.length
    frame.forged = 1 if _forged(world, entry) else 0
    for byte in range(codec.MAX_PAYLOAD):
        frame.payload[byte] = payload[byte]
    clock.received += 1


@njit
def _deliver(world: LoopMemory, network: bus.State, commands: NDArray[Any]) -> None:
    """Pass frames delivered by the bus since the last call to the actuators and the ECU."""
    clock = world.clock
    total = network.clock[bus.LOGGED]
    for number in range(clock.log_cursor, total):
        entry = network.log[number % network.clock[bus.LOG_SIZE]]
        row = row_of(world.tables, _key(entry.ident, entry.flags))
        if row < 0 or entry.flags & ~SENDER_STATE != world.tables.message[row].flags:
            continue
        if entry.length != world.tables.message[row].length:
            continue
        role = world.roles[row]
        if (
            role == FOR_ACTUATOR
            and entry.sender != bus.ECU
            and entry.segment == clock.ecu_segment
            and bus.took(entry.outcome, entry.missed, bus.ECU)
            and bus.hears(network, bus.ECU, entry.t_received)
        ):
            # a command of the ECU that somebody else has sent
            _hand_over(world, row, entry, entry.payload)
        monitor = world.actuators.envelope
        if (
            row == monitor.frame
            and entry.segment == clock.actuator_segment
            and bus.took(entry.outcome, entry.missed, bus.ACTUATOR)
            and bus.hears(network, bus.ACTUATOR, entry.t_received)
        ):
            supervision = world.actuators.supervision
            if authentication.verify(
                world.authentication, world.tables, row, entry.payload, entry.t_received
            ):
                envelope.hear(monitor, world.tables, supervision, entry.payload, entry.t_received)
                if _forged(world, entry):
                    clock.forged += 1
        receiver = bus.ACTUATOR if role == FOR_ACTUATOR else bus.ECU
        if role == NOBODY or not bus.took(entry.outcome, entry.missed, receiver):
            continue
        segment = clock.actuator_segment if role == FOR_ACTUATOR else clock.ecu_segment
        if entry.segment != segment:
            continue
        frames = world.frames
        at_ecu = frames.attacker_at_ecu
        if at_ecu >= 0 and not _forged(world, entry):
            at_actuator = frames.attacker_at_actuator
            attacker = at_actuator if role == FOR_ACTUATOR else at_ecu
            frame_kernel.attack(
                frames,
                world.authentication,
                world.tables,
                network,
                attacker,
                row,
                entry,
                world.payload,
            )
        if not bus.hears(network, receiver, entry.t_received):
            continue
        if frame_kernel.lost(frames, row, entry.t_received, clock.seed):
            continue
        if frames.fault[0].places == 0:
            _take(world, row, entry, entry.payload, commands)
            continue
        payload = world.payload
        for byte in range(codec.MAX_PAYLOAD):
            payload[byte] = entry.payload[byte] if byte < entry.length else 0
        frame_kernel.damage(frames, row, entry.t_received, entry.length, payload, clock.seed)
        _take(world, row, entry, payload, commands)
    clock.log_cursor = total


@njit
def sense(world: LoopMemory, network: bus.State, number: int, now_ns: int) -> None:
    """Sample at every instant of the node's clock up to ``now_ns`` and queue the frames."""
    clock = world.clock
    node = world.sensors.node[number]
    message = world.tables.message[node.message]
    payload = world.payload
    while node.next <= now_ns:
        t_ns = node.next
        payload[:] = 0
        for other in range(len(world.sensors.node)):
            row = world.sensors.node[other].message
            if row < 0 or world.tables.message[row].leader != node.message:
                continue
            if world.sensors.node[other].sensor == clock.state_node:
                held = sensor_kernel.node_fault(world.sensors, other, sensor_kernel.FROZEN, t_ns)
                actuator_kernel.report(world.actuators, world.tables, row, payload, held > 0.0)
            sensor_kernel.sample(
                world.sensors, world.tables, other, t_ns, now_ns, clock.seed, payload
            )
        sensor_kernel.finish(world.sensors, world.tables, number, payload)
        if not sensor_kernel.silent(world.sensors, number, t_ns):
            authentication.protect(
                world.authentication,
                world.tables,
                node.message,
                payload,
                node.samples == 1,
            )
            t_queued = t_ns + node.latency
            frame_kernel.send(
                world.frames,
                world.tables,
                network,
                node.bus_node,
                node.message,
                t_queued,
                message.ident,
                message.length,
                payload,
                message.flags,
                clock.seed,
            )
        node.next += sensor_kernel.period(world.sensors, number, t_ns)


@njit
def second_half(parts: Parts, t_ns: int) -> None:
    """Call what :func:`advance` calls after the bus, last first: for another process to compile."""
    world, network = parts.memory[0], parts.network.state[0]
    rows, commands, driver = borrowed(parts.rows), borrowed(parts.commands), uncounted(parts.drive)
    inputs, outputs = world.inputs[:], world.outputs[:]
    recording.record(rows, 0, outputs, inputs, world.actuators)
    sense(world, network, 0, t_ns)
    sensor_kernel.observe(world.sensors, inputs, outputs)
    drive(t_ns, outputs, inputs, driver)
    act(world.actuators, outputs, inputs, t_ns)
    actuator_kernel.supervise(world.actuators, t_ns)
    _deliver(world, network, commands)


@njit
def advance(parts: Parts, until_ns: int) -> int:
    """Advance up to and including ``until_ns``; the body ends on the next full ms.

    Returns:
        received: number of frames received by the ECU: the first of ``Memory.received``.
    """
    world, network = parts.memory[0], parts.network.state[0]
    rows, commands, driver = borrowed(parts.rows), borrowed(parts.commands), uncounted(parts.drive)
    clock = world.clock
    # Views into the record: unlike separate arrays they have no references to be counted.
    inputs, outputs = world.inputs[:], world.outputs[:]
    state, parameters = world.state[: clock.states], world.parameters[: clock.parameters]
    step = step_at(clock.step)
    clock.received = 0
    _post(world, network)
    while clock.plant_ns < until_ns:
        t_ns = clock.plant_ns
        bus.run(network, t_ns)
        if clock.log_cursor < network.clock[bus.LOGGED]:
            _deliver(world, network, commands)
        actuator_kernel.supervise(world.actuators, t_ns)
        act(world.actuators, outputs, inputs, t_ns)
        if clock.pending:
            commands[clock.applied_commands].t_applied = t_ns
            clock.applied_commands += 1
            clock.pending = 0
        if outputs[ports.ROLLOVER] == 0.0:
            drive(t_ns, outputs, inputs, driver)
            step(state, inputs, parameters, outputs, 1e-3)
        t_ns += STEP_NS
        clock.plant_ns = t_ns
        sensor_kernel.observe(world.sensors, inputs, outputs)
        for number in range(len(world.sensors.node)):
            if world.sensors.node[number].next <= t_ns:
                sense(world, network, number, t_ns)
        recording.record(rows, clock.rows, outputs, inputs, world.actuators)
        clock.rows += 1
    bus.run(network, until_ns)
    _deliver(world, network, commands)
    received: int = clock.received
    return received
