"""Loops of a function, and an order in which its blocks can be visited."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from graphlib import TopologicalSorter

from canroll.codegen.worst_case.machine_code import MachineFunction
from canroll.errors import CanrollError


@dataclass(frozen=True, slots=True)
class Region:
    """A function's body or a natural loop.

    Attributes:
        header: address of the block where it is entered.
        order: its blocks and inner loops, each after all that lead to it; back edges left out.
        blocks: addresses of all its blocks, those of inner loops included.
    """

    header: int
    order: tuple["int | Region", ...]
    blocks: frozenset[int]


def regions(function: MachineFunction) -> Region:
    """Return the body of ``function`` as nested regions.

    Raises:
        CanrollError: a loop that is entered at more than one place.
    """
    return Nesting(function).body


class Nesting:
    """The natural loops of a function, from the dominators of its blocks."""

    def __init__(self, function: MachineFunction) -> None:
        self.function = function
        self.next: Mapping[int, tuple[int, ...]] = {
            start: block.next for start, block in function.blocks.items()
        }

    @cached_property
    def before(self) -> Mapping[int, list[int]]:
        """Predecessors of each block."""
        found: dict[int, list[int]] = {start: [] for start in self.next}
        for start, targets in self.next.items():
            for target in targets:
                found[target].append(start)
        return found

    @cached_property
    def dominators(self) -> Mapping[int, set[int]]:
        """The dominators of each block."""
        entry = self.function.entry
        found = {start: set(self.next) for start in self.next}
        found[entry] = {entry}
        changed = True
        while changed:
            changed = False
            for start in self.next:
                if start == entry:
                    continue
                new = set.intersection(*(found[p] for p in self.before[start])) | {start}
                changed |= new != found[start]
                found[start] = new
        return found

    @cached_property
    def loops(self) -> Mapping[int, frozenset[int]]:
        """The blocks of each natural loop by its header."""
        found: dict[int, set[int]] = {}
        for start, targets in self.next.items():
            for header in targets:
                if header in self.dominators[start]:
                    body, todo = found.setdefault(header, {header}), [start]
                    while todo:
                        block = todo.pop()
                        if block not in body:
                            body.add(block)
                            todo.extend(self.before[block])
        return {header: frozenset(body) for header, body in found.items()}

    @property
    def body(self) -> Region:
        """All blocks of the function."""
        return self._region(self.function.entry, frozenset(self.next), None)

    def _region(self, header: int, blocks: frozenset[int], loop: int | None) -> Region:
        inner = {h: body for h, body in self.loops.items() if h in blocks and h != loop}
        outermost = {
            h: body
            for h, body in inner.items()
            if not any(h in other and h != o for o, other in inner.items())
        }
        owner = {block: h for h, body in outermost.items() for block in body}
        graph: dict[int, set[int]] = {}
        for block in sorted(blocks):
            place = owner.get(block, block)
            into = graph.setdefault(place, set())
            for p in self.before[block]:
                if p in blocks and owner.get(p, p) != place and block != loop:
                    into.add(owner.get(p, p))
        order = tuple(self._sorted(graph))
        return Region(
            header,
            tuple(
                self._region(item, outermost[item], item) if item in outermost else item
                for item in order
            ),
            blocks,
        )

    def _sorted(self, graph: Mapping[int, set[int]]) -> list[int]:
        try:
            return list(TopologicalSorter(graph).static_order())
        except ValueError:
            raise CanrollError(
                f"{self.function.name} has a loop with more than one entry: no bound"
            ) from None
