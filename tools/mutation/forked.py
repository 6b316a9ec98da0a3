"""Work in forked processes: each starts with everything loaded here, without affecting it."""

import json
import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

TIME_LIMIT = {"time limit": True}
"""What a process gives that has used up the CPU time it had set itself as RLIMIT_CPU."""


def results(
    n: int, work: Callable[[int], dict[str, Any]], jobs: int
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield k and ``work(k)``, which must be JSON, for k below ``n`` as they come.

    ``jobs`` run at a time, without standard output. Raises RuntimeError if one fails other than by
    its time limit; ends all running ones on exit.
    """
    running: dict[int, int] = {}
    waiting = iter(range(n))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        try:
            while True:
                while len(running) < jobs and (k := next(waiting, None)) is not None:
                    running[_fork(partial(work, k), folder / str(k))] = k
                if not running:
                    return
                pid, status = os.wait()
                k = running.pop(pid)
                if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU:
                    yield k, TIME_LIMIT
                    continue
                path = folder / str(k)
                said = path.read_text(encoding="utf-8") if path.exists() else ""
                if status:
                    raise RuntimeError(f"process {k} ended with status {status}: {said}")
                yield k, json.loads(said)
                path.unlink()
        finally:
            for pid in running:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)


def _fork(work: Callable[[], dict[str, Any]], path: Path) -> int:
    pid = os.fork()
    if pid:
        return pid
    status = 1
    # a child must never go on as its parent, whatever happens
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        path.write_text(json.dumps(work()), encoding="utf-8")
        status = 0
    except BaseException as error:
        path.write_text(repr(error), encoding="utf-8")
    finally:
        os._exit(status)
