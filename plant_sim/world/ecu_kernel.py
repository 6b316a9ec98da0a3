"""An ECU inside the compiled loop: native firmware, called by the addresses of its C functions.

A tick: the frames received by then go to their mailboxes, the firmware runs, the frames in its
pending mailboxes are queued for the bus, and its state record is kept.
"""

from typing import Any, NamedTuple

import numpy as np
from numba.types import int32, int64, void
from numpy.typing import NDArray

from canroll.plant_sim import can_bus as bus
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.kernels.instants import STEP_NS
from canroll.plant_sim.kernels.jit import borrowed, function_at, njit
from canroll.plant_sim.nodes.codec import MAX_PAYLOAD
from canroll.plant_sim.world.world_kernel import LoopMemory, Parts, advance

MAILBOXES = 256
"""Room for the mailboxes of either direction."""

receive_at = function_at(void(int64, int32, int64, int32))
tick_at = function_at(void(int64, int64, int32))


class Firmware(NamedTuple):
    """A running native ECU; becomes one record.

    Addresses of the C functions ``receive(ecu, mailbox, payload, length)`` and
    ``tick(ecu, calibration, elapsed)``, of its records and of a payload buffer; received: key of
    the frame and mailbox; sent: key and length on the wire (0: not on the bus), and where in the
    state record the pending flags and the payloads are.
    """

    receive: int
    tick: int
    ecu: int
    calibration: int
    payload: int
    received: int
    received_key: NDArray[np.int64]
    received_mailbox: NDArray[np.int64]
    sent: int
    sent_key: NDArray[np.int64]
    sent_length: NDArray[np.int64]
    pending_at: int
    payloads_at: int
    payload_size: int


class Connection(NamedTuple):
    """A native ECU on the bus: one record of ``Firmware`` and the memory that it refers to."""

    firmware: NDArray[Any]
    image: NDArray[np.uint8]
    """Its state record."""
    buffer: NDArray[np.uint8]
    """The payload buffer."""


class TickSpan(NamedTuple):
    """Ticks to run: the instant of the last one before, their period, and the time to the frames.

    The loop ends early once ``stop_logged`` entries are in the bus log.
    """

    before_ns: int
    period_ns: int
    run_time_ns: int
    stop_logged: int


@njit
def _take_in(firmware: Firmware, world: LoopMemory, count: int, buffer: NDArray[np.uint8]) -> None:
    """Put the first ``count`` received frames into their mailboxes."""
    receive = receive_at(firmware.receive)
    for number in range(count):
        frame = world.received[number]
        key = np.int64(frame.ident)
        filled = False
        for row in range(firmware.received):
            if firmware.received_key[row] != key:
                continue
            if not filled:
                for byte in range(MAX_PAYLOAD):
                    buffer[byte] = frame.payload[byte] if byte < frame.length else 0
                filled = True
            mailbox = np.int32(firmware.received_mailbox[row])
            receive(firmware.ecu, mailbox, firmware.payload, np.int32(frame.length))


@njit
def _send(firmware: Firmware, world: LoopMemory, image: NDArray[np.uint8], t_ns: int) -> None:
    """Move the frames in the pending mailboxes to the outbox, in order."""
    clock = world.clock
    for slot in range(firmware.sent):
        if image[firmware.pending_at + slot] == 0:
            continue
        image[firmware.pending_at + slot] = 0
        length = firmware.sent_length[slot]
        if length == 0:
            continue
        frame = world.outbox[clock.outbox]
        frame.t_ns = t_ns
        frame.ident = firmware.sent_key[slot]
        frame.length = length
        first = firmware.payloads_at + slot * firmware.payload_size
        for byte in range(length):
            frame.payload[byte] = image[first + byte]
        clock.outbox += 1


@njit
def run(parts: Parts, ecu: Connection, ticks: TickSpan, images: NDArray[np.uint8]) -> int:
    """Run ticks until ``images`` is full, the vehicle has rolled over, or a record is full.

    Args:
        parts: the world.
        ecu: initialised.
        ticks: their instants.
        images: filled with the state record after each tick.

    Returns:
        Number of ticks that were run.
    """
    world, network, firmware = parts.memory[0], parts.network.state[0], ecu.firmware[0]
    image, buffer, kept = borrowed(ecu.image), borrowed(ecu.buffer), borrowed(images)
    tick = tick_at(firmware.tick)
    room = len(parts.rows) - ticks.period_ns // STEP_NS - 1
    done = 0
    t_ns = ticks.before_ns
    while (
        done < len(kept)
        and world.outputs[ports.ROLLOVER] == 0.0
        and world.clock.rows <= room
        and network.clock[bus.LOGGED] <= ticks.stop_logged
    ):
        t_ns += ticks.period_ns
        _take_in(firmware, world, advance(parts, t_ns), buffer)
        tick(firmware.ecu, firmware.calibration, np.int32(1))
        _send(firmware, world, image, t_ns + ticks.run_time_ns)
        for byte in range(len(image)):
            kept[done, byte] = image[byte]
        done += 1
    return done
