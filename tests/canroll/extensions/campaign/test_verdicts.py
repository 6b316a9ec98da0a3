"""A campaign's verdicts are those of single runs, its harm that of a run with faults."""

from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest

from canroll.extensions.campaign.cli.options import EVENT_NAMES
from canroll.extensions.campaign.events import EVENTS
from canroll.extensions.campaign.plan import (
    HELPS,
    NO_HELP,
    ROLLOVER,
    SIDES,
    STAYS_HARMLESS,
    verdicts,
)
from canroll.runs.limit_cycle import LimitCycle
from canroll.runs.metrics import Metrics
from canroll.runs.standard import Standard, StandardJudgement, StandardOutcome

HAPPENED = list(product((False, True), repeat=3))
CASES = list(product((0.0, 1.0, 2.0), (0.5, 1.5), (0.5, 1.5), HAPPENED))
BEFORE = Metrics(
    1.0, 2.0, 3.0, 8.0, 0.5, 0.5, 0.0, 0.0, 0.1, 0.2, 0.01, 0.02, 0.03, 0.0, 0.0, rollover=False
)


def outcome(before, after, rms, events):
    over, under, cycle = events
    passive = replace(BEFORE, roll_max_deg=before, rollover=under)
    effort = {"moment_rms_nm": 9.0, "moment_max_nm": 9.0}
    controlled = replace(BEFORE, roll_rms_deg=rms, roll_max_deg=after, rollover=over, **effort)
    found = LimitCycle(5.0, 100.0, 1.0, 3.0) if cycle else None
    return StandardOutcome(
        passive, controlled, found, Standard("none", StandardJudgement(()), StandardJudgement(()))
    )


def columns_of(outcomes):
    """The rows that a campaign would have of these runs."""
    columns = {
        f"{side}_{name}": np.array([getattr(getattr(each, side), name) for each in outcomes])
        for side in SIDES
        for name in asdict(BEFORE)
    }
    columns["cycle_nm"] = np.array([100.0 * (o.limit_cycle is not None) for o in outcomes])
    return columns


def test_helps_is_that_of_a_single_run():
    outcomes = [outcome(*case) for case in CASES]
    found = verdicts(columns_of(outcomes), np.zeros(len(outcomes), dtype=bool))
    assert list(found == HELPS) == [bool(o.helps) for o in outcomes]


@pytest.mark.parametrize(
    ("before", "after", "verdict"),
    [
        ({}, {"roll_max_deg": 2.19}, STAYS_HARMLESS),
        ({}, {"roll_max_deg": 2.21}, NO_HELP),
        ({}, {"roll_max_deg": 2.0, "path_error_max_m": 0.23}, NO_HELP),
        # less than 1 degree and 5 cm are no measure
        ({"roll_max_deg": 0.1}, {"roll_max_deg": 1.09}, STAYS_HARMLESS),
        ({"roll_max_deg": 0.1}, {"roll_max_deg": 1.11}, NO_HELP),
        ({"path_error_max_m": 0.01}, {"path_error_max_m": 0.054}, STAYS_HARMLESS),
        ({}, {"roll_max_deg": 1.9, "rollover": True}, ROLLOVER),
    ],
)
def test_harm_is_that_of_a_run_with_faults(before, after, verdict):
    passive = Metrics(**{**asdict(BEFORE), **before})
    # as large a roll as without control: it does not help
    controlled = Metrics(**{**asdict(passive), "moment_rms_nm": 9.0, **after})
    columns = columns_of(
        [StandardOutcome(passive, controlled, None, Standard("none", StandardJudgement(()), None))]
    )
    assert list(verdicts(columns, np.array([True]))) == [verdict]
    assert list(EVENTS["harm"].occurs(columns)) == [verdict != STAYS_HARMLESS]


def test_the_options_offer_all_events():
    """The parsers name them, for they must not import what computes them."""
    assert tuple(EVENTS) == EVENT_NAMES
