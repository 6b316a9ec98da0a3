"""A serial CAN adapter (Lawicel's protocol, "slcan") on a pseudo-terminal, with a bus behind it."""

import os
import threading
import tty

import can

COMMANDS = {b"t": 3, b"T": 8, b"r": 3, b"R": 8}
"""Frames by their letter, and how many digits their identifier has."""
OK, BELL = b"\r", b"\a"


class SlcanAdapter:
    """Carries frames between whoever opens :attr:`port` and a python-can bus.

    Attributes:
        port: path of the pseudo-terminal.
        bitrate: that was set, bit/s; None before.
        is_open: the channel was opened and not closed since.
        answered: number of commands answered.
        refused: commands answered with an error.
    """

    BITRATES = (10, 20, 50, 100, 125, 250, 500, 800, 1000)

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.bitrate: int | None = None
        self.is_open = False
        self.answered = 0
        self.refused: list[bytes] = []
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._running = True
        self._writing = threading.Lock()
        self._threads = [threading.Thread(target=run) for run in (self._commands, self._frames)]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Unplug it."""
        self._running = False
        # the reader waits in a read: a line from the other end wakes it
        os.write(self._slave, b"\r")
        for thread in self._threads:
            thread.join()
        os.close(self._slave)
        os.close(self._master)

    def write(self, data: bytes) -> None:
        """Send bytes to the host as they are."""
        with self._writing:
            while data:
                data = data[os.write(self._master, data) :]

    def _commands(self) -> None:
        line = b""
        while self._running:
            for byte in os.read(self._master, 4096):
                if byte == OK[0]:
                    self.write(self._answer(line))
                    self.answered += 1
                    line = b""
                else:
                    line += bytes([byte])

    def _frames(self) -> None:
        while self._running:
            message = self.bus.recv(0.05)
            if message is not None and self.is_open:
                self.write(line_of(message))

    def _answer(self, line: bytes) -> bytes:
        letter, rest = line[:1], line[1:]
        if not line:
            return OK
        if letter == b"S" and rest.isdigit() and not self.is_open:
            self.bitrate = 1000 * self.BITRATES[int(rest)]
            return OK
        if letter in (b"O", b"C"):
            self.is_open = letter == b"O"
            return OK
        if letter in COMMANDS and self.is_open:
            try:
                self.bus.send(message_of(line))
            except (can.CanError, OSError):
                return BELL
            return (b"z" if COMMANDS[letter] == 3 else b"Z") + OK
        self.refused.append(line)
        return BELL


def line_of(message: can.Message) -> bytes:
    """Return a frame as the adapter reports it."""
    letter = "r" if message.is_remote_frame else "t"
    digits = 8 if message.is_extended_id else 3
    letter = letter.upper() if message.is_extended_id else letter
    data = "" if message.is_remote_frame else bytes(message.data).hex().upper()
    return f"{letter}{message.arbitration_id:0{digits}X}{message.dlc}{data}\r".encode()


def message_of(line: bytes) -> can.Message:
    """Return the frame that the host asks to be sent."""
    digits = COMMANDS[line[:1]]
    remote = line[:1].lower() == b"r"
    return can.Message(
        arbitration_id=int(line[1 : 1 + digits], 16),
        is_extended_id=digits == 8,
        is_remote_frame=remote,
        dlc=int(line[1 + digits : 2 + digits]),
        data=None if remote else bytes.fromhex(line[2 + digits :].decode()),
    )
