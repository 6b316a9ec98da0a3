"""Couple FMUs at their CAN terminals (fmi-ls-bus, low cut) with FMPy, in the order of their clocks.

    python closed_loop.py 3.0 ecu.fmu:CAN=bus.fmu:Node1 plant.fmu:Sensors=bus.fmu:Node2

Every instant is a whole number of nanoseconds. At each instant at which a Tx clock ticks, all FMUs
step there, the ticking terminals are read, and what they send is handed to the terminals they are
connected to. The frames are printed as time in nanoseconds, terminal, identifier and data.
"""

import struct
import sys
import tempfile
import xml.etree.ElementTree as Xml
from collections.abc import Iterable, Iterator, Mapping
from ctypes import c_int, c_uint32, c_uint64
from pathlib import Path

import fmpy
from fmpy.fmi3 import FMU3Slave

CAN_TRANSMIT, CAN_FD_TRANSMIT = 0x10, 0x11
NOT_YET_KNOWN = 0


class Fmu:
    """One FMU in event mode, its terminals by name, its time in nanoseconds."""

    def __init__(self, path: Path, parameters: Mapping[str, object] | None = None) -> None:
        folder = Path(tempfile.mkdtemp())
        fmpy.extract(str(path), str(folder))
        self.description = fmpy.read_model_description(str(path))
        self.variables = {its.name: its for its in self.description.modelVariables}
        self.slave = FMU3Slave(
            guid=self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self.slave.instantiate(eventModeUsed=True)
        for name, value in (parameters or {}).items():
            self.set(name, value)
        self.slave.enterInitializationMode(startTime=0.0)
        self.slave.exitInitializationMode()
        self.now = 0
        self.ports = list(_terminals(folder))
        self.exchange({}, [])

    def set(self, name: str, *values: object) -> None:
        """Set a variable, all its elements."""
        its = self.variables[name]
        getattr(self.slave, f"set{its.type}")([its.valueReference], list(values))

    def get(self, name: str) -> list[float]:
        """Return the elements of a variable."""
        its = self.variables[name]
        count = 1
        for dimension in its.dimensions:
            count *= int(dimension.start)
        values: list[float] = getattr(self.slave, f"get{its.type}")([its.valueReference], count)
        return values

    def advance(self, until: int) -> None:
        """Step to ``until``."""
        if until > self.now:
            begin = self.now * 1e-9
            self.slave.doStep(begin, until * 1e-9 - begin)
            self.now = until

    def next_tick(self, port: str) -> int | None:
        """Return when the Tx clock of a terminal ticks next, after now; None if unknown."""
        clock = self.variables[f"{port}.Tx_Clock"]
        counter, resolution, known = (c_uint64 * 1)(), (c_uint64 * 1)(), (c_int * 1)()
        reference, instance = (c_uint32 * 1)(clock.valueReference), self.slave.component
        self.slave.fmi3GetIntervalFraction(instance, reference, 1, counter, resolution, known)
        if known[0] == NOT_YET_KNOWN:
            return None
        interval = counter[0] * (10**9 // resolution[0])
        if clock.intervalVariability == "countdown":
            return self.now + interval
        self.slave.fmi3GetShiftFraction(instance, reference, 1, counter, resolution)
        shift = counter[0] * (10**9 // resolution[0])
        return shift + interval * max(0, (self.now - shift) // interval + 1)

    def read(self, ticking: Iterable[str]) -> dict[str, bytes]:
        """Enter event mode, let the Tx clocks of the terminals tick and return what they send."""
        self.slave.enterEventMode()
        sent = {}
        for port in ticking:
            self.slave.setClock([self.variables[f"{port}.Tx_Clock"].valueReference], [True])
            sent[port] = self.slave.getBinary([self.variables[f"{port}.Tx_Data"].valueReference])[0]
        return sent

    def give(self, received: Mapping[str, bytes]) -> None:
        """Hand over what the terminals receive, and go back to step mode."""
        for port, data in received.items():
            self.slave.setClock([self.variables[f"{port}.Rx_Clock"].valueReference], [True])
            self.slave.setBinary([self.variables[f"{port}.Rx_Data"].valueReference], [data])
        self.slave.updateDiscreteStates()
        self.slave.enterStepMode()

    def exchange(self, received: Mapping[str, bytes], ticking: Iterable[str]) -> dict[str, bytes]:
        """Read and give in one event; the first one ends initialisation, which is an event too."""
        sent = self.read(ticking) if self.now else {}
        self.give(received)
        return sent

    def close(self) -> None:
        """End the simulation."""
        self.slave.terminate()
        self.slave.freeInstance()


def _terminals(folder: Path) -> Iterator[str]:
    path = folder / "terminalsAndIcons" / "terminalsAndIcons.xml"
    if path.exists():
        for element in Xml.parse(path).getroot().iter("Terminal"):
            if element.get("terminalKind") == "org.fmi-ls-bus.network-terminal":
                yield element.get("name", "")


def frames_of(operations: bytes) -> Iterator[tuple[int, bytes]]:
    """Identifier (bit 30: one of 29 bits) and data of every frame in a terminal's operations."""
    while operations:
        code, size = struct.unpack_from("<II", operations)
        if code in (CAN_TRANSMIT, CAN_FD_TRANSMIT):
            head = 16 if code == CAN_TRANSMIT else 17
            ident, extended = struct.unpack_from("<IB", operations, 8)
            yield ident | (extended and 1 << 30), operations[head:size]
        operations = operations[size:]


def run(
    fmus: Mapping[str, Fmu], wires: Mapping[tuple[str, str], tuple[str, str]], end: int
) -> Iterator[tuple[int, str, int, bytes]]:
    """Simulate up to ``end`` (ns); yield instant, sending "fmu:terminal", identifier and data.

    ``wires`` name for each terminal the one it is connected to, in both directions.
    """
    while True:
        due: dict[int, list[tuple[str, str]]] = {}
        for name, fmu in fmus.items():
            for port in fmu.ports:
                tick = fmu.next_tick(port)
                if tick is not None:
                    due.setdefault(tick, []).append((name, port))
        now = min([end, *due])
        for fmu in fmus.values():
            fmu.advance(now)
        if now >= end:
            return
        received: dict[str, dict[str, bytes]] = {name: {} for name in fmus}
        for name, fmu in fmus.items():
            ticking = [port for its, port in due[now] if its == name]
            for port, data in fmu.read(ticking).items():
                for ident, payload in frames_of(data):
                    yield now, f"{name}:{port}", ident, payload
                peer = wires.get((name, port))
                if peer is not None and data:
                    received[peer[0]][peer[1]] = data
        for name, fmu in fmus.items():
            fmu.give(received[name])


def main(arguments: list[str]) -> None:
    """Simulate what the command line says and print the frames."""
    end = round(float(arguments[0]) * 1e9)
    pairs = [tuple(side.rsplit(":", 1) for side in text.split("=")) for text in arguments[1:]]
    names = dict.fromkeys(path for pair in pairs for path, _ in pair)
    fmus = {name: Fmu(Path(name)) for name in names}
    wires = {}
    for (one, first), (other, second) in pairs:
        wires[one, first] = other, second
        wires[other, second] = one, first
    for now, port, ident, data in run(fmus, wires, end):
        print(now, port, f"{ident:X}", data.hex())
    for fmu in fmus.values():
        fmu.close()


if __name__ == "__main__":
    main(sys.argv[1:])
