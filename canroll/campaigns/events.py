"""Events of a draw whose probability a campaign reports."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.campaigns.plan import GOOD, SIDES, of_side
from canroll.reaction.harm import HARMFUL
from canroll.runs import metrics

Rows = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a draw.

    Attributes:
        label: what the reports call it.
        level: a figure of each row that is at least 1 where the event occurs, and the closer to 1
            the nearer a draw is to it; None: there is no such figure.
        occurs: whether it occurs, for each row.
    """

    label: str
    level: Callable[[Rows], NDArray[np.float64]] | None
    occurs: Callable[[Rows], NDArray[np.bool_]]


ROLLOVER_DEG = 90.0
"""Largest roll angle of a vehicle that rolls over, of a car at least: the run ends before."""


def _roll(side: str) -> Callable[[Rows], NDArray[np.float64]]:
    def level(rows: Rows) -> NDArray[np.float64]:
        near = np.minimum(rows[f"{side}_roll_max_deg"] / ROLLOVER_DEG, 1.0 - 1e-9)
        return np.where(rows[f"{side}_rollover"], 1.0, near)

    return level


def _transfer(side: str) -> Callable[[Rows], NDArray[np.float64]]:
    def level(rows: Rows) -> NDArray[np.float64]:
        return np.maximum(rows[f"{side}_nlt_front_max"], rows[f"{side}_nlt_rear_max"])

    return level


def _harm(rows: Rows) -> NDArray[np.float64]:
    return metrics.harm(*(of_side(rows, side) for side in SIDES))


def _from(level: Callable[[Rows], NDArray[np.float64]], label: str) -> Event:
    return Event(label, level, lambda rows: level(rows) >= 1.0)


EVENTS: Mapping[str, Event] = {
    "fails": Event("control fails", None, lambda rows: ~np.isin(rows["verdict"].astype(str), GOOD)),
    "rollover": _from(_roll("controlled"), "rollover with control"),
    "rollover_passive": _from(_roll("passive"), "rollover without control"),
    "wheel_lift": _from(_transfer("controlled"), "a wheel lifts with control"),
    "wheel_lift_passive": _from(_transfer("passive"), "a wheel lifts without control"),
    "limit_cycle": Event("limit cycle", None, lambda rows: rows["cycle_nm"] > 0.0),
    "harm": _from(_harm, f"roll angle or path error over {HARMFUL:g} times those without control"),
}
"""By name. A wheel lifts where the load transfer of its axle reaches 1."""
LEVELLED = tuple(name for name, event in EVENTS.items() if event.level is not None)
"""Events that rare-event simulation can approach."""
