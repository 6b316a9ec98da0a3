"""The page of a campaign: small whatever the number of draws, with the margins of failing draws."""

import numpy as np
import pytest

from canroll.extensions.campaign import campaign_file
from canroll.extensions.campaign.page import campaign_page
from canroll.extensions.campaign.plan import HELPS, LIMIT_CYCLE, SIDES, VERDICTS
from canroll.extensions.campaign.quantities import FAULTS
from canroll.extensions.campaign.sensitivity import MARGINS, predictions
from canroll.extensions.campaign.study import Campaign
from canroll.extensions.campaign.summary import FAILED, SAMPLE, Summary
from canroll.runs import experiment
from canroll.runs.metrics import BY_KEY
from canroll.studies import variation

MILLION = 1_000_000
BLOCK = 1 << 14
MOST_BYTES = 3_000_000


def planned(runs, **others):
    drawn = {
        "spread": variation.DEFAULT_SPREAD,
        "faults": ["Imu.RollRate=stuck@1", "front_left=weak:0.3"],
        **others,
    }
    return campaign_file.of_options(
        "roundabout",
        {"law": "lqr", "plant": "roll1"},
        runs=runs,
        seed=0,
        buses=["500k", "gateway_20ms"],
        **drawn,
    ).plan()


def synthetic(plan, count):
    """Rows of a table whose figures are random, with every verdict."""
    random = np.random.default_rng(0)
    rows = {f"{side}_{name}": random.lognormal(0, 1, count) for side in SIDES for name in BY_KEY}
    for side in SIDES:
        rows[f"{side}_rollover"] = random.random(count) < 0.01
    for name, distribution in zip(plan.space.names, plan.space.distributions, strict=True):
        values = distribution.quantile(random.random(count))
        rows[name] = (
            np.array(["; ".join(each) for each in values], dtype=object)
            if name == FAULTS
            else values
        )
    return {
        "redrawn": np.zeros(count, np.int64),
        **rows,
        **{name: random.random(count) for name in ("safe", "cycle_hz", "cycle_nm")},
        "verdict": random.choice(VERDICTS, count).astype(object),
    }


@pytest.mark.slow
def test_a_million_draws_make_a_page_of_three_megabytes_at_most():
    plan = planned(MILLION)
    block, summary = synthetic(plan, BLOCK), Summary()
    for first in range(0, MILLION, BLOCK):
        numbers = np.arange(first, min(first + BLOCK, MILLION))
        rows = {name: column[: len(numbers)] for name, column in block.items()}
        summary.add({"draw": numbers, **rows})
    assert summary.draws == MILLION
    assert len(summary.sample["draw"]) == SAMPLE
    assert len(summary.failed["draw"]) == FAILED
    campaign = Campaign(plan, experiment.simulate(plan.settings, plan.controller), summary)
    page = campaign_page(campaign, "canroll campaign", campaign.to_json())
    assert "1000000 draws" in page
    assert len(page.encode()) < MOST_BYTES


def test_margins_that_predict_the_failures_tell_them_apart():
    """All draws of the slow bus fail, and no other: a margin is less with the longer delay."""
    plan = planned(32, spread={}, faults=[])
    parts = [plan.draws(chunk)[0] for chunk in range(plan.chunks)]
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    slow = rows["bus"] == "gateway_20ms"
    rows["verdict"] = np.where(slow, LIMIT_CYCLE, HELPS).astype(object)
    failed = {name: column[slow] for name, column in rows.items()}
    found = predictions(plan, Summary(draws=32, sample=rows, failed=failed))
    assert [each.name for each in found] == list(MARGINS)
    gain, phase, modulus = found
    for margin in (gain, modulus):
        assert margin.failed < margin.good
        assert margin.separates == 1.0
    # at any phase the loop's gain is below 1
    assert (phase.failed, phase.good, phase.separates) == (180.0, 180.0, 0.5)
