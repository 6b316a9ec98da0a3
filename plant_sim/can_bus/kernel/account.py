"""What has happened on a network so far, for Python: log entries, accounts, load."""

from dataclasses import dataclass

import numpy as np

from plant_sim.can_bus.kernel import layout
from plant_sim.can_bus.kernel.layout import Network


def drain(network: Network, cursor: int) -> tuple[np.ndarray, int, int]:
    """Return the log entries from number ``cursor`` on, the next cursor and how many were missed.

    Entries are missed where more were written since ``cursor`` than the ring holds.
    """
    total = int(network.clock[layout.LOGGED])
    size = len(network.log)
    first = max(cursor, total - size)
    entries = network.log[np.arange(first, total) % size]
    return entries, total, first - cursor


@dataclass(frozen=True, slots=True)
class Account:
    """Where the frames of one segment went; ``offered`` is the sum of all the others."""

    offered: int
    outcomes: dict[str, int]
    waiting: int

    @property
    def balanced(self) -> bool:
        """True where every frame is accounted for."""
        return self.offered == sum(self.outcomes.values()) + self.waiting


def account(network: Network, segment: int) -> Account:
    """Return the account of every frame that was queued on ``segment``."""
    on_segment = network.nodes["segment"] == segment
    totals = network.totals[segment]
    outcomes = {
        name: int(totals[code]) for code, name in enumerate(layout.OUTCOMES) if code != layout.ERROR
    }
    waiting = int(network.nodes["pending"][on_segment].sum())
    return Account(int(totals[layout.OFFERED]), outcomes, waiting)


def load(network: Network, segment: int) -> float:
    """Return the share of time up to now in which ``segment`` was busy, interframe spaces too."""
    now = int(network.clock[layout.NOW])
    return int(network.segments["busy_ns"][segment]) / now if now else 0.0
