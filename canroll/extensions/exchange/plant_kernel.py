"""The plant without a bus, in the kernels' subset: translated to C, never compiled by Numba.

``Plant`` is the record of a world's memory, with the driver and a queue of frames to be sent
instead of the network. Everything in a step is the world's; only what carries frames differs.
"""

from typing import Any

import numpy as np

from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving.driver import drive
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.nodes import actuator_kernel, envelope, sensor_kernel
from canroll.plant_sim.nodes.actuator_models import act
from canroll.plant_sim.world import recording
from canroll.plant_sim.world.world_kernel import FOR_ACTUATOR, SENDER_STATE, row_of, sense
from canroll.typing import Vector

Plant = Any
Payload = np.ndarray
QUEUE = 64
ENTRY = np.dtype(
    [
        ("t_ns", "i8"),
        ("node", "i8"),
        ("ident", "i8"),
        ("length", "i8"),
        ("flags", "i8"),
        ("payload", "u1", (64,)),
    ],
    align=True,
)
OUTGOING = np.dtype([("count", "i8"), ("entries", ENTRY, (QUEUE,))], align=True)
"""Frames to be sent, earliest first."""


def body_step(
    state: Vector, inputs: Vector, parameters: Vector, outputs: Vector, dt: float
) -> None:
    """Stand for the body's step, which the translation puts here."""


def post(  # noqa: PLR0917
    queue: Any,  # noqa: ANN401
    node: int,
    t_ns: int,
    ident: int,
    length: int,
    payload: Payload,
    flags: int,
    bits: int,
    late_ns: int,
) -> None:
    """Put a frame into the queue, behind those of the same instant; what has no room is lost.

    ``bits`` and ``late_ns`` are for networks, which keep them with the frame.
    """
    if queue.count >= QUEUE:
        return
    at = queue.count
    queue.count += 1
    while at > 0 and queue.entries[at - 1].t_ns > t_ns:
        later, earlier = queue.entries[at], queue.entries[at - 1]
        later.t_ns = earlier.t_ns
        later.node = earlier.node
        later.ident = earlier.ident
        later.length = earlier.length
        later.flags = earlier.flags
        for k in range(64):
            later.payload[k] = earlier.payload[k]
        at -= 1
    entry = queue.entries[at]
    entry.t_ns = t_ns
    entry.node = node
    entry.ident = ident
    entry.length = length
    entry.flags = flags
    for k in range(64):
        entry.payload[k] = payload[k]


def take(queue: Any) -> None:  # noqa: ANN401
    """Remove the earliest frame."""
    queue.count -= 1
    for at in range(queue.count):
        entry, later = queue.entries[at], queue.entries[at + 1]
        entry.t_ns = later.t_ns
        entry.node = later.node
        entry.ident = later.ident
        entry.length = later.length
        entry.flags = later.flags
        for k in range(64):
            entry.payload[k] = later.payload[k]


def receive(  # noqa: PLR0917
    plant: Plant, key: int, flags: int, length: int, payload: Payload, t_ns: int
) -> None:
    """Give a frame received at ``t_ns`` to the actuator node; see ``world_kernel``."""
    row = row_of(plant.tables, key)
    if row < 0 or flags & ~SENDER_STATE != plant.tables.message[row].flags:
        return
    if length != plant.tables.message[row].length:
        return
    monitor = plant.actuators.envelope
    if row == monitor.frame:
        envelope.hear(monitor, plant.tables, plant.actuators.supervision, payload, t_ns)
    if plant.roles[row] == FOR_ACTUATOR:
        which = actuator_kernel.listens(plant.actuators, row)
        actuator_kernel.receive(plant.actuators, plant.tables, which, payload, t_ns)


def command(plant: Plant, which: int, demands: Vector, channels: int, t_ns: int) -> None:
    """Give demands to the actuators at ``t_ns``, as message ``which`` of theirs would."""
    for channel in range(channels):
        plant.actuators.demand[channel] = demands[channel]
    plant.actuators.held = 1
    plant.actuators.source = which
    plant.actuators.t_accepted = t_ns


def advance(plant: Plant) -> None:
    """Advance by one step of 1 ms."""
    t_ns = plant.clock.plant_ns
    actuator_kernel.supervise(plant.actuators, t_ns)
    act(plant.actuators, plant.outputs, plant.inputs, t_ns)
    if plant.outputs[ports.ROLLOVER] == 0.0:
        drive(t_ns, plant.outputs, plant.inputs, plant.drive)
        body_step(plant.state, plant.inputs, plant.parameters, plant.outputs, 1e-3)
    t_ns += STEP_NS
    plant.clock.plant_ns = t_ns
    sensor_kernel.observe(plant.sensors, plant.inputs, plant.outputs)
    for number in range(len(plant.sensors.node)):
        if plant.sensors.node[number].next <= t_ns:
            sense(plant, plant.queue, number, t_ns)


def record(plant: Plant, row: Any) -> None:  # noqa: ANN401
    """Fill the one row of ``row`` with the signals at the end of the last step."""
    recording.record(row.values, 0, plant.outputs, plant.inputs, plant.actuators)
