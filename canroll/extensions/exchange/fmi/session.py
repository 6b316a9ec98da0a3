"""One FMU in its own process, stepped with quantities of the plant."""

import json
import signal
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite
from pathlib import Path

from canroll.errors import CanrollError
from canroll.extensions.exchange.fmi import child
from canroll.extensions.exchange.fmi.child import BAD, LENGTH, NEXT, ChildTask
from canroll.extensions.exchange.fmi.description import SETTERS, Fmu
from canroll.extensions.exchange.fmi.map_file import PlantMap, Wire


class FmuSession:
    """An FMU from its initialisation on, at every millisecond.

    Args:
        path: the FMU.
        fmu: its description.
        plant_map: its map.
        speed: entry speed, m/s.

    Raises:
        CanrollError: each method; the FMU failed or crashed.
    """

    def __init__(self, path: Path, fmu: Fmu, plant_map: PlantMap, speed: float) -> None:
        self._path, self._fmu, self._map = path, fmu, plant_map
        self._names = [wire.variable for wire in plant_map.inputs]
        self._outputs_layout = struct.Struct(f"<{len(plant_map.outputs)}d")
        self._calls = 0
        self._values: tuple[float, ...] = ()
        self._coming: tuple[float, ...] = ()
        self._folder = tempfile.TemporaryDirectory(prefix="canroll-fmu-")
        task = ChildTask(
            path=str(path.resolve()),
            folder=self._folder.name,
            version=fmu.version,
            identifier=fmu.identifier,
            token=fmu.token,
            start=[
                (
                    SETTERS[fmu.types[name]],
                    fmu.references[name],
                    self._outwards(value, speed) if isinstance(value, Wire) else value,
                )
                for name, value in plant_map.start
            ],
            inputs=[fmu.references[name] for name in self._names],
            outputs=[fmu.references[wire.variable] for wire in plant_map.outputs],
            step=1e-3 * plant_map.step_ms,
        )
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(Path(child.__file__))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._write(json.dumps(asdict(task)).encode() + b"\n")

    def start(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Initialise with ``inputs`` by quantity; return the outputs at time 0."""
        self._values = self._exchange(inputs)
        return self._outputs()

    def step(self, inputs: Mapping[str, float]) -> dict[str, float] | None:
        """Advance by 1 ms; return the outputs there, None if they are still those before."""
        if self._calls % self._map.step_ms == 0:
            self._coming = self._exchange(inputs)
        self._calls += 1
        if self._calls % self._map.step_ms:
            return None
        self._values = self._coming
        return self._outputs()

    def close(self) -> None:
        """End the process, and remove what it has unpacked."""
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def _outwards(self, wire: Wire, value: float) -> float:
        return wire.scale * (value / self._fmu.factors[wire.variable]) + wire.offset

    def _outputs(self) -> dict[str, float]:
        values = {}
        for wire, value in zip(self._map.outputs, self._values, strict=True):
            si = (wire.scale * value + wire.offset) * self._fmu.factors[wire.variable]
            if not isfinite(si):
                raise CanrollError(
                    f"{self._path}: {wire.variable} is {value} at {self._calls} ms: the FMU's "
                    "equations have failed"
                )
            values[wire.quantity] = si
        return values

    def _exchange(self, inputs: Mapping[str, float]) -> tuple[float, ...]:
        values = [
            self._outwards(wire, inputs[wire.quantity]) if wire.quantity else wire.offset
            for wire in self._map.inputs
        ]
        self._write(NEXT + struct.pack(f"<{len(values)}d", *values))
        status = self._read(1)
        if status == BAD:
            (size,) = LENGTH.unpack(self._read(LENGTH.size))
            reason = self._read(size).decode("utf-8", "replace")
            raise CanrollError(f"{self._path}: the FMU failed at {self._calls} ms: {reason}")
        return self._outputs_layout.unpack(self._read(self._outputs_layout.size))

    def _write(self, data: bytes) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(data)
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # reading says why

    def _read(self, size: int) -> bytes:
        assert self._process.stdout is not None
        data = self._process.stdout.read(size)
        if len(data) < size:
            code = self._process.wait()
            how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            raise CanrollError(f"{self._path}: the FMU crashed at {self._calls} ms ({how})")
        return data
