"""Abstract state of a processor's registers, flags and memory at one address of the code.

All values are intervals of signed 32-bit integers; memory not otherwise known has the range of the
firmware's field tables (proved for every store, :mod:`canroll.codegen.proof.prove`).
"""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass

from canroll.codegen.operations.intervals import Value, hull

I32 = Value(-(1 << 31), (1 << 31) - 1)
N_REGISTERS = 16
SP, LR, PC = 13, 14, 15


def wrapped(value: Value) -> Value:
    """``value`` in 32 bits of two's complement."""
    if I32.lo <= value.lo and value.hi <= I32.hi:
        return value
    if value.lo == value.hi:
        low = (value.lo + (1 << 31)) % (1 << 32) - (1 << 31)
        return Value(low, low)
    return I32


@dataclass(frozen=True, slots=True)
class Area:
    """A memory cell of ``size`` bytes whose content is always within ``value``.

    ``volatile``: an interrupt may change it between two instructions.
    """

    address: int
    size: int
    value: Value
    volatile: bool = False


class Promises:
    """Ranges of memory cells that always hold, by address.

    Args:
        areas: cells that do not overlap.
    """

    def __init__(self, areas: Iterable[Area]) -> None:
        self._areas = sorted(areas, key=lambda area: area.address)
        self._starts = [area.address for area in self._areas]

    def at(self, address: int, size: int) -> Area | None:
        """The range of the cell at ``address``; None if there is none of this size."""
        k = bisect_right(self._starts, address) - 1
        if k >= 0 and self._areas[k].address == address and self._areas[k].size == size:
            return self._areas[k]
        return None


@dataclass(frozen=True, slots=True)
class Flags:
    """Origin of the flags: ``a - b`` of two values, or the sign of one result.

    ``a_register`` and ``b_register`` still hold the values, ``result`` their difference; -1: none
    does. ``borrow``: carry and overflow are those of the difference, too.
    """

    a: Value
    b: Value
    a_register: int = -1
    b_register: int = -1
    result: int = -1
    borrow: bool = True


@dataclass(slots=True)
class MachineState:
    """Registers, flags and memory; ``origin`` is the cell that a register was loaded from."""

    registers: list[Value]
    flags: Flags | None
    memory: dict[int, tuple[int, Value]]
    origin: dict[int, int]

    @staticmethod
    def start(stack: int) -> "MachineState":
        """A state in which only the stack pointer is known."""
        state = MachineState([I32] * N_REGISTERS, None, {}, {})
        state.registers[SP] = Value(stack, stack)
        return state

    def copy(self) -> "MachineState":
        """An independent copy."""
        return MachineState(list(self.registers), self.flags, dict(self.memory), dict(self.origin))

    def set(self, register: int, value: Value) -> None:
        """Write a register and drop its link with the flags."""
        self.registers[register] = value
        self.origin.pop(register, None)
        flags = self.flags
        if flags and register in (flags.a_register, flags.b_register, flags.result):
            self.flags = Flags(
                flags.a,
                flags.b,
                -1 if flags.a_register == register else flags.a_register,
                -1 if flags.b_register == register else flags.b_register,
                -1 if flags.result == register else flags.result,
                flags.borrow,
            )

    def narrow(self, register: int, low: int, high: int) -> bool:
        """Restrict a register and its origin cell to [low, high]; return False if that is empty."""
        old = self.registers[register]
        if low > old.hi or high < old.lo:
            return False
        new = Value(max(old.lo, low), min(old.hi, high))
        self.registers[register] = new
        cell = self.origin.get(register)
        if cell is not None:
            self.memory[cell] = (self.memory[cell][0], new)
        return True

    def forget(self, low: int, high: int) -> None:
        """Forget the cells in [low, high), after a store to an unknown address there."""
        near = range(low - 3, high) if high - low <= 8 else list(self.memory)
        for cell in [
            c for c in near if c in self.memory and c < high and c + self.memory[c][0] > low
        ]:
            del self.memory[cell]
            self._unlink(cell)

    def store(self, address: int, size: int, value: Value) -> None:
        """A store into the cell at ``address``."""
        self.forget(address, address + size)
        self.memory[address] = (size, value)

    def loaded(self, register: int, address: int, size: int, value: Value) -> None:
        """``register`` holds the cell at ``address`` unchanged."""
        self.set(register, value)
        self.memory[address] = (size, value)
        self.origin[register] = address

    def _unlink(self, cell: int) -> None:
        for register in [r for r, c in self.origin.items() if c == cell]:
            del self.origin[register]


def joined(a: MachineState | None, b: MachineState) -> MachineState:
    """The smallest state that contains both."""
    if a is None:
        return b
    registers = [x if x == y else hull(x, y) for x, y in zip(a.registers, b.registers, strict=True)]
    memory = {}
    for cell, (size, value) in a.memory.items():
        other = b.memory.get(cell)
        if other is not None and other[0] == size:
            memory[cell] = (size, value if value == other[1] else hull(value, other[1]))
    origin = {r: cell for r, cell in a.origin.items() if b.origin.get(r) == cell and cell in memory}
    return MachineState(registers, a.flags if a.flags == b.flags else None, memory, origin)
