"""Programs of this command line started as child processes: output and termination."""

import os
import selectors
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import IO

from canroll.errors import CanrollError, VerdictError
from canroll.setup.choices import PROJECT_FILE

START = 1800.0
"""Time a child may take to be ready, s: a plant that was never run compiles first, and a machine
may be slow. One that has ended is noticed at once."""
GRACE = 60.0
"""Time a child may take to write its files after the request to end, s; then it is killed."""


@dataclass(slots=True)
class ChildProgram:
    """A started program and its output so far."""

    name: str
    running: subprocess.Popen[bytes]
    text: str = ""

    @property
    def output(self) -> IO[bytes]:
        """Its stdout."""
        assert self.running.stdout is not None
        return self.running.stdout

    @property
    def errors(self) -> IO[bytes]:
        """Its stderr."""
        assert self.running.stderr is not None
        return self.running.stderr

    def listen(self) -> None:
        """Read its new output, without waiting."""
        with suppress(BlockingIOError):
            while data := os.read(self.output.fileno(), 4096):
                self.text += data.decode(errors="replace")

    def line(self, prefix: str) -> str | None:
        """Return the first complete line that begins with ``prefix``."""
        self.listen()
        lines = self.text.splitlines(keepends=True)
        matching = (line for line in lines if line.startswith(prefix) and line.endswith("\n"))
        return next(matching, "").strip() or None

    def ask_to_stop(self) -> None:
        """Send SIGTERM if it is still running."""
        if self.running.poll() is None:
            self.running.send_signal(signal.SIGTERM)

    def last_words(self) -> str:
        """Return its last line on stderr, prefixed with its name."""
        lines = self.errors.read().decode(errors="replace").strip().splitlines()
        reason = lines[-1].removeprefix("canroll: ") if lines else "no reason given"
        return f"{self.name}: {reason}"

    def failure(self) -> CanrollError:
        """Return the error with which it ended: its last line, or the signal that killed it."""
        self.listen()
        code = self.running.returncode
        if code < 0:
            return VerdictError(
                f"not valid: the {self.name} was killed by {signal.Signals(-code).name}"
            )
        if code == 0:
            ended = (self.text.strip().splitlines() or [f"{self.name} ends"])[-1]
            return VerdictError(f"not valid: {ended}, before the other side did")
        words = self.last_words()
        return VerdictError(words) if code == VerdictError.exit_code else CanrollError(words)


def start(children: list[ChildProgram], name: str, arguments: list[str]) -> ChildProgram:
    """Start a program in its own session: a terminal's Ctrl-C reaches only the parent."""
    child = ChildProgram(
        name,
        subprocess.Popen(
            [sys.executable, "-m", "canroll.cli.main", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            # it has all of its options from here
            env={**os.environ, PROJECT_FILE: ""},
        ),
    )
    os.set_blocking(child.output.fileno(), False)
    children.append(child)
    return child


def wait_for(child: ChildProgram, prefix: str, other: ChildProgram | None = None) -> str:
    """Return the first line of ``child`` that begins with ``prefix``.

    Raises:
        CanrollError: it or ``other`` has ended, or it takes too long to start.
        VerdictError: one of them was killed, or ended with a verdict.
    """
    until = time.monotonic() + START
    with selectors.DefaultSelector() as selector:
        selector.register(child.output, selectors.EVENT_READ)
        while True:
            # asked before its last words are taken in, so that they are not missed
            ended = [c for c in (child, other) if c is not None and c.running.poll() is not None]
            if line := child.line(prefix):
                return line
            if ended:
                raise ended[0].failure()
            if other is None and time.monotonic() > until:
                raise CanrollError(f"{child.name}: not ready within {START:g} s")
            selector.select(0.1)


def check_ended(child: ChildProgram) -> None:
    """Wait until a program that is ending has written its files.

    Raises:
        CanrollError: it failed.
        VerdictError: it failed with a verdict, was killed, or does not end.
    """
    try:
        child.running.wait(GRACE)
    except subprocess.TimeoutExpired as error:
        raise VerdictError(
            f"not valid: the {child.name} does not end within {GRACE:g} s"
        ) from error
    # a child that already wrote its files may still be killed by our SIGTERM
    if child.running.returncode not in (0, -signal.SIGTERM):
        raise child.failure()


def stop(children: list[ChildProgram]) -> None:
    """End the running programs, the last started first."""
    for child in reversed(children):
        child.ask_to_stop()
        try:
            child.running.wait(GRACE)
        except subprocess.TimeoutExpired:
            child.running.kill()
            child.running.wait()
        child.output.close()
        child.errors.close()
