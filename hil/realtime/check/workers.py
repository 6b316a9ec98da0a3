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
    """A process that runs ``target(send, *arguments)``; what it sends is received in order."""

    def __init__(self, target: Callable[..., None], *arguments: Any) -> None:  # noqa: ANN401
        self._near, far = CONTEXT.Pipe(duplex=False)
        self._process: SpawnProcess = CONTEXT.Process(
            target=_run, args=(far, target, arguments), daemon=True
        )
        self._process.start()
        far.close()

    def receive(self, timeout: float) -> Any:  # noqa: ANN401
        """Return the next thing it sends.

        Raises:
            CanrollError: the one that it ended with; or it ended otherwise, or said nothing.
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
        """End it where it still runs."""
        if self._process.is_alive():
            self._process.terminate()
        self._process.join()
        self._near.close()


@contextmanager
def ended(children: list[Child]) -> Iterator[None]:
    """End all ``children``, those added meanwhile too, when the body is left."""
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
