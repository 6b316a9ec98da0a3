"""A run that was not what it claims to be has no verdict, and says why."""

from dataclasses import replace

import pytest

from canroll.runs import experiment, validity

GOOD = validity.RunTiming(
    due=697,
    ticks=697,
    tick=0.01,
    plant_late=[1e-5] * 14_000,
    frames=3700,
    lost=0,
    planned=6.98,
    driven=6.98,
    rolled_over=False,
    commands=145,
    latencies=145,
    latency_p99=0.0075,
    latency_bound=0.031,
    compilations=0,
)


def test_a_good_run_has_a_verdict():
    assert validity.reasons(GOOD) == []
    assert validity.reasons(replace(GOOD, driven=3.0, rolled_over=True)) == []
    assert validity.reasons(replace(GOOD, plant_late=[])) == []


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"ticks": 689}, "689 of 697 ticks were run (at least 99 %)"),
        ({"driven": 1.4}, "the run ended after 1.40 s of 6.98 s"),
        ({"plant_late": [0.02] * 2 + [0.0] * 98}, "2 of 100 plant steps were over a tick late"),
        ({"plant_late": [0.074] + [0.0] * 999}, "the plant stood still for 74 ms (at most 50 ms)"),
        ({"lost": 4}, "4 of 3700 frames were lost (at most 0.1 %)"),
        ({"latencies": 0, "latency_p99": None}, "the latency of 0 of 145 commands is known"),
        ({"commands": 0, "latencies": 0}, "the latency of 0 of 0 commands is known"),
        ({"latency_p99": 0.042}, "latency of 42.0 ms (99th percentile; at most 41.0 ms"),
        ({"compilations": 3}, "3 functions were compiled during the run"),
    ],
)
def test_every_bound_is_judged(change, told):
    (reason,) = validity.reasons(replace(GOOD, **change))
    assert reason.startswith(told)


@pytest.mark.parametrize(
    "change",
    [
        {"ticks": 691},
        {"lost": 3},
        {"latency_p99": 0.0409},
        {"plant_late": [0.02] + [0.0] * 199},
        {"latencies": 131},
    ],
)
def test_within_the_bounds_it_stands(change):
    assert validity.reasons(replace(GOOD, **change)) == []


def test_what_is_not_valid_neither_helps_nor_passes():
    result = experiment.run("double_lane_change", law="lqr", duration=1.0)
    assert result.helps
    assert result.exit_code == 0
    spoiled = replace(result, timing={"not_valid": ["4 of 9 frames were lost"]})
    assert spoiled.helps is None
    assert spoiled.exit_code == 1
    assert spoiled.verdict == "Not valid: 4 of 9 frames were lost"
    answer = spoiled.to_json()
    assert answer["helps"] is None
    assert answer["standard"] is None
    assert answer["not_valid"] == ["4 of 9 frames were lost"]
