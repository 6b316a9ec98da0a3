"""The smart actuator node: accepts, holds, times out, acknowledges and reports.

The node runs every 1 ms, on the plant's grid. A command frame takes effect if end-to-end protection
accepts it; it is held until the command timeout, then fades to zero within one period of the body's
roll, which hardly overshoots, and at once where it would push outward. A disabled node accepts and
acknowledges commands and delivers nothing.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels.jit import njit
from plant_sim.kernels.schedule import Faults
from plant_sim.nodes import codec, e2e, envelope
from plant_sim.nodes.codec import Codec
from plant_sim.nodes.envelope import Envelope
from vehicles.actuators import Bars, Dampers, SuspensionActuator, Valves

SUSPENSION, BARS, DAMPERS, VALVES = (
    kind.number for kind in (SuspensionActuator, Bars, Dampers, Valves)
)

# Status of a corner, as the DBC numbers it.
STATUS_OK, STATUS_LIMITED, STATUS_STUCK, STATUS_FLOATING = range(4)
# Kinds of faults; the places of a row of Actuators.fault are the corners.
FAULT_NAMES = (
    *("stuck", "floating", "weak", "dead", "slow", "reversed", "runaway", "derating", "lying"),
)
STUCK, FLOATING, WEAK, DEAD, SLOW, REVERSED, RUNAWAY, DERATING, LYING = range(9)

# Slots of Actuators.flag. STATUS, LATCHED: one for each corner.
(
    KIND,
    ENABLED,
    POWERED,
    HELD,
    COUNTER,
    SOURCE,
    TIMEOUT,
    T_ACCEPTED,
    REJECTED,
    STATUS,
) = range(10)
LATCHED = STATUS + 4
N_FLAGS = LATCHED + 4
NO_COUNTER = -1
"""All bits of the echo are set, as long as no command has been accepted."""

# Slots of Actuators.state: four channels each, then both axles each, then the hydraulics.
# FADING is what the reference loses in a step without a command, REPORTED the value of the last
# ActuatorState.
DEMAND, REFERENCE, FADING, ACTUAL, APPLIED = 0, 4, 8, 12, 16
DELIVERED, ESTIMATE, REPORTED = 20, 22, 24
HYDRAULICS = 26
N_STATE = HYDRAULICS + 10

# Columns of Actuators.message.
MESSAGE, FIRST_SIGNAL, CHANNELS = range(3)

# Room in the node's tables: accepted messages, points of the damper map, faults.
MESSAGES, CURVE_POINTS, FAULTS = 2, 8, 16


class ActuatorNode(NamedTuple):
    """One actuator node: configuration, state, accepted messages with their E2E receivers."""

    setting: NDArray[np.float64]
    curve: NDArray[np.float64]
    state: NDArray[np.float64]
    flag: NDArray[np.int64]
    message: NDArray[np.int64]
    receiver: NDArray[np.int64]
    report: NDArray[np.int64]
    fault: Faults
    supervision: e2e.Supervision
    envelope: Envelope


@njit
def listens(node: ActuatorNode, message: int) -> int:
    """Index of row ``message`` of the tables among the node's messages; -1 for none."""
    for which in range(MESSAGES):
        if message >= 0 and node.message[which, MESSAGE] == message:
            return which
    return -1


@njit
def receive(
    node: ActuatorNode, tables: Codec, which: int, payload: NDArray[np.uint8], t_ns: int
) -> bool:
    """Receive a command frame at ``t_ns``; return whether it was accepted.

    For a signal with the error or not-available code, or contradicted by its second signal, the
    demand of its channel is zero.
    """
    row = node.message[which]
    number = row[MESSAGE]
    status = e2e.check(
        node.receiver[which],
        node.supervision,
        tables.protection[number],
        tables.terms[number],
        tables.crc[number],
        payload,
    )
    if status not in (e2e.OK, e2e.SOME_LOST, e2e.INITIAL):
        node.flag[REJECTED] += 1
        return False
    for channel in range(row[CHANNELS]):
        signal = row[FIRST_SIGNAL] + channel
        raw = codec.extract(tables, signal, payload)
        value = codec.physical(tables, signal, raw)
        accepted = codec.valid(tables, signal, raw) and codec.agrees(tables, signal, payload)
        node.state[DEMAND + channel] = value if accepted else 0.0
    node.flag[HELD] = 1
    node.flag[COUNTER] = e2e.counter_of(tables.protection[number], tables.terms[number], payload)
    node.flag[SOURCE] = which
    node.flag[T_ACCEPTED] = t_ns
    return True


@njit
def supervise(node: ActuatorNode, t_ns: int) -> None:
    """Release a command that was not renewed within the timeout; judge it by the envelope."""
    if node.flag[HELD] and t_ns - node.flag[T_ACCEPTED] > node.flag[TIMEOUT]:
        node.flag[HELD] = 0
        node.state[DEMAND : DEMAND + 4] = 0.0
    if not node.flag[HELD] and envelope.outward(node.envelope, _fading_moment(node), t_ns):
        node.state[FADING : FADING + 4] = np.inf
    if not node.flag[ENABLED]:
        return
    demand = node.state[DEMAND : DEMAND + 4]
    front = envelope.moment_of(node.envelope, 0, demand)
    rear = envelope.moment_of(node.envelope, 1, demand)
    if node.flag[KIND] == VALVES and node.flag[SOURCE] == 0:
        front, rear = node.state[DELIVERED], node.state[DELIVERED + 1]
    if envelope.cuts(node.envelope, front, rear, t_ns):
        for corner in range(4):
            node.flag[LATCHED + corner] = max(node.flag[LATCHED + corner], STATUS_LIMITED)


@njit
def _fading_moment(node: ActuatorNode) -> float:
    """Roll moment (N·m) of what is left of a command; of valves the channels are moments."""
    left = node.state[REFERENCE : REFERENCE + 4]
    if node.flag[KIND] == VALVES:
        return float(left[0] + left[1])
    return envelope.moment_of(node.envelope, 0, left) + envelope.moment_of(node.envelope, 1, left)


@njit
def follows(node: ActuatorNode) -> bool:
    """Whether the node follows its command: it is enabled, and its envelope does not refuse."""
    return bool(node.flag[ENABLED] and node.envelope.memory[envelope.ACTED] == 0.0)


@njit
def set_status(node: ActuatorNode, corners: int, status: int) -> None:
    """Record the status of ``corners`` (bit by bit); the worst is kept until reported."""
    for corner in range(4):
        if corners >> corner & 1:
            node.flag[STATUS + corner] = status
            node.flag[LATCHED + corner] = max(node.flag[LATCHED + corner], status)


@njit
def report(
    node: ActuatorNode, tables: Codec, message: int, payload: NDArray[np.uint8], frozen: bool
) -> None:
    """Write ActuatorState to a payload, except its sample counter; clear the latched status.

    ``message``: row of the frame, which may have a part of it. ``frozen``: with the moments of the
    last one.
    """
    for axle in range(2):
        signal = node.report[axle]
        if not frozen:
            node.state[REPORTED + axle] = node.state[ESTIMATE + axle]
        raw = codec.raw_value(tables, signal, node.state[REPORTED + axle])
        codec.put(tables, message, signal, payload, raw)
    for corner in range(4):
        status = node.report[2 + corner]
        if tables.field[status, codec.FRAME] == message:
            codec.insert(tables, status, payload, node.flag[LATCHED + corner])
            node.flag[LATCHED + corner] = node.flag[STATUS + corner]
    codec.put(tables, message, node.report[6], payload, node.flag[ENABLED])
    codec.put(tables, message, node.report[7], payload, node.flag[HELD])
    codec.put(tables, message, node.report[8], payload, node.flag[COUNTER])
