"""The firmware on a machine: functions called by name, on records in the machine's memory.

A function is named as in the firmware: ``tick`` of the loop, ``xcp.tick`` of a module beside it.
Three machines have this interface: CPython (here), this computer running the compiled C
(:class:`canroll.codegen.run.native.NativeMachine`), an emulated Cortex-M
(:class:`canroll.codegen.run.unicorn.CortexMachine`).
"""

from collections.abc import Callable
from typing import Any, Protocol

from canroll.codegen.run import memory_image
from canroll.codegen.run.bus_firmware import BusFirmware


class MachineRecord(Protocol):
    """A record in the memory of a machine; its fields are read and written by name."""

    def __getitem__(self, field: str) -> Any:  # noqa: ANN401 - an integer, or an array of them
        """Return the value of a field."""

    def __setitem__(self, field: str, value: Any) -> None:  # noqa: ANN401
        """Set a field."""

    def image(self) -> bytes:
        """The bytes of the record, as C lays it out."""

    def fill(self, data: bytes) -> None:
        """Set the record from its bytes."""

    @property
    def value(self) -> Any:  # noqa: ANN401 - a record of the firmware
        """The record as an object of Python, to be read only."""


class Machine(Protocol):
    """What runs the functions of a firmware."""

    def record(self, value: Any) -> Any:  # noqa: ANN401
        """Put a record of the firmware in the memory; return the :class:`MachineRecord` there."""

    def call(self, function: str, *arguments: Any) -> int:  # noqa: ANN401
        """Call a function of the firmware by its name.

        Args:
            function: its name.
            arguments: records of this machine, integers, ``bytes`` of an array that is read, or a
                ``bytearray`` of one that is written.

        Returns:
            What the function returns; without meaning if it returns nothing.
        """


class PythonRecord:
    """A record of the firmware itself."""

    def __init__(self, value: Any) -> None:  # noqa: ANN401
        self.value = value

    def __getitem__(self, field: str) -> Any:  # noqa: ANN401
        """Return the value of a field."""
        return getattr(self.value, field)

    def __setitem__(self, field: str, value: Any) -> None:  # noqa: ANN401
        """Set a field."""
        setattr(self.value, field, value)

    def image(self) -> bytes:
        """The bytes of the record, as C lays it out."""
        return memory_image.image(self.value)

    def fill(self, data: bytes) -> None:
        """Set the record from its bytes."""
        memory_image.fill(self.value, data)


class PythonMachine:
    """The firmware run by CPython, line by line."""

    def __init__(self, firmware: BusFirmware) -> None:
        self._firmware = firmware
        self._functions: dict[str, Callable[..., Any]] = {}

    def record(self, value: Any) -> PythonRecord:  # noqa: ANN401
        """Return ``value`` as a record of this machine."""
        return PythonRecord(value)

    def call(self, function: str, *arguments: Any) -> int:  # noqa: ANN401
        """Call a function of the firmware; see :meth:`Machine.call`."""
        given = [_passed(argument) for argument in arguments]
        if function not in self._functions:
            self._functions[function] = self._firmware.function(function)
        result = self._functions[function](*given)
        for argument, values in zip(arguments, given, strict=True):
            if isinstance(argument, bytearray):
                argument[:] = bytes(values)
        return int(result or 0)


def _passed(argument: Any) -> Any:  # noqa: ANN401
    """An argument as a function of Python takes it."""
    if isinstance(argument, PythonRecord):
        return argument.value
    return list(argument) if isinstance(argument, bytes | bytearray) else argument


def c_name(function: str) -> str:
    """The C name of a function of the firmware."""
    return f"canroll_{function.replace('.', '_')}"
