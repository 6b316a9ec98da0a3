"""Limit cycles of a recorded command, beside the run without control."""

from canroll.runs.limit_cycle import LimitCycle, oscillations, unexcited
from canroll.typing import Vector


def detect(
    t: Vector, command: Vector, t_passive: Vector, roll_passive: Vector
) -> LimitCycle | None:
    """Return the longest oscillation of the command that may be a limit cycle, or None."""
    cycles = unexcited(oscillations(t, command), lambda: [(t_passive, roll_passive)])
    return cycles[0] if cycles else None
