"""The timing budget of a calibration, compared with measurements."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from canroll.errors import CanrollError

KEYS = ("instructions", "cycles", "tick_p99_us", "latency_p99_us", "misses")


@dataclass(frozen=True, slots=True)
class Budget:
    """Limits of a tick's cost; None: not limited.

    Attributes:
        instructions: instructions of one tick on the target.
        cycles: cycles of one tick on the target, by the worst-case bound.
        tick_p99_us: 99th percentile of the tick's duration on the host.
        latency_p99_us: 99th percentile of the time from sample to force.
        misses: number of ticks that may be skipped in a run.
    """

    instructions: int | None = None
    cycles: int | None = None
    tick_p99_us: float | None = None
    latency_p99_us: float | None = None
    misses: int | None = 0


@dataclass(frozen=True, slots=True)
class BudgetVerdict:
    """Comparison of a limit and a measurement."""

    name: str
    limit: float
    value: float | None

    @property
    def ok(self) -> bool:
        """Whether it was measured and is within the limit."""
        return self.value is not None and self.value <= self.limit

    def __str__(self) -> str:
        value = "not measured" if self.value is None else f"{self.value:g}"
        return f"{'PASS' if self.ok else 'FAIL'}  {self.name:<16} {value}, budget {self.limit:g}"


def budget_of(tables: Mapping[str, Any]) -> Budget:
    """Return the budget in the table ``[budget]`` of a calibration file.

    Raises:
        CanrollError: an unknown key, or a limit that is not a number of at least 0.
    """
    given = dict(tables.get("budget", {}))
    for key, value in given.items():
        if key not in KEYS:
            raise CanrollError(f"[budget] unknown key '{key}': it has {', '.join(KEYS)}")
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
            raise CanrollError(f"[budget] {key} = {value!r}: must be a number of at least 0")
    return Budget(**given)


def judge_host(budget: Budget, timing: Mapping[str, Any]) -> list[BudgetVerdict]:
    """Compare the ``timing`` object of a run in real time with the limits for the host.

    The list is empty if ``timing["judged"]`` is False (fewer than two cores).
    """
    if not timing["judged"]:
        return []
    tick, latency = timing["tick_us"] or {}, timing["latency_us"] or {}
    measured = (
        ("misses", budget.misses, timing["deadline_misses"]),
        ("tick_p99_us", budget.tick_p99_us, tick.get("p99")),
        ("latency_p99_us", budget.latency_p99_us, latency.get("p99")),
    )
    return [
        BudgetVerdict(name, limit, value) for name, limit, value in measured if limit is not None
    ]


def judge_target(budget: Budget, instructions: int) -> list[BudgetVerdict]:
    """Compare the largest number of instructions of a tick on the target with the budget."""
    if budget.instructions is None:
        return []
    return [BudgetVerdict("instructions", budget.instructions, instructions)]
