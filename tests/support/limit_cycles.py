"""Limit cycles of a recorded command, beside the run without control."""

from canroll.runs.limit_cycle import oscillations, unexcited


def detect(t, command, t_passive, roll_passive):
    """Return the longest oscillation of the command that may be a limit cycle, or None."""
    cycles = unexcited(oscillations(t, command), lambda: [(t_passive, roll_passive)])
    return cycles[0] if cycles else None
