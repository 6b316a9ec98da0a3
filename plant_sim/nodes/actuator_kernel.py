"""The smart actuator node: accepts, holds, times out, acknowledges and reports.

The node runs every 1 ms, on the plant's grid. A command frame takes effect if end-to-end protection
accepts it; it is held until the command timeout, then fades to zero within one period of the body's
roll, which hardly overshoots, and at once where it would push outward. A disabled node accepts and
acknowledges commands and delivers nothing.
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from canroll.plant_sim.kernels import schedule
from canroll.plant_sim.kernels.jit import njit
from canroll.plant_sim.kernels.records import fields
from canroll.plant_sim.nodes import codec, e2e, envelope, hydraulics
from canroll.plant_sim.nodes.codec import Codec
from canroll.vehicles.actuators import Bars, Dampers, SuspensionActuator, Valves

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

NO_COUNTER = -1
"""All bits of the echo are set, as long as no command has been accepted."""

# Room in the node's tables: accepted messages, points of the damper map, faults.
MESSAGES, CURVE_POINTS, FAULTS = 2, 8, 16

ACTUATOR_NODE = np.dtype(
    [
        *fields("f8", "lag limit rate fade power estimate_gain estimate_lag current_limit"),
        *fields("f8", "integrated"),
        *fields("f8", "half_track", 2),
        ("hydraulics", hydraulics.VALVE),
        *fields("f8", "curve", 3, CURVE_POINTS),
        ("message", fields("i8", "row first_signal channels"), (MESSAGES,)),
        *fields("i8", "report", 9),
        ("fault", schedule.FAULT, (FAULTS,)),
        ("supervision", fields("i8", " ".join(e2e.Supervision._fields))),
        *fields("i8", "kind enabled powered timeout held counter source t_accepted rejected"),
        *fields("i8", "status latched", 4),
        *fields("f8", "demand reference fading actual applied", 4),
        *fields("f8", "delivered estimate reported", 2),
        *fields("f8", "motor", 2, 5),
        ("receiver", e2e.RECEIVER, (MESSAGES,)),
        ("envelope", envelope.ENVELOPE),
    ]
)
"""An actuator node: its settings, the messages that it takes and sends, faults, then its state.

``lag`` is the share of the way to its reference that a channel goes in a step, ``rate`` the
reference's change in a step, ``fade`` the share of it that goes after a command; ``integrated``:
the body includes the hydraulics. ``status`` and ``latched`` are of the corners, ``demand`` to
``applied`` of the channels, the next of the axles. ``fading`` is what the reference loses in a step
without a command, ``reported`` the estimate in the last ActuatorState, ``motor`` the hydraulics.
"""
ActuatorNode: TypeAlias = Any


@njit
def listens(node: ActuatorNode, message: int) -> int:
    """Index of row ``message`` of the tables among the node's messages; -1 for none."""
    for which in range(MESSAGES):
        if message >= 0 and node.message[which].row == message:
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
    number = row.row
    status = e2e.check(
        node.receiver[which],
        node.supervision,
        tables.protection[number],
        payload,
    )
    if status not in (e2e.OK, e2e.SOME_LOST, e2e.INITIAL):
        node.rejected += 1
        return False
    for channel in range(row.channels):
        signal = row.first_signal + channel
        raw = codec.extract(tables, signal, payload)
        value = codec.physical(tables, signal, raw)
        accepted = codec.valid(tables, signal, raw) and codec.agrees(tables, signal, payload)
        node.demand[channel] = value if accepted else 0.0
    node.held = 1
    node.counter = e2e.counter_of(tables.protection[number], payload)
    node.source = which
    node.t_accepted = t_ns
    return True


@njit
def supervise(node: ActuatorNode, t_ns: int) -> None:
    """Release a command that was not renewed within the timeout; judge it by the envelope."""
    if node.held and t_ns - node.t_accepted > node.timeout:
        node.held = 0
        node.demand[:] = 0.0
    if not node.held and envelope.outward(node.envelope, _fading_moment(node), t_ns):
        node.fading[:] = np.inf
    if not node.enabled:
        return
    demand = node.demand
    front = envelope.moment_of(node.envelope, 0, demand)
    rear = envelope.moment_of(node.envelope, 1, demand)
    if node.kind == VALVES and node.source == 0:
        front, rear = node.delivered[0], node.delivered[1]
    if envelope.cuts(node.envelope, front, rear, t_ns):
        for corner in range(4):
            node.latched[corner] = max(node.latched[corner], STATUS_LIMITED)


@njit
def _fading_moment(node: ActuatorNode) -> float:
    """Roll moment (N·m) of what is left of a command; of valves the channels are moments."""
    left = node.reference
    if node.kind == VALVES:
        return float(left[0] + left[1])
    return envelope.moment_of(node.envelope, 0, left) + envelope.moment_of(node.envelope, 1, left)


@njit
def follows(node: ActuatorNode) -> bool:
    """Whether the node follows its command: it is enabled, and its envelope does not refuse."""
    return bool(node.enabled and node.envelope.acted == 0.0)


@njit
def set_status(node: ActuatorNode, corners: int, status: int) -> None:
    """Record the status of ``corners`` (bit by bit); the worst is kept until reported."""
    for corner in range(4):
        if corners >> corner & 1:
            node.status[corner] = status
            node.latched[corner] = max(node.latched[corner], status)


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
            node.reported[axle] = node.estimate[axle]
        raw = codec.raw_value(tables, signal, node.reported[axle])
        codec.put(tables, message, signal, payload, raw)
    for corner in range(4):
        status = node.report[2 + corner]
        if tables.field[status].frame == message:
            codec.insert(tables, status, payload, node.latched[corner])
            node.latched[corner] = node.status[corner]
    codec.put(tables, message, node.report[6], payload, node.enabled)
    codec.put(tables, message, node.report[7], payload, node.held)
    codec.put(tables, message, node.report[8], payload, node.counter)
