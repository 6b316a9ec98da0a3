"""What a loop does with one calibration: the values, ways and rounds of all that it can run.

``init`` and ``receive`` run from any state. What ``init`` leaves, with whatever ``tick`` then
stores, is an invariant of the ticks, closer than the declared ranges: an option that is off leaves
much of the state as it began. The states that ``init`` accepts and refuses have one each. Services
beside the loop run with any calibration, and what they store in its state counts as begun with.
"""

import ast
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import count

from canroll.codegen.operations.intervals import Value, hull
from canroll.codegen.proof.interpreter import FieldElement, Interpreter, Way
from canroll.codegen.proof.prove import any_calibration, entries_of
from canroll.codegen.subset.program import Program
from canroll.errors import CanrollError

WIDENED = 3
"""Rounds to an invariant after which an element that still grows has its declared range."""
NARROWED = 3
"""Rounds that narrow the invariant again; later ones hardly add to it."""
Ranges = Mapping[FieldElement, Value]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was seen, by syntax node, over all runs.

    Attributes:
        seen: the interval of each expression and store; what is not here is never reached.
        ways: whether each condition is ever true, ever false.
        served: nodes that services reach, for which the calibration is any.
    """

    seen: Mapping[ast.AST, Value]
    ways: Mapping[ast.expr, tuple[bool, bool]]
    served: Collection[ast.AST]


def outcome(program: Program, calibration: Mapping[tuple[str, tuple[int, ...]], int]) -> Outcome:
    """Run a program, its first entry module on ``calibration``: stored integers by element.

    Raises:
        CanrollError: an obligation is not met.
    """
    loop, *services = program.entries
    beside = Interpreter(program)
    for service in services:
        for function in entries_of(program, service):
            beside.run(function)
    run = Interpreter(program, calibration=calibration)
    entries = {function.name: function for function in entries_of(program, loop)}
    begun: dict[bool, Way] = {}
    for result, state in run.run(entries["init"]):
        state.names.clear()
        accepted = result == Value(0, 0)
        begun[accepted] = run.joined(begun.get(accepted), state)
    run.stored.clear()
    run.run(entries["receive"])
    interrupted = {**run.stored}

    def stored(ranges: Ranges) -> Ranges:
        trial = Interpreter(program, calibration=calibration)
        trial.ranges = ranges
        trial.run(entries["tick"])
        return trial.stored

    for start in begun.values():
        assert start is not None
        first = {element[1:]: value for element, value in start.known.items()}
        run.ranges = _invariant(_joined(first, interrupted, beside.stored), stored)
        run.run(entries["tick"])
    if run.findings:
        raise CanrollError(f"the code of one calibration is not proved: {run.findings[0]}")
    checked = any_calibration(program)
    if not checked.seen.keys().isdisjoint(beside.seen):
        beside.add(checked)
    run.add(beside)
    return Outcome(run.seen, run.ways, beside.seen.keys())


def _invariant(first: Ranges, stored: Callable[[Ranges], Ranges]) -> Ranges:
    """Ranges that hold at first and after every run, of which ``stored`` is what one stores."""
    ranges = first
    for attempt in count():
        after = _joined(ranges, stored(ranges))
        grown = {element for element, value in ranges.items() if after[element] != value}
        if not grown:
            break
        if attempt >= WIDENED:
            after = {e: value for e, value in after.items() if e not in grown}
        ranges = after
    for _ in range(NARROWED):
        # whatever there is was there at first, or stored by a run from within the ranges
        ranges = _joined(first, stored(ranges))
    return ranges


def _joined(first: Ranges, *others: Ranges) -> Ranges:
    """The elements of ``first``, each with what the others have of it."""
    ranges = dict(first)
    for other in others:
        for element in first.keys() & other.keys():
            ranges[element] = hull(ranges[element], other[element])
    return ranges
