"""The plant's loop: the world in step with the wall clock, its frames on a real bus.

The world models the bus with all its delays; the real bus is only a carrier. Frames that the
modelled bus has delivered to the ECU are sent, frames from the ECU are queued at the modelled
controller at once. After a late wake-up the world catches up in one step: plant time always
equals the wall clock's.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canroll import dbc
from canroll.codegen.run.bus_firmware import BusFirmware, built_in
from canroll.hil.bus_link import Link
from canroll.hil.lockstep import GrantedEcu, PeerLostError
from canroll.hil.process import Stop, collector_off
from canroll.plant_sim.world.world import World
from canroll.runs.virtual_time import ticks

FINISHED, STOPPED, PEER_LOST = "finished", "stopped", "peer lost"

STEP_NS = 500_000
"""Period of the loop: frames wait for it in both directions, so it is half the body's step."""
LAST_NS = 100_000_000
"""Time for which a plant in lock step continues after the ECU has announced its end."""


@dataclass(frozen=True, slots=True)
class PlantOutcome:
    """Outcome of the loop: reason for its end, monotonic instants of plant time 0 and the end.

    ``loop``: lateness of every period against its deadline and its duration, ns, shape (n, 2);
    none in lock step, which has no clock and where plant time 0 is the instant 0. ``wall_ns``:
    duration of the loop by the clock. ``refused``: frames with an identifier of the ECU that were
    not put on the modelled bus: longer than the ECU's, or more in one period than a node can queue.
    ``not_valid``: why a run in lock step is not one run with one ECU; "": it is.
    """

    reason: str
    start_ns: int
    end_ns: int
    loop: NDArray[np.int64]
    wall_ns: int
    refused: int = 0
    not_valid: str = ""


def sent_by(firmware: BusFirmware) -> frozenset[int]:
    """Return the identifiers of the frames that an ECU sends."""
    return frozenset(ident for ident, length in firmware.sent if length)


def sent_to(firmware: BusFirmware) -> frozenset[int]:
    """Return the identifiers of the frames that a plant sends, in lock step, to an ECU."""
    if firmware.bus is not built_in().bus:
        return frozenset(firmware.slots)
    # it sends what the ECU does not hear too
    return frozenset(message.frame_id for message in dbc.load().messages) - sent_by(firmware)


def wait_for_ecu(
    link: Link, *, stop: Stop, timeout: float, firmware: BusFirmware | None = None
) -> bool:
    """Wait until the ECU is heard; return False after ``timeout`` seconds or on a stop request.

    ``firmware`` is the firmware for the bus, by default the built-in one.
    """
    idents = sent_by(firmware or built_in())
    until = time.monotonic() + timeout
    while not stop.requested and time.monotonic() < until:
        if any(ident in idents for ident, _ in link.receive()):
            return True
        time.sleep(0.005)
    return False


def run(
    world: World,
    link: Link,
    *,
    stop: Stop,
    duration_ns: int,
    step_ns: int = STEP_NS,
    peer_timeout_ns: int | None = None,
    announce: Callable[[], None] = lambda: None,
    firmware: BusFirmware | None = None,
) -> PlantOutcome:
    """Keep ``world`` in step with the clock until the manoeuvre is over.

    Args:
        world: at time 0.
        link: the bus.
        stop: checked once per period.
        duration_ns: length of the run.
        step_ns: period of the loop, in which frames are passed on.
        peer_timeout_ns: end when the ECU, once heard, is silent for this long; None: never.
        announce: called once when the clock has started.
        firmware: firmware for the bus, by default the built-in one.
    """
    clock, sleep = time.monotonic_ns, time.sleep
    longest = dict((firmware or built_in()).sent)
    loop = np.zeros((duration_ns // step_ns + 2, 2), dtype=np.int64)
    world.advance(0)
    reason = FINISHED
    last_heard = done = refused = 0
    with collector_off():
        began = deadline = clock()
        announce()
        while world.now_ns < duration_ns and not world.rolled_over:
            while (wait := deadline - clock()) > 0:
                sleep(wait * 1e-9)
            start = clock()
            now = min(start - began, duration_ns)
            for ident, payload in link.receive():
                # a babbling or hostile node must not end the plant
                if not longest.get(ident):
                    continue
                last_heard = start
                if len(payload) > longest[ident] or not world.room:
                    refused += 1
                else:
                    world.submit(now, ident, payload)
            for frame in world.advance(now):
                link.send(int(frame["ident"]), frame["payload"][: frame["length"]].tobytes())
            end = clock()
            loop[done] = start - deadline, end - start
            done += 1
            if stop.requested:
                reason = STOPPED
                break
            if peer_timeout_ns is not None and 0 < last_heard < end - peer_timeout_ns:
                reason = PEER_LOST
                break
            deadline += step_ns * max(1, -(-(end - deadline) // step_ns))
        ended = clock()
    return PlantOutcome(reason, began, ended, loop[:done], ended - began, refused)


def run_granting(
    world: World, ecu: GrantedEcu, *, stop: Stop, duration_ns: int, offset_ns: int = 0
) -> PlantOutcome:
    """Drive ``world`` in lock step with an ECU that has answered.

    Args:
        world: at time 0.
        ecu: the ECU behind the bus.
        stop: checked once per tick.
        duration_ns: length of the run.
        offset_ns: instant of tick 0.

    Raises:
        VerdictError: frames were lost, or another node sends the ECU's frames.
    """
    reason, began = FINISHED, time.monotonic_ns()
    lost = ""
    try:
        for _ in ticks(
            world, ecu, tick_ns=1000 * ecu.tick_us, end_ns=duration_ns, offset_ns=offset_ns
        ):
            if stop.requested:
                reason = STOPPED
                break
            if ecu.gone:
                lost = f"the ECU ended at {world.now_ns * 1e-9:.2f} s"
                # what it sent last still reaches the actuators
                world.advance(world.now_ns + LAST_NS)
                reason = PEER_LOST
                break
    except PeerLostError:
        reason, lost = PEER_LOST, f"the ECU was lost at {world.now_ns * 1e-9:.2f} s"
    ecu.end()
    none = np.zeros((0, 2), dtype=np.int64)
    wall_ns = time.monotonic_ns() - began
    return PlantOutcome(
        reason, 0, world.now_ns, none, wall_ns, not_valid=_joined(ecu, offset_ns) or lost
    )


def _joined(ecu: GrantedEcu, offset_ns: int) -> str:
    """Return whether, and when, an ECU answered that has not run this run from its start."""
    if ecu.joined is None:
        return ""
    if ecu.joined == 0:
        return "the ECU has run with another plant"
    at = 1e-9 * offset_ns + 1e-6 * ecu.joined * ecu.tick_us
    return f"the ECU was lost, another one joined at {at:.2f} s"
