"""Round-trip time of the bus: a frame out, echoed by a process on another core, and back.

Both wait in the kernel for their frame, so both wake-ups are included. On an interface that only
one program can open (an adapter), only reading an empty bus is timed, as no echo is available.
"""

import argparse
import time
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from hil import own_bus
from hil.bus_link import CanLink, Link, open_link
from hil.check.loops import Placement
from hil.check.workers import Child, Send, ended
from hil.hardware.bus_options import options_of, parsed_options
from hil.hardware.interfaces import is_shared
from hil.process import collector_off, prepare

PING, PONG = 0x7FE, 0x7FF
"""The weakest identifiers of all: whatever else is on a real bus goes first."""
PATIENCE = 0.5
"""s without an echo after which a frame counts as lost; after :data:`GIVE_UP` of them it ends."""
GIVE_UP = 3
PAUSE = 0.001
QUIET = 0.2
"""A socketcand server keeps quiet right after a client has opened its bus."""
POLLS = 200
START = 60.0

Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """Measurements on an interface.

    Attributes:
        interface: python-can's name and channel, or "the plant's own bus".
        trips_ns: round trips; empty if the interface does not allow the measurement.
        poll_ns: duration of reading an empty bus, which every tick spends.
        lost: frames that did not return.
        missing: reason why there is no round trip, or None.
    """

    interface: str
    trips_ns: Times
    poll_ns: Times
    lost: int = 0
    missing: str | None = None


def measure(
    bus: argparse.Namespace | None, seconds: float, near: Placement, far: Placement
) -> RoundTrip:
    """Time round trips for ``seconds``.

    Args:
        bus: python-can's options; None for a bus like the plant's own.
        seconds: maximum duration.
        near: placement of the sender: the ECU's.
        far: placement of the echo: the plant's.

    Raises:
        CanrollError: the bus cannot be opened; the message names the remedy.
    """
    children: list[Child] = []
    with ended(children):
        if bus is None or is_shared(options_of(bus)[0]):
            children.append(Child(_echo, bus, far))
            joined = children[0].receive(START)
            children.append(Child(_trips, joined, seconds, near))
        else:
            children.append(Child(_polls, bus, near))
        times: RoundTrip = children[-1].receive(START + seconds)
    return times if bus is not None else replace(times, interface="the plant's own bus")


def _name(bus: argparse.Namespace) -> str:
    name, channel, _, _ = options_of(bus)
    return f"{name} {channel}".strip()


def _echo(send: Send, bus: argparse.Namespace | None, place: Placement) -> None:
    """Answer every ping, after sending the options of a bus that the other side can join."""
    if bus is None:
        server = own_bus.serve("127.0.0.1:0")
        prepare(cpu=place.core, priority=place.priority)
        send(parsed_options(server.options.split()))
        _answer(server)
    link = open_link(bus)
    prepare(cpu=place.core, priority=place.priority)
    send(bus)
    _answer(link)


def _answer(bus: Link) -> NoReturn:
    while True:
        frame = bus.next(PATIENCE)
        if frame is not None and frame[0] == PING:
            bus.send(PONG, frame[1])


def _trips(send: Send, bus: argparse.Namespace, seconds: float, place: Placement) -> None:
    link = open_link(bus)
    prepare(cpu=place.core, priority=place.priority)
    time.sleep(QUIET)
    polls = _time_polls(link)
    trips: list[int] = []
    lost = in_a_row = number = 0
    until = time.monotonic() + seconds
    with collector_off():
        while time.monotonic() < until and in_a_row < GIVE_UP:
            number += 1
            payload = number.to_bytes(8, "big")
            start = time.monotonic_ns()
            link.send(PING, payload)
            if _came_back(link, payload, start + round(PATIENCE * 1e9)):
                trips.append(time.monotonic_ns() - start)
                in_a_row = 0
            else:
                lost += 1
                in_a_row += 1
            time.sleep(PAUSE)
    missing = None
    if not trips:
        missing = (
            f"{link.failed} of {lost} frames were refused by the interface"
            if link.failed
            else f"none of {lost} frames came back: does another node acknowledge them?"
        )
    link.close()
    send(RoundTrip(_name(bus), np.array(trips, np.int64), polls, lost, missing))


def _came_back(link: CanLink, payload: bytes, until_ns: int) -> bool:
    while (left := until_ns - time.monotonic_ns()) > 0:
        if link.next(left * 1e-9) == (PONG, payload):
            return True
    return False


def _polls(send: Send, bus: argparse.Namespace, place: Placement) -> None:
    link = open_link(bus)
    prepare(cpu=place.core, priority=place.priority)
    polls = _time_polls(link)
    link.close()
    missing = f"one program alone opens '{options_of(bus)[0]}': the echo needs a second node"
    send(RoundTrip(_name(bus), np.zeros(0, np.int64), polls, 0, missing))


def _time_polls(link: CanLink) -> Times:
    times = np.zeros(POLLS, np.int64)
    for k in range(POLLS):
        start = time.monotonic_ns()
        link.receive()
        times[k] = time.monotonic_ns() - start
    return times
