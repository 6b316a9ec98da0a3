"""A campaign's verdicts are those of single runs."""

from itertools import product

import numpy as np

from hil.campaign.plan import HELPS, SIDES, verdicts
from hil.runs.limit_cycle import LimitCycle
from hil.runs.metrics import Metrics
from hil.runs.standard import Judged, Outcome, Standard

EVENTS = list(product((False, True), repeat=3))
CASES = list(product((0.0, 1.0, 2.0), (0.5, 1.5), (0.5, 1.5), EVENTS))


def outcome(before, after, rms, events):
    over, under, cycle = events
    passive = Metrics(1.0, before, 3.0, 8.0, 0.5, 0.5, 0.0, 0.0, 0.1, 0.2, rollover=under)
    controlled = Metrics(rms, after, 3.0, 8.0, 0.5, 0.5, 9.0, 9.0, 0.1, 0.2, rollover=over)
    found = LimitCycle(5.0, 100.0, 1.0, 3.0) if cycle else None
    return Outcome(passive, controlled, found, Standard("none", Judged(()), Judged(())))


def test_helps_is_that_of_a_single_run():
    outcomes = [outcome(*case) for case in CASES]
    sides = {side: [getattr(each, side) for each in outcomes] for side in SIDES}
    columns = {
        f"{side}_{name}": np.array([getattr(figures, name) for figures in runs])
        for side, runs in sides.items()
        for name in ("roll_max_deg", "roll_rms_deg", "rollover")
    }
    columns["cycle_nm"] = np.array([100.0 * (o.limit_cycle is not None) for o in outcomes])
    found = verdicts(columns, np.zeros(len(outcomes), dtype=bool))
    assert list(found == HELPS) == [bool(o.helps) for o in outcomes]
