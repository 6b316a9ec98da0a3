"""The comparison contract: its statistics, its verdicts, and one short run of it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from canroll.cases.execution import Cases, Execution
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.runs.experiment import drive, plan
from canroll.studies import equal_effort
from canroll.studies.effort import FIGURES, BudgetError, EffortRun, at_budget, at_rest
from canroll.studies.effort_rows import EffortEntry, EffortRow
from canroll.studies.equal_effort import EffortComparison, compare, half_upright, paired, table
from canroll.studies.variation import DEFAULT_SPREAD


def row(name, *, roll=1.0, peak=2.0, moment=500.0, most=900.0, transfer=0.3, steer=2.0, seed=0):
    rng = np.random.default_rng(5)
    level = np.array([roll, peak, moment, most, 0.3, transfer, transfer, steer])
    own = np.random.default_rng(seed + 10)
    # what all laws share of a seed, and a little of their own
    figures = level * (1 + 0.1 * rng.normal(size=(50, 1)) + 0.002 * own.normal(size=(50, 8)))
    return EffortRow(EffortEntry(name, "all_sensors", {}), 1.0, figures, 0.9 * figures[:, 0])


def comparison(*rows):
    return EffortComparison(rows, "hinf_delay", 500.0, 50, "500k", "van_2021", "double_lane_change")


def test_interval_is_that_of_the_paired_test():
    """Against scipy's paired t interval; 50 runs leave the normal quantile 3 % short."""
    rng = np.random.default_rng(1)
    base = rng.normal(10.0, 1.0, 50)
    values = 0.9 * base + rng.normal(0.0, 0.1, 50)
    found = paired(values, base)
    expected = stats.ttest_rel(values, base).confidence_interval(0.95)
    scale = base.mean()
    assert found.mean == pytest.approx((values - base).mean() / scale)
    assert found.low == pytest.approx(expected.low / scale, rel=5e-3)
    assert found.high == pytest.approx(expected.high / scale, rel=5e-3)


def test_pairing_sees_what_unpaired_runs_would_not():
    reference, better = row("hinf_delay"), row("lqg_delay", roll=0.98, peak=1.96, seed=1)
    seen = comparison(reference, better)
    assert seen.verdict(better) == "better"
    assert seen.verdict(reference) == "reference"
    pooled = np.std(reference.figures[:, 0])
    assert pooled > 0.05


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"roll": 1.05, "peak": 2.1}, "worse"),
        ({"roll": 0.9, "peak": 2.2}, "mixed"),
        ({"roll": 1.05, "peak": 2.1, "moment": 250.0}, "more roll for less moment"),
        ({"roll": 0.9, "peak": 1.8, "moment": 1000.0}, "less roll, but more RMS moment"),
        ({"roll": 0.9, "peak": 1.8, "most": 1000.0}, "less roll, but more peak moment"),
        (
            {"roll": 0.9, "peak": 1.8, "transfer": 0.35},
            "less roll, but more load transfer in front, load transfer in the rear",
        ),
        ({"roll": 0.9, "peak": 1.8, "steer": 2.2}, "less roll, but more steering"),
    ],
)
def test_losses_are_named(changes, verdict):
    reference, other = row("hinf_delay"), row("other", seed=2, **changes)
    assert comparison(reference, other).verdict(other) == verdict


def test_no_difference_is_no_win():
    reference = row("hinf_delay")
    same = replace(reference, entry=EffortEntry("same", "roll_rate_only", {}))
    assert comparison(reference, same).verdict(same) == "equal"


def test_one_run_has_no_interval():
    with pytest.raises(CanrollError, match="at least 2"):
        compare("double_lane_change", runs=1)


def test_limit_cycle_is_no_win_but_chance_is_none():
    reference, other = row("hinf_delay"), row("other", roll=0.9, peak=1.8, seed=2)
    oscillating = replace(other, cycles=6, oscillates=True)
    assert comparison(reference, oscillating).verdict(oscillating) == "limit cycle in 6 of 50 runs"
    assert not EffortRun(1.0, other.figures, 5).oscillates
    assert EffortRun(1.0, other.figures, 6).oscillates
    assert not EffortRun(1.0, other.figures[:2], 1).oscillates
    assert EffortRun(1.0, other.figures[:2], 2).oscillates


def law(effort, cycles=lambda factor: 0):
    """Return a law whose RMS moment is ``effort`` of its factor, told as driving it would."""

    def drive_at(factor):
        figures = np.zeros((20, len(FIGURES)))
        figures[:, FIGURES.index("moment_rms_nm")] = effort(factor)
        return EffortRun(factor, figures, cycles(factor))

    return drive_at


@pytest.mark.parametrize("budget", [1.0, 70.0, 390.0, 900.0])
@pytest.mark.parametrize(
    "effort",
    [
        lambda factor: 300.0 * factor,
        lambda factor: 1000.0 * math.tanh(factor),
        lambda factor: 100.0 * factor**2,
        lambda factor: 500.0 * factor + 2e4 * max(0.0, factor - 1.0),
    ],
)
def test_a_law_is_scaled_to_the_budget(effort, budget):
    found = at_budget(law(effort), budget)
    assert found.effort == pytest.approx(budget, rel=0.005)
    assert found.effort == pytest.approx(effort(found.factor))


def test_a_law_that_cannot_meet_the_budget_says_why():
    with pytest.raises(BudgetError, match=r"does not reach .* 598 N·m at 3.99 times") as weak:
        at_budget(law(lambda factor: 150.0 * factor), 700.0)
    assert weak.value.nearest.factor == 3.99
    with pytest.raises(BudgetError, match=r"jumps from 100 to 800 N·m at 0.70 times") as jump:
        at_budget(law(lambda factor: 100.0 if factor < 0.7 else 800.0), 400.0)
    assert jump.value.nearest.effort == 100.0


def test_the_reference_gives_up_gain_until_it_rests():
    oscillating = law(lambda factor: 100.0 * factor, lambda factor: 20 * (factor > 0.65))
    assert at_rest(oscillating).factor == 0.6
    with pytest.raises(CanrollError, match=r"even at 0\.1"):
        at_rest(law(lambda factor: 100.0, lambda factor: 20))


def test_laws_meet_the_budget_on_the_bus():
    entries = (
        EffortEntry("passive", "", {"law": "passive"}, scaled=False),
        EffortEntry(
            "hinf_delay",
            "roll_rate_only",
            {"law": "hinf_delay", "gains": "theorem", "unverified": True},
        ),
        EffortEntry("ay_feedforward", "all_sensors", {"law": "ay_feedforward"}),
        EffortEntry("too weak", "all_sensors", {"law": "ay_feedforward", "speed_kmh": 30.0}),
    )
    choices = {"vehicle": "van_2021", "runs": 2, "entries": entries, "reference": "hinf_delay"}
    choices |= {"conditions": {"plant": "roll1"}}
    with Execution(jobs=2).cases() as cases:
        found = compare("double_lane_change", **choices, cases=cases)
    passive, paper, feedforward, weak = found.rows
    alone = compare("double_lane_change", **choices, cases=Cases(execution=Execution(only=2)))
    one, all_rows = (equal_effort.to_json(each)["rows"] for each in (alone, found))
    assert [row["law"] for row in one] == ["passive", "hinf_delay", "ay_feedforward"]
    assert one[2] == all_rows[2]
    assert paper.factor == 1.0
    assert feedforward.mean("moment_rms_nm") == pytest.approx(found.budget, rel=0.005)
    for one in (paper, feedforward):
        assert one.mean("roll_rms_deg") < 0.8 * passive.mean("roll_rms_deg")
    assert passive.mean("moment_rms_nm") == pytest.approx(0.0, abs=1.0)
    assert found.verdict(feedforward) == "better"
    assert "does not reach the RMS moment" in found.verdict(weak)
    assert weak.mean("moment_rms_nm") < 0.9 * found.budget
    shown = table(found)
    assert len(shown.rows) == 4
    assert all(len(row) == len(shown.head) for row in shown.rows)
    assert {row["law"] for row in all_rows} == {e.name for e in entries}


def test_a_law_certified_for_the_roll_model_alone_is_told_where_it_swings():
    """On the nonlinear van with bars the certified roll-rate gain is too much for its wheels."""
    found = compare(
        "moose",
        vehicle="van_real",
        runs=2,
        entries=(
            EffortEntry(
                "hinf_delay",
                "roll_rate_only",
                {"law": "hinf_delay", "gains": "theorem", "unverified": True},
            ),
        ),
        reference="hinf_delay",
        conditions={"plant": "nonlinear", "actuator": "bars", "speed_kmh": 80.0},
    )
    designed, paper = found.rows
    assert (designed.entry.name, designed.factor) == ("hinf_delay as designed", 1.0)
    assert found.verdict(designed) == "limit cycle in 2 of 2 runs"
    assert paper.factor < 1.0
    assert not paper.oscillates
    assert found.budget == paper.mean("moment_rms_nm") < designed.mean("moment_rms_nm")


def test_figures_are_metrics():
    from canroll.runs.metrics import Metrics

    assert set(FIGURES[:-1]) <= set(Metrics.__annotations__)


@pytest.mark.slow
def test_laws_stand_above_the_bound_of_every_vehicle():
    entries = (
        EffortEntry("passive", "", {"law": "passive"}, scaled=False),
        EffortEntry("best passive bar", "", {"law": "passive"}, scaled=False, best_bar=True),
        EffortEntry("plain_feedforward", "all_sensors", {"law": "plain_feedforward"}),
        EffortEntry("ay_feedforward", "all_sensors", {"law": "ay_feedforward"}),
    )
    found = compare(
        "double_lane_change",
        vehicle="van_real",
        bus="gateway_50ms",
        runs=3,
        entries=entries,
        effort=2000.0,
        spread=DEFAULT_SPREAD,
        conditions={"plant": "nonlinear"},
    )
    passive, bar, plain, predicting = found.rows
    assert found.budget == 2000.0
    assert np.ptp(passive.figures[:, 0]) > 0.02 * passive.mean("roll_rms_deg")
    assert math.isnan(passive.above_bound)
    assert math.isnan(bar.above_bound)
    assert bar.factor > 1.0
    assert np.all(bar.figures[:, 0] < passive.figures[:, 0])
    for figure in equal_effort.NO_WORSE:
        assert bar.mean(figure) <= 1.01 * passive.mean(figure)
    for law in (plain, predicting):
        assert law.mean("moment_rms_nm") == pytest.approx(2000.0, rel=0.005)
        assert np.all(law.bound < 1.01 * law.figures[:, 0])
    assert 0.0 < predicting.above_bound < 0.7 * plain.above_bound < 0.15
    assert f"{100 * plain.above_bound:+.1f} %" in table(found).rows[2]


def test_the_effort_by_default_is_half_of_what_holds_the_body_upright():
    choices = {"vehicle": "van_real", "plant": "nonlinear"}
    settings, controller = plan("double_lane_change", law="passive", **choices)
    lateral = drive(settings, controller, enabled=False).signals["ay"]
    upright = np.sqrt(np.mean((settings.vehicle.plant.roll_arm * lateral) ** 2))
    assert half_upright("double_lane_change", **choices) == pytest.approx(0.5 * upright, rel=0.05)


@pytest.mark.slow
def test_the_comparison_is_printed(capsys):
    arguments = ["compare", "--bus", "500k", "--runs", "2", "--vehicle", "van_2021"]
    assert main([*arguments, "--plant", "roll1", "--effort", "400", "--json"]) == 0
    rows = {row["law"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert rows["passive"]["above_bound"] is None
    law = rows["ay_feedforward"]
    above = law["roll_rms_deg"] / law["bound_roll_rms_deg"] - 1.0
    assert law["above_bound"] == pytest.approx(above)
    assert law["against_reference_low"] <= law["against_reference_high"]
