"""Programs of this command line forked from the test process, which has imported all they need.

A start imports for seconds, most of what a short program takes. Streams, folder, environment,
signals and exit code are those of a process; :func:`real_processes` is for tests of the start.
"""

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

PROGRAM = [sys.executable, "-m", "canroll.cli.main"]
POPEN = subprocess.Popen
STDERR = 2


class Forked(subprocess.Popen):  # type: ignore[type-arg]
    """A started program: forked if it is ``python -m canroll.cli.main``, else as ever."""

    def _execute_child(self, args: Any, *rest: Any) -> None:
        words = [os.fspath(word) for word in args] if isinstance(args, list | tuple) else []
        cwd, env = rest[4:6]
        if words[: len(PROGRAM)] != PROGRAM or _interpreter(env) != _interpreter(None):
            super()._execute_child(args, *rest)  # type: ignore[misc]
            return
        pipes, new_session = rest[9:15], rest[20]
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        self.pid = os.fork()
        if not self.pid:
            _become(words, cwd, env, (pipes[0], pipes[3], pipes[5]), new_session=new_session)
        self._child_created = True
        self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]


def _interpreter(env: Mapping[str, str] | None) -> set[tuple[str, str]]:
    """Variables that only a start of Python reads."""
    given = os.environ if env is None else env
    return {(name, value) for name, value in given.items() if name.startswith("PYTHON")}


def _become(
    words: Sequence[str],
    cwd: str | None,
    env: Mapping[str, str] | None,
    streams: tuple[int, int, int],
    *,
    new_session: bool,
) -> None:
    """Run the program in this process and end it with its exit code."""
    code = 70
    try:
        gc.disable()  # what the parent left to collect is not this program's
        if new_session:
            os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        _take(streams)
        if cwd is not None:
            os.chdir(cwd)
        if env is not None:
            os.environ.clear()
            os.environ.update(env)
        sys.argv = ["canroll", *words[len(PROGRAM) :]]
        from canroll.cli.main import main

        gc.enable()
        code = main()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):
                stream.flush()
        os._exit(code)


def _take(streams: tuple[int, int, int]) -> None:
    """Make files the standard streams, and close whatever else the parent has open."""
    copies = [os.dup(old if new == -1 else new) for old, new in enumerate(streams)]
    for number, copy in enumerate(copies):
        os.dup2(copy, number)
    # not closed: objects of the parent own the numbers, and would close another file later
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in map(int, os.listdir("/proc/self/fd")):
        if number > STDERR:
            with suppress(OSError):
                os.dup2(nothing, number)
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", 1, encoding="utf-8", closefd=False)  # noqa: SIM115


@contextmanager
def real_processes() -> Iterator[None]:
    """Start programs as processes of their own while the body runs."""
    forked, subprocess.Popen = subprocess.Popen, POPEN  # type: ignore[misc]
    try:
        yield
    finally:
        subprocess.Popen = forked  # type: ignore[misc]
