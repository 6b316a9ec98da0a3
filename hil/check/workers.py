"""Measuring processes: each sends its result, or an error for the user."""

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from canroll.errors import CanrollError

CONTEXT = multiprocessing.get_context("spawn")
"""A fork would inherit locks, priorities and the compiler's threads of the parent."""

Send = Callable[[Any], None]


class Child:
    """A process that runs ``target(send, *arguments)`` and whose results are received in order."""

    def __init__(self, target: Callable[..., None], *arguments: Any) -> None:  # noqa: ANN401
        self._near, far = CONTEXT.Pipe(duplex=False)
        self._process: SpawnProcess = CONTEXT.Process(
            target=_run, args=(far, target, arguments), daemon=True
        )
        self._process.start()
        far.close()

    def receive(self, timeout: float) -> Any:  # noqa: ANN401
        """Return the next object it sends.

        Raises:
            CanrollError: the error it ended with; or it ended otherwise, or sent nothing in time.
        """
        answer: Any = None
        if self._near.poll(timeout):
            try:
                answer = self._near.recv()
            except EOFError:
                answer = None
        if isinstance(answer, CanrollError):
            raise answer
        if answer is None:
            raise CanrollError("a measuring process ended early or was not ready in time")
        return answer

    def end(self) -> None:
        """Terminate it if it is still running."""
        if self._process.is_alive():
            self._process.terminate()
        self._process.join()
        self._near.close()


@contextmanager
def ended(children: list[Child]) -> Iterator[None]:
    """End all ``children``, including those added meanwhile, when the body ends."""
    try:
        yield
    finally:
        for child in children:
            child.end()


def _run(far: Connection, target: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    try:
        target(far.send, *arguments)
    except CanrollError as error:
        far.send(error)
    except KeyboardInterrupt:
        pass
    finally:
        far.close()
