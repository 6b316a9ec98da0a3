"""The ECU's loop: at absolute deadlines, or tick by tick as granted by the plant.

Tick k is due at a fixed instant on the monotonic clock, so lateness does not accumulate; a loop
locked to the sensor follows the sensor's clock. If a tick would start a whole period late, or runs
into the next deadline, the loop skips: the firmware gets the number of elapsed periods, as on a
microcontroller whose timer kept counting, and nothing is made up for. Within a tick there is no
logging, waiting or garbage collection.
"""

import time
from dataclasses import dataclass

from canroll.codegen.run.backends import Backend
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.codegen.run.secured import SecuredEcu
from canroll.firmware.calibration import Calibration
from canroll.firmware.event_trigger import command_slot
from canroll.firmware.state import RX_IMU, SAFE
from canroll.hil.bus_link import Frame, Link
from canroll.hil.lockstep import Grants
from canroll.hil.phase_lock import PhaseLock
from canroll.hil.process import Stop, collector_off
from canroll.hil.tick_trace import TickRecorder

STOPPED, PEER_LOST, DURATION = "stopped", "peer lost", "duration over"
PLANT_ENDED = "plant ended"
AWAKE_NS = 300_000
"""The bus is not waited on for the last bit of a period: not every driver's timeout is exact."""


@dataclass(frozen=True, slots=True)
class EcuOutcome:
    """Outcome of a loop: reason for its end, ticks run, ticks skipped, final mode of the ECU.

    ``not_valid``: why a run in lock step is not one run with one plant; "": it is.
    """

    reason: str
    ticks: int
    misses: int
    mode: int
    not_valid: str = ""


def run(
    ecu: Backend,
    link: Link,
    recorder: TickRecorder,
    calibration: Calibration,
    *,
    stop: Stop,
    duration_ns: int | None = None,
    peer_timeout_ns: int | None = None,
    lock: PhaseLock | None = None,
    firmware: BusFirmware | None = None,
) -> EcuOutcome:
    """Run ``ecu`` on ``link`` until a stop request, loss of the vehicle or the end of the duration.

    At the end the first action is to command zero to the actuators.

    Args:
        ecu: initialised from ``calibration``.
        link: the bus.
        recorder: records the trace.
        calibration: defines the period and the command message.
        stop: checked once per tick.
        duration_ns: duration of the run.
        peer_timeout_ns: end when the vehicle, once heard, is silent for this long; None: never.
        lock: keeps the ticks at a phase after the Imu frames; None: free-running ticks.
        firmware: firmware for the bus, by default the built-in one.
    """
    firmware = firmware or built_in()
    imu = firmware.bus.received[RX_IMU].ident
    clock = time.monotonic_ns
    period = calibration.tick_us * 1000
    command_id, length = firmware.sent[command_slot(calibration)]
    command = bytes(length)
    ours = firmware.heard
    number = ticks = last_heard = 0
    elapsed = 1
    with collector_off():
        link.receive()  # what has piled up before the first tick is stale
        began = clock()
        deadline = began + period
        while True:
            if lock is not None:
                deadline += lock.correction(deadline)
            frames = _wait(link, deadline, lock, imu)
            start = clock()
            late = (start - deadline) // period
            elapsed += late
            number += elapsed
            for ident, payload in [*frames, *link.receive()]:
                if ident in ours:
                    ecu.receive(ident, payload, len(payload))
                    recorder.consumed(ident, payload)
                    last_heard = start
            for ident, payload in ecu.tick(elapsed):
                link.send(ident, payload)
                recorder.sent(ident, payload)
                if ident == command_id:
                    command = payload
            end = clock()
            recorder.tick(number, elapsed, deadline, start, end)
            ticks += 1
            if stop.requested:
                reason = STOPPED
                break
            if duration_ns is not None and end - began >= duration_ns:
                reason = DURATION
                break
            if peer_timeout_ns is not None and 0 < last_heard < end - peer_timeout_ns:
                reason = PEER_LOST
                break
            due = deadline + (late + 1) * period
            skipped = max(0, -(-(end - due) // period))
            elapsed = 1 + skipped
            deadline = due + skipped * period
        link.send(*last_command(ecu, calibration, command, firmware))
    return EcuOutcome(reason, ticks, number - ticks, ecu.state.mode)


def _wait(link: Link, deadline: int, lock: PhaseLock | None, imu: int) -> list[Frame]:
    """Wait for a deadline; return the frames received meanwhile.

    ``imu`` is the identifier that the lock follows. Only a lock needs arrival times: without one
    the frames wait in the driver.
    """
    frames = []
    while (rest := deadline - time.monotonic_ns()) > 0:
        if lock is None or rest <= AWAKE_NS:
            time.sleep(rest * 1e-9)
        elif (frame := link.next((rest - AWAKE_NS) * 1e-9)) is not None:
            if frame[0] == imu:
                lock.arrived(time.monotonic_ns())
            frames.append(frame)
    return frames


def run_granted(
    ecu: Backend,
    link: Link,
    grants: Grants,
    recorder: TickRecorder,
    calibration: Calibration,
    *,
    stop: Stop,
    duration_ns: int | None = None,
    peer_timeout: float | None = None,
    firmware: BusFirmware | None = None,
) -> EcuOutcome:
    """Run ``ecu`` in lock step: one tick for every grant, whenever it arrives.

    In the trace tick k is due, and starts, at k periods; its duration is measured.

    Args:
        ecu: initialised from ``calibration``.
        link: the bus.
        grants: the plant's grants.
        recorder: records the trace.
        calibration: defines the period and the command message.
        stop: checked while waiting.
        duration_ns: granted time after which the run ends.
        peer_timeout: time without a grant after which the plant is lost, s; None: never.
        firmware: firmware for the bus, by default the built-in one.

    Raises:
        VerdictError: frames were lost.
    """
    firmware = firmware or built_in()
    period = calibration.tick_us * 1000
    command_id, length = firmware.sent[command_slot(calibration)]
    command = bytes(length)
    number = ticks = 0
    reason = DURATION
    with collector_off():
        while duration_ns is None or number * period < duration_ns:
            grant = grants.wait(peer_timeout)
            if grant is None:
                reason = PLANT_ENDED if grants.ended else PEER_LOST
                reason = STOPPED if stop.requested else reason
                break
            began = time.monotonic_ns()
            elapsed = grant.number - number if 0 < number < grant.number else 1
            number = grant.number
            for ident, payload in grant.frames:
                ecu.receive(ident, payload, len(payload))
                recorder.consumed(ident, payload)
            answer = ecu.tick(elapsed)
            for ident, payload in answer:
                link.send(ident, payload)
                recorder.sent(ident, payload)
                if ident == command_id:
                    command = payload
            grants.done(len(answer))
            due = number * period
            recorder.tick(number, elapsed, due, due, due + time.monotonic_ns() - began)
            ticks += 1
        link.send(*last_command(ecu, calibration, command, firmware))
        grants.end(1)
    lost = f"the plant was lost after tick {number}" if reason == PEER_LOST and ticks else ""
    return EcuOutcome(reason, ticks, 0, ecu.state.mode, grants.not_valid or lost)


def last_command(
    ecu: Backend, calibration: Calibration, last: bytes, firmware: BusFirmware
) -> Frame:
    """Return :func:`zero_command` as ``ecu`` sends it on its bus."""
    frame = zero_command(calibration, last, firmware)
    return ecu.protected(frame) if isinstance(ecu, SecuredEcu) else frame


def zero_command(
    calibration: Calibration, last: bytes, firmware: BusFirmware | None = None
) -> Frame:
    """Return the command frame with zero commands, in mode SAFE.

    Args:
        calibration: defines the command message and its protection.
        last: payload of the last command sent, whose counter is continued.
        firmware: firmware for the bus, by default the built-in one.
    """
    firmware = firmware or built_in()
    ecu = firmware.record()
    slot = command_slot(calibration)
    ecu.mode = SAFE
    ecu.tx_counter[slot] = firmware.bus.transmitted[slot].count(last)
    firmware.module("com.signals").pack(ecu, slot)
    firmware.module("com.transmit").queue(ecu, calibration, slot)
    ident, length = firmware.sent[slot]
    return ident, bytes(ecu.tx_payload[slot][:length])
