"""Lock step: the plant grants time tick by tick, the ECU runs each granted tick and answers.

The plant passes on the frames that the modelled bus has delivered by a tick, grants the tick, and
waits until the ECU has answered with the frames sent in it. The speed of either program has no
effect, so a run gives the same frames on any machine: those of virtual time. Grants and
acknowledgements contain the number of their frames: a frame that is lost, or sent by another node,
ends the run instead of changing it.

Grants travel as frames with 29-bit identifiers on the same bus, or on a separate TCP connection
where the bus must carry nothing else.
"""

import struct
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from numpy import uint8
from numpy.typing import NDArray

from canroll.errors import CanrollError, VerdictError
from canroll.hil.bus_link import EXTENDED, NOTES, Frame, Link
from canroll.hil.process import Stop

GRANT, ACKNOWLEDGEMENT = sorted(NOTES)
END = 0xFFFFFFFF
"""Number in the last note of a side, which announces its end."""
RESEND = 1.0
"""Time without an answer after which a grant is sent again, s: for an ECU that joins late."""
LOST = 30.0
"""Time within which counted frames must arrive, s; then they are lost."""
POWER = (
    "a fault of node.RollControl that cuts its power is simulated in virtual time only: use "
    "'canroll run', or restart 'canroll ecu' by hand"
)
SLICE = 0.1
"""Longest wait without checking for a stop request, s."""


class PeerLostError(VerdictError):
    """The other side has not answered within its timeout."""


@dataclass(frozen=True, slots=True)
class Note:
    """A grant or an acknowledgement.

    Attributes:
        count: frames sent with it: since the last grant, or in the tick.
        number: number of the tick, from 1; 0 queries whether an ECU is present.
        tick_us: period of the ECU in an acknowledgement, µs; 0 in a grant.
        joined: 1 in acknowledgements of an ECU that joined a run under way, or whose plant was
            replaced in one.
    """

    count: int
    number: int
    tick_us: int = 0
    joined: int = 0

    def payload(self) -> bytes:
        """Return it as eight bytes."""
        return struct.pack(">BIHB", self.count, self.number, self.tick_us, self.joined)

    @classmethod
    def of(cls, payload: bytes) -> "Note":
        """Decode the bytes of :meth:`payload`.

        Raises:
            VerdictError: wrong length.
        """
        if len(payload) != 8:
            raise VerdictError(f"lock step: a grant has 8 bytes, got {len(payload)}")
        return cls(*struct.unpack(">BIHB", payload))


class GrantChannel:
    """Grants as frames on the bus itself.

    Args:
        link: the bus.
        sends: identifier of what this side sends.
        hears: identifier of what the other side sends.
        idents: those of the frames on the bus.

    Raises:
        CanrollError: a frame has an identifier of the notes.
    """

    def __init__(self, link: Link, *, sends: int, hears: int, idents: Iterable[int] = ()) -> None:
        for ident in NOTES.intersection(idents):
            raise CanrollError(
                f"lock step: its grants and acknowledgements have the identifier "
                f"0x{ident & ~EXTENDED:X} of a frame: use --pace realtime"
            )
        self._link, self._sends, self._hears = link, sends, hears

    def send(self, note: Note) -> None:
        """Send a note to the other side."""
        self._link.send(self._sends, note.payload())

    def wait(self, timeout: float, take: Callable[[Frame], None]) -> Note | None:
        """Return the other side's next note, or None after ``timeout`` s."""
        until = time.monotonic() + timeout
        while (frame := self._link.next(max(0.0, until - time.monotonic()))) is not None:
            if frame[0] == self._hears:
                return Note.of(frame[1])
            take(frame)
        return None


class _Heard:
    """Received frames with the counted identifiers, in order, without those of other nodes.

    Those of ``foreign`` identifiers are taken too, and not counted: any node may have sent them.
    """

    def __init__(self, link: Link, idents: Iterable[int], foreign: Iterable[int] = ()) -> None:
        self._link, self.idents = link, frozenset(idents)
        self._taken = self.idents.union(foreign)
        self.frames: list[Frame] = []

    def take(self, frame: Frame) -> None:
        if frame[0] in self._taken:
            self.frames.append(frame)

    @property
    def _counted(self) -> int:
        return sum(ident in self.idents for ident, _ in self.frames)

    def all(self, count: int, what: str, stop: Stop) -> list[Frame]:
        """Return the ``count`` frames that were sent, waiting for those still under way.

        Raises:
            VerdictError: a frame is lost, or there are more than were sent.
        """
        until = time.monotonic() + LOST
        while self._counted < count and not stop.requested:
            frame = self._link.next(SLICE)
            if frame is not None:
                self.take(frame)
            elif time.monotonic() > until:
                raise VerdictError(
                    f"lock step: {count - self._counted} of the {count} frames {what} were lost"
                )
        if self._counted > count:
            idents = ", ".join(f"0x{ident:03X}" for ident, _ in self.frames)
            raise VerdictError(
                f"lock step: {self._counted} frames {what} instead of {count} ({idents}): "
                "another node sends frames with these identifiers"
            )
        frames, self.frames = self.frames, []
        return frames


class GrantedEcu:
    """The ECU behind a bus, with the interface that the loop of virtual time uses.

    Attributes:
        tick_us: period of the ECU that answered, µs.
        gone: whether it has announced its end.
        joined: first tick that an ECU answered which has not run this run from its start, or None.

    Args:
        link: the bus.
        channel: channel of the grants.
        idents: identifiers that the ECU sends.
        stop: checked while waiting.
        peer_timeout: maximum time for an answer, s; None: unlimited, and another ECU may take over
            from one that ends.
    """

    def __init__(
        self,
        link: Link,
        channel: GrantChannel,
        *,
        idents: Iterable[int],
        stop: Stop,
        peer_timeout: float | None = None,
    ) -> None:
        self._link, self._channel, self._stop = link, channel, stop
        self._heard = _Heard(link, idents)
        self._peer_timeout = peer_timeout
        self._sent = self._number = self.tick_us = 0
        self.gone = False
        self.joined: int | None = None

    def greet(self, timeout: float | None) -> bool:
        """Wait until an ECU answers, and set ``tick_us`` to its period.

        Returns False after ``timeout`` seconds or on a stop request.
        """
        try:
            note = self._ask(Note(0, 0), timeout)
        except PeerLostError:
            return False
        if note is None:
            return False
        self._heard.frames.clear()
        self.tick_us = note.tick_us
        return True

    def restart(self) -> None:
        """Refuse: the power of a separate program cannot be cut from here.

        Raises:
            CanrollError: always.
        """
        raise CanrollError(POWER)

    def receive(self, ident: int, payload: NDArray[uint8], length: int) -> None:
        """Pass a frame to the ECU."""
        self._link.send(ident, payload[:length].tobytes())
        # of the ECU's own identifiers any node may send
        self._sent += ident not in self._heard.idents

    def tick(self, elapsed_ticks: int = 1) -> list[Frame]:
        """Grant a tick and return the frames the ECU sent in it; none on a stop request.

        Raises:
            PeerLostError: no answer within the timeout.
            VerdictError: frames are lost, or an ECU with another period has taken over.
        """
        self._number += elapsed_ticks
        count, self._sent = self._sent, 0
        note = self._ask(Note(count, self._number), self._peer_timeout)
        if note is None:
            return []
        if note.number == END:
            self.gone = True
            return self._heard.all(note.count, "of the ECU at its end", self._stop)
        if note.tick_us != self.tick_us:
            raise VerdictError(
                f"lock step: the ECU's tick changed to {note.tick_us / 1000:g} ms, "
                f"it was {self.tick_us / 1000:g} ms"
            )
        return self._heard.all(note.count, f"of the ECU in tick {self._number}", self._stop)

    def end(self) -> None:
        """Announce the end of the run to the ECU."""
        self._channel.send(Note(0, END))

    def _ask(self, question: Note, timeout: float | None) -> Note | None:
        began = asked = time.monotonic()
        self._channel.send(question)
        while not self._stop.requested:
            note = self._channel.wait(SLICE, self._heard.take)
            if note is not None and note.number == question.number:
                if note.joined and self.joined is None:
                    self.joined = note.number
                return note
            if note is not None and note.number == END:
                if timeout is not None and question.number:
                    return note
                self._heard.frames.clear()
            now = time.monotonic()
            if timeout is not None and now - began > timeout:
                raise PeerLostError(f"lock step: no answer from the ECU within {timeout:g} s")
            if now - asked > RESEND:
                self._channel.send(question)
                asked = now
        return None


@dataclass(frozen=True, slots=True)
class Grant:
    """One granted tick: its number and the frames received before it."""

    number: int
    frames: list[Frame]


class Grants:
    """The ECU's side: waits for grants and acknowledges them.

    Attributes:
        ended: whether the plant has announced its end.
        not_valid: why ECU and plant have not run one run together from its start; "": they have.

    Args:
        link: the bus.
        channel: channel of the grants.
        idents: identifiers that the plant sends.
        foreign: identifiers that only the ECU should send.
        tick_us: period of the ECU, µs.
        stop: checked while waiting.
    """

    def __init__(
        self,
        link: Link,
        channel: GrantChannel,
        *,
        idents: Iterable[int],
        tick_us: int,
        stop: Stop,
        foreign: Iterable[int] = (),
    ) -> None:
        self._channel, self._stop, self._tick_us = channel, stop, tick_us
        self._heard = _Heard(link, idents, foreign)
        self._number: int | None = None
        self._sent = 0
        self.ended = False
        self.not_valid = ""

    def wait(self, timeout: float | None) -> Grant | None:
        """Return the next grant, or None if the plant has gone or on a stop request.

        The plant has gone when it announces its end or is silent for ``timeout`` s (None: no
        limit).

        Raises:
            VerdictError: frames are lost.
        """
        began = time.monotonic()
        while not self._stop.requested:
            note = self._channel.wait(SLICE, self._heard.take)
            if note is None:
                if timeout is not None and time.monotonic() - began > timeout:
                    return None
            elif note.number == END:
                self.ended = self._number is not None
                if timeout is not None and self.ended:
                    return None
            elif note.number == 0:
                if self._number != 0:
                    self._begin()
                self._acknowledge()
            elif note.number == self._number:
                # asked again: the answer was lost
                self._acknowledge()
            else:
                frames = self._frames(note)
                self._number = note.number
                return Grant(note.number, frames)
        return None

    def _begin(self) -> None:
        """Begin a run: what was heard before is none of it."""
        if self._number is not None and not self.ended:
            self.not_valid = f"the plant was lost after tick {self._number}, another one joined"
        self._heard.frames.clear()
        self._number, self._sent, self.ended = 0, 0, False

    def end(self, sent: int) -> None:
        """Announce the ECU's end to the plant, with the number of its last frames."""
        self._channel.send(Note(sent, END, self._tick_us))

    def done(self, sent: int) -> None:
        """Acknowledge the tick, with the number of frames sent in it."""
        self._sent = sent
        self._acknowledge()

    def _frames(self, note: Note) -> list[Frame]:
        if self._number is None:
            # what was sent before the bus was open is not for us
            self.not_valid = f"joined in tick {note.number} of a run"
            frames, self._heard.frames = self._heard.frames, []
            return frames
        return self._heard.all(note.count, f"of the plant before tick {note.number}", self._stop)

    def _acknowledge(self) -> None:
        assert self._number is not None
        joined = int(bool(self.not_valid))
        self._channel.send(Note(self._sent, self._number, self._tick_us, joined))
