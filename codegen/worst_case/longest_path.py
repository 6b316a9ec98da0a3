"""Longest path through a function: maximum cycles and stack, from any state of the memory.

The code is run on intervals. Calls are followed, and loops are unrolled until no further iteration
is possible, so that every loop bound follows from the code and each call and each iteration has its
own ranges: the tree of all paths has no cycle, and its longest path is the one that an integer
program over the flow graph would find.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from capstone import CsInsn, arm

from canroll.codegen.operations.intervals import Value
from canroll.codegen.worst_case import library
from canroll.codegen.worst_case.arithmetic import NUMBER
from canroll.codegen.worst_case.conditions import EQ, NE, OPPOSITE, ZERO, where
from canroll.codegen.worst_case.control_flow import Region, regions
from canroll.codegen.worst_case.cycles import Timing
from canroll.codegen.worst_case.machine_code import (
    Block,
    MachineFunction,
    MachineImage,
    conditional,
)
from canroll.codegen.worst_case.machine_state import I32, LR, SP, Flags, MachineState, joined
from canroll.codegen.worst_case.transfer import Transfer
from canroll.errors import CanrollError

ROUNDS_MAX = 1024
DEPTH_MAX = 32


@dataclass(frozen=True, slots=True)
class Way:
    """The longest path to an address: its cycles, its last step and a link to the path before."""

    cycles: int
    function: str = ""
    own: int = 0
    before: "Way | None" = None

    def on(self, function: str, cycles: int) -> "Way":
        """This path extended by one step."""
        return Way(self.cycles + cycles, function, cycles, self)

    def steps(self) -> Iterator[tuple[str, int]]:
        """Function and cycles of every step, the last one first."""
        way: Way | None = self
        while way is not None:
            yield way.function, way.own
            way = way.before


@dataclass(frozen=True, slots=True)
class Bound:
    """Upper bounds of a call.

    Attributes:
        cycles: cycles of the longest path.
        stack: bytes below the stack pointer at the call.
        shares: cycles of the longest path by function.
        after: what is known when it returns, by whichever path.
    """

    cycles: int
    stack: int
    shares: dict[str, int]
    after: MachineState


@dataclass(slots=True)
class Arrival:
    """The state at an address, and the longest path to it."""

    state: MachineState
    way: Way

    def joined(self, other: "Arrival | None") -> "Arrival":
        """The longer of two paths to the same address."""
        if other is None:
            return self
        way = self.way if self.way.cycles >= other.way.cycles else other.way
        return Arrival(joined(other.state, self.state), way)


class LongestPath:
    """Bounds of the functions of one image.

    Args:
        image: linked machine code.
        transfer: effect of instructions on a state.
        timing: cycles of instructions.
    """

    def __init__(self, image: MachineImage, transfer: Transfer, timing: Timing) -> None:
        self.image, self.transfer, self.timing = image, transfer, timing
        self._regions: dict[int, Region] = {}
        self._lowest = 0
        self._library = {
            address: rounds
            for name, rounds in library.ROUNDS.items()
            if (address := image.symbols.get(name, (None,))[0]) is not None
            and _has_loops(image.function(address))
        }

    def bound(self, name: str, state: MachineState) -> Bound:
        """Return the bound of a call of ``name`` in ``state``.

        Raises:
            CanrollError: the code cannot be bounded: recursion, an endless loop, a jump through a
                pointer.
        """
        top = self._lowest = state.registers[SP].lo
        end = self._call(self.image.address(name), Arrival(state.copy(), Way(0)), 0)
        shares: Counter[str] = Counter()
        for function, cycles in end.way.steps():
            shares[function] += cycles
        del shares[""]
        return Bound(end.way.cycles, top - self._lowest, dict(shares.most_common()), end.state)

    def _call(self, address: int, arrival: Arrival, depth: int) -> Arrival:
        if depth > DEPTH_MAX:
            raise CanrollError(f"{self.image.functions.get(address)} calls too deep: recursion?")
        function = self.image.function(address)
        if address in self._library:
            return self._summary(function, self._library[address], arrival, depth)
        if address not in self._regions:
            self._regions[address] = regions(function)
        visit = _Visit(self, function, depth)
        visit.region(self._regions[address], {address: arrival})
        if visit.returned is None:
            raise CanrollError(f"{function.name} never returns")
        return visit.returned

    def _summary(
        self, function: MachineFunction, rounds: int, arrival: Arrival, depth: int
    ) -> Arrival:
        """A call of a compiler library routine; its registers are unknown afterwards."""
        state = arrival.state.copy()
        saved = sum(_stacked(insn) for b in function.blocks.values() for insn in b.instructions)
        bottom = state.registers[SP].lo - saved
        self._lowest = min(self._lowest, bottom)
        costs = {}
        for start, block in function.blocks.items():
            costs[start] = sum(self.timing.cost(insn) for insn in block.instructions)
            if block.calls is not None:
                inside = Arrival(MachineState.start(bottom), Way(0))
                costs[start] += self._call(block.calls, inside, depth + 1).way.cycles
        cycles = library.longest_way(function, rounds, costs, self.timing.refill)
        for register in (0, 1, 2, 3, 12, 14):
            state.set(register, I32)
        state.flags = None
        return Arrival(state, arrival.way.on(function.name, cycles))

    def saw_stack(self, state: MachineState) -> None:
        """Record the depth of the stack."""
        pointer = state.registers[SP]
        if pointer.lo != pointer.hi:
            raise CanrollError("the stack pointer is not known")
        self._lowest = min(self._lowest, pointer.lo)


def _stacked(insn: CsInsn) -> int:
    """Bytes by which an instruction lowers the stack pointer."""
    if insn.insn_name() == "push":
        return 4 * len(insn.operands)
    if insn.insn_name() == "sub" and insn.operands[0].reg == arm.ARM_REG_SP:
        return int(insn.operands[-1].imm)
    return 0


def _has_loops(function: MachineFunction) -> bool:
    """Whether the function has a backward edge."""
    try:
        body = regions(function)
    except CanrollError:
        return True
    return any(isinstance(item, Region) for item in body.order)


class _Visit:
    """One call of a function: its blocks in order, loops unrolled."""

    def __init__(self, analysis: LongestPath, function: MachineFunction, depth: int) -> None:
        self.analysis, self.function, self.depth = analysis, function, depth
        self.returned: Arrival | None = None

    def region(self, region: Region, arrivals: dict[int, Arrival]) -> dict[int, Arrival]:
        """Run a region once; return the arrivals outside it and at its header."""
        out: dict[int, Arrival] = {}
        for item in region.order:
            if isinstance(item, Region):
                self._loop(item, arrivals, region, out)
            elif item in arrivals:
                found = self.block(self.function.blocks[item], arrivals.pop(item))
                _sort_in(found, region, arrivals, out)
        return out

    def _loop(
        self, loop: Region, arrivals: dict[int, Arrival], outer: Region, out: dict[int, Arrival]
    ) -> None:
        here = arrivals.pop(loop.header, None)
        rounds = 0
        while here is not None:
            rounds += 1
            if rounds > ROUNDS_MAX:
                raise CanrollError(
                    f"no bound for the loop at {loop.header:#x} of {self.function.name}"
                )
            leaving = self.region(loop, {loop.header: here})
            here = leaving.pop(loop.header, None)
            _sort_in(leaving.items(), outer, arrivals, out)

    def block(self, block: Block, arrival: Arrival) -> list[tuple[int, Arrival]]:
        """Run a block; return the arrivals at its successors."""
        state, timing, name = arrival.state.copy(), self.analysis.timing, self.function.name
        cycles = 0
        for insn in block.instructions:
            cycles += timing.cost(insn)
            self.analysis.transfer.run(state, insn)
            self.analysis.saw_stack(state)
        here = Arrival(state, arrival.way.on(name, cycles))
        if block.table:
            return self._switch(block, here)
        goes_on = block.calls if block.calls is not None else block.tail
        if block.calls is not None:
            state.set(LR, Value(block.end | 1, block.end | 1))
        if goes_on is not None:
            here = self.analysis._call(goes_on, here, self.depth + 1)
        if block.returns:
            self.returned = here.joined(self.returned)
            if not block.next:
                return []
        if len(block.next) < 2 or block.calls is not None:
            return [(target, here) for target in block.next]
        return self._branch(block, here)

    def _branch(self, block: Block, here: Arrival) -> list[tuple[int, Arrival]]:
        """A conditional branch: both successors, where possible."""
        insn, (target, after) = block.last, block.next
        taken, straight = here.state.copy(), here.state
        if conditional(insn):
            condition = insn.cc
        else:
            register = NUMBER[insn.operands[0].reg]
            for state in (taken, straight):
                state.flags = Flags(state.registers[register], ZERO, register)
            condition = EQ if insn.insn_name() == "cbz" else NE
        arrivals = []
        there = where(taken, condition)
        if there is not None:
            arrivals.append(
                (
                    target,
                    Arrival(there, here.way.on(self.function.name, self.analysis.timing.refill)),
                )
            )
        on = where(straight, OPPOSITE[condition])
        if on is not None:
            arrivals.append((after, Arrival(on, here.way)))
        return arrivals

    def _switch(self, block: Block, here: Arrival) -> list[tuple[int, Arrival]]:
        """A switch: the targets that the index can select."""
        name = self.function.name
        if block.calls is not None:
            register = 0
            helper = self.analysis.image.function(block.calls)
            cycles = sum(
                self.analysis.timing.cost(i) for b in helper.blocks.values() for i in b.instructions
            )
            here = Arrival(here.state, here.way.on(helper.name, cycles))
            here.state.set(12, I32)
            here.state.set(14, I32)
        else:
            register = NUMBER[block.last.operands[0].mem.index]
        index = here.state.registers[register]
        low, high = max(index.lo, 0), min(index.hi, len(block.table) - 1)
        found: dict[int, Arrival] = {}
        for k in range(low, high + 1):
            state = here.state.copy()
            state.narrow(register, k, k)
            chosen = Arrival(state, here.way)
            found[block.table[k]] = chosen.joined(found.get(block.table[k]))
        if not found:
            raise CanrollError(f"the switch at {block.last.address:#x} of {name} has no case")
        return list(found.items())


def _sort_in(
    found: Iterable[tuple[int, Arrival]],
    region: Region,
    inside: dict[int, Arrival],
    outside: dict[int, Arrival],
) -> None:
    """Join arrivals within a region to ``inside``; its header counts as outside."""
    for target, arrival in found:
        place = inside if target in region.blocks and target != region.header else outside
        place[target] = arrival.joined(place.get(target))
