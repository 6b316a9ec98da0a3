"""Bounds of what the authentication of frames adds to a tick, and to its longest path.

Its code knows no frames a tick: that many are verified as the bus can bring. So each of its
functions is bounded by itself, from any state of its record and for any frame, and counted as often
as it is called.
"""

from collections import Counter
from dataclasses import dataclass

from canroll.codegen.operations.intervals import Value
from canroll.codegen.worst_case.longest_path import Bound, LongestPath
from canroll.codegen.worst_case.machine_state import I32, MachineState

FRAME = 0x2000_8000
"""Where a frame is; any place apart from the records and the stack does."""


@dataclass(frozen=True, slots=True)
class Authentication:
    """Bounds of the authentication's functions, and how often a tick calls them.

    Attributes:
        elapse: called once.
        verify: called for each of ``received`` frames.
        protect: called for each of ``sent`` frames.
        received: frames received at most in the time of a tick.
        sent: frames sent at most by a tick.
    """

    elapse: Bound
    verify: Bound
    protect: Bound
    received: int
    sent: int

    @property
    def cycles(self) -> int:
        """Cycles of a tick."""
        return sum(times * bound.cycles for times, bound in self._calls())

    def around(self, loop: Bound) -> Bound:
        """The bound of a whole tick of which the loop's is ``loop``: one call after another."""
        shares = Counter(loop.shares)
        for times, bound in self._calls():
            for function, cycles in bound.shares.items():
                shares[function] += times * cycles
        stack = max(loop.stack, *(bound.stack for _, bound in self._calls()))
        return Bound(loop.cycles + self.cycles, stack, dict(shares.most_common()), after=loop.after)

    def _calls(self) -> tuple[tuple[int, Bound], ...]:
        return (1, self.elapse), (self.received, self.verify), (self.sent, self.protect)


def authentication_bound(
    analysis: LongestPath, record: int, stack: int, *, received: int, sent: int
) -> Authentication:
    """Bound the authentication of an image.

    Args:
        analysis: of the image, its ranges those of the authentication's record as well.
        record: address of the authentication's record.
        stack: where the stack begins.
        received: frames received at most in the time of a tick.
        sent: frames sent at most by a tick.

    Raises:
        CanrollError: the code cannot be bounded.
    """

    def of(name: str, *arguments: Value) -> Bound:
        start = MachineState.start(stack)
        for register, value in enumerate((Value(record, record), *arguments)):
            start.set(register, value)
        return analysis.bound(f"canroll_secoc_{name}", start)

    frame = Value(FRAME, FRAME)
    return Authentication(
        of("elapse", I32), of("verify", I32, frame, I32), of("protect", I32, frame), received, sent
    )
