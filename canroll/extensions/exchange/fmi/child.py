"""The process in which an FMU runs, so that its end is not the end of the tool.

It runs as a script, with a :class:`ChildTask` as a line of JSON on standard input. Then each
request is a byte and a float64 of each input, each answer a status byte and a float64 of each
output, or the length of a message and the message. Standard output belongs to the answers: what the
FMU prints goes nowhere.
"""

import io
import json
import os
import shutil
import signal
import struct
import sys
from dataclasses import dataclass
from typing import Any, BinaryIO

GOOD, BAD, NEXT = b"\0", b"\1", b"\2"
LENGTH = struct.Struct("<Q")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChildTask:
    """What the process does: an FMU, the variables to set and get, and the step (s)."""

    path: str
    folder: str
    """Where it is unpacked. The caller removes it, and this process where the caller is no more."""
    version: int
    identifier: str
    token: str
    start: list[tuple[str, int, Any]]
    """Setter of FMPy, value reference and value."""
    inputs: list[int]
    outputs: list[int]
    step: float


class LastMessage(io.TextIOBase):
    """Keeps the last line that FMPy prints: the FMU's messages."""

    last = ""

    def write(self, text: str) -> int:
        """Keep ``text`` if it says something."""
        self.last = text.strip() or self.last
        return len(text)


class Instance:
    """One FMU between its steps."""

    def __init__(self, task: ChildTask) -> None:
        from fmpy import extract  # noqa: PLC0415 - the messages of its import are kept away too
        from fmpy.fmi2 import FMU2Slave  # noqa: PLC0415
        from fmpy.fmi3 import FMU3Slave  # noqa: PLC0415

        extract(task.path, task.folder)
        self._task = task
        self._count = 0
        slave = FMU2Slave if task.version == 2 else FMU3Slave
        self._fmu: Any = slave(
            guid=task.token,
            modelIdentifier=task.identifier,
            unzipDirectory=task.folder,
            instanceName="plant",
        )
        self._set = self._fmu.setReal if task.version == 2 else self._fmu.setFloat64
        self._get = self._fmu.getReal if task.version == 2 else self._fmu.getFloat64

    def start(self, inputs: tuple[float, ...]) -> list[float]:
        """Initialise with the inputs at time 0; return the outputs there."""
        fmu, task = self._fmu, self._task
        if task.version == 2:
            fmu.instantiate()
        else:
            fmu.instantiate(eventModeUsed=False)
        for setter, reference, value in task.start:
            getattr(fmu, setter)([reference], [value])
        if task.version == 2:
            fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=0.0)
        self._give(inputs)
        fmu.exitInitializationMode()
        return self._outputs()

    def step(self, inputs: tuple[float, ...]) -> list[float]:
        """Do one communication step with ``inputs``; return the outputs at its end."""
        task = self._task
        self._give(inputs)
        # FMI 2.0 raises where a step is not done; 3.0 also says so
        done = self._fmu.doStep(self._count * task.step, task.step)
        if done is not None and (done[1] or done[2]):
            raise RuntimeError("it ended the simulation" if done[1] else "it ended a step early")
        self._count += 1
        return self._outputs()

    def _give(self, inputs: tuple[float, ...]) -> None:
        if inputs:
            self._set(self._task.inputs, list(inputs))

    def _outputs(self) -> list[float]:
        return list(self._get(self._task.outputs))


def main() -> None:
    """Answer until standard input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    messages = LastMessage()
    sys.stdout = messages
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests = sys.stdin.buffer
    task = ChildTask(**json.loads(requests.readline()))
    try:
        _serve(task, requests, answers)
    except Exception as error:
        text = str(error) if not messages.last else f"{error} {messages.last}"
        message = " ".join(text.split()).encode()
        answers.write(BAD + LENGTH.pack(len(message)) + message)
        answers.flush()
    finally:
        shutil.rmtree(task.folder, ignore_errors=True)


def _serve(task: ChildTask, requests: BinaryIO, answers: BinaryIO) -> None:
    given = struct.Struct(f"<{len(task.inputs)}d")
    outputs = struct.Struct(f"<{len(task.outputs)}d")
    instance = Instance(task)
    work = instance.start
    while len(request := requests.read(1 + given.size)) == 1 + given.size:
        answers.write(GOOD + outputs.pack(*work(given.unpack(request[1:]))))
        answers.flush()
        work = instance.step


if __name__ == "__main__":
    main()
