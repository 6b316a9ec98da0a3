"""Runs: ECU, bus and vehicle in one loop, the figures, the report, the ``canroll`` command.

>>> import hil
>>> result = hil.run("double_lane_change", vehicle="van_2021", law="lqr")
>>> result.helps
True
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hil.runs.experiment import run
    from hil.runs.result import Result

__all__ = ["Result", "run"]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Load the simulation when it is asked for: ``canroll --help`` must not wait for it."""
    if name == "run":
        from hil.runs.experiment import run  # noqa: PLC0415

        return run
    if name == "Result":
        from hil.runs.result import Result  # noqa: PLC0415

        return Result
    raise AttributeError(f"module 'hil' has no attribute '{name}'")
