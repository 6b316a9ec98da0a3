"""Events of a draw whose probability a campaign reports."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canroll.extensions.campaign.plan import GOOD, SIDES, of_side
from canroll.reaction.harm import HARMFUL
from canroll.runs import metrics

Rows = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a draw.

    Attributes:
        label: what the reports call it.
        occurs: whether it occurs, for each row.
    """

    label: str
    occurs: Callable[[Rows], NDArray[np.bool_]]


def _rollover(side: str, label: str) -> Event:
    return Event(label, lambda rows: rows[f"{side}_rollover"].astype(bool))


def _wheel_lift(side: str, label: str) -> Event:
    axles = (f"{side}_nlt_front_max", f"{side}_nlt_rear_max")
    return Event(label, lambda rows: np.maximum(*(rows[axle] for axle in axles)) >= 1.0)


def _harm(rows: Rows) -> NDArray[np.bool_]:
    return metrics.harm(*(of_side(rows, side) for side in SIDES)) >= 1.0


EVENTS: Mapping[str, Event] = {
    "fails": Event("control fails", lambda rows: ~np.isin(rows["verdict"].astype(str), GOOD)),
    "rollover": _rollover("controlled", "rollover with control"),
    "rollover_passive": _rollover("passive", "rollover without control"),
    "wheel_lift": _wheel_lift("controlled", "a wheel lifts with control"),
    "wheel_lift_passive": _wheel_lift("passive", "a wheel lifts without control"),
    "limit_cycle": Event("limit cycle", lambda rows: rows["cycle_nm"] > 0.0),
    "harm": Event(f"roll angle or path error over {HARMFUL:g} times those without control", _harm),
}
"""By name. A wheel lifts where the load transfer of its axle reaches 1."""
