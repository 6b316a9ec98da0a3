"""Longest path through the compiler's division routines by implicit path enumeration.

Their loops end by arithmetic that intervals cannot follow, so the loop bounds are stated here with
their reason; a test counts the iterations on an emulated processor. The longest path is then an
integer program over the execution counts of the flow graph's edges (Li and Malik 1995).
"""

from collections.abc import Mapping

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from canroll.codegen.worst_case.machine_code import Block, MachineFunction, conditional
from canroll.errors import CanrollError

ROUNDS = {
    "__aeabi_idiv": 5,
    "__divsi3": 5,
    "__aeabi_uidiv": 5,
    "__udivsi3": 5,
    "__divdi3": 64,
    "__udivdi3": 64,
    "__udivmoddi4": 64,
}
"""Visits of a block in one call at most: the 32-bit routines find 6 or 8 bits of the quotient a
round, and count rounds by at most 24 ones in a shifted word; the 64-bit ones find a bit a round."""


def longest_way(
    function: MachineFunction,
    rounds: int,
    costs: Mapping[int, int],
    refill: int,
) -> int:
    """Return the cycles of the longest path through ``function``.

    Args:
        function: its flow graph.
        rounds: maximum number of visits of each block, by its address.
        costs: cycles of each block by its address, including the function it calls.
        refill: additional cycles of a conditional branch that is taken.

    Raises:
        CanrollError: the integer program has no solution.
    """
    edges = list(_edges(function.blocks))
    starts = sorted(function.blocks)
    row = {start: k for k, start in enumerate(starts)}
    flow = np.zeros((len(starts), len(edges)))
    visits = np.zeros((len(starts), len(edges)))
    gain = np.zeros(len(edges))
    for k, (before, after, taken) in enumerate(edges):
        if before is not None:
            flow[row[before], k] -= 1
            gain[k] += costs[before] + refill * taken
        if after is not None:
            flow[row[after], k] += 1
            visits[row[after], k] += 1
    enters = np.array([before is None for before, _, _ in edges], float)
    found = milp(
        -gain,
        integrality=np.ones(len(edges), np.int64),
        bounds=Bounds(0, rounds),
        constraints=[
            LinearConstraint(flow, 0, 0),
            LinearConstraint(visits, -np.inf, rounds),
            LinearConstraint(enters[None, :], 1, 1),
        ],
    )
    if not found.success:
        raise CanrollError(f"no bound for {function.name}: {found.message}")
    return round(-found.fun)


def _edges(blocks: Mapping[int, Block]) -> list[tuple[int | None, int | None, bool]]:
    """Every edge and whether it is a taken branch; the entry edge and the exit edges."""
    entry = next(iter(blocks))
    edges: list[tuple[int | None, int | None, bool]] = [(None, entry, False)]
    for start, block in blocks.items():
        forks = len(block.next) == 2 and block.calls is None and not block.table
        for k, target in enumerate(block.next):
            edges.append((start, target, forks and k == 0))
        if block.returns:
            edges.append((start, None, conditional(block.last)))
    return edges
