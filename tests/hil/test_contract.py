"""The comparison contract: its statistics, its verdicts, and one short run of it."""

import numpy as np
import pytest
from scipy import stats

from canroll.errors import CanrollError
from hil import contract
from hil.contract import FIGURES, Comparison, Entry, Row, compare, paired, table


def row(name, *, roll=1.0, peak=2.0, moment=500.0, most=900.0, transfer=0.3, seed=0):
    rng = np.random.default_rng(5)
    level = np.array([roll, peak, moment, most, 0.3, transfer, transfer])
    own = np.random.default_rng(seed + 10)
    # what all laws share of a seed, and a little of their own
    figures = level * (1 + 0.1 * rng.normal(size=(50, 1)) + 0.002 * own.normal(size=(50, 7)))
    return Row(Entry(name, "S2", {}), 1.0, figures)


def comparison(*rows):
    return Comparison(rows, "hinf_delay", 500.0, 50, "500k", "van_2021", "double_lane_change")


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
    assert seen.verdict(reference) == ""
    pooled = np.std(reference.figures[:, 0])
    assert pooled > 0.05


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"roll": 1.05, "peak": 2.1}, "worse"),
        ({"roll": 0.9, "peak": 2.2}, "mixed"),
        ({"roll": 0.9, "peak": 1.8, "most": 1000.0}, "less roll, but more moment_max_nm"),
        (
            {"roll": 0.9, "peak": 1.8, "transfer": 0.35},
            "less roll, but more nlt_front_max, nlt_rear_max",
        ),
    ],
)
def test_losses_are_named(changes, verdict):
    reference, other = row("hinf_delay"), row("other", seed=2, **changes)
    assert comparison(reference, other).verdict(other) == verdict


def test_no_difference_is_no_win():
    reference = row("hinf_delay")
    same = Row(Entry("same", "S1", {}), 1.0, reference.figures.copy())
    assert comparison(reference, same).verdict(same) == "equal"


def test_one_run_has_no_interval():
    with pytest.raises(CanrollError, match="at least 2"):
        compare("double_lane_change", runs=1)


def test_laws_meet_the_budget_on_the_bus(monkeypatch):
    entries = (
        Entry("passive", "", {"law": "passive"}, scaled=False),
        Entry("hinf_delay", "S1", {"law": "hinf_delay"}),
        Entry("ay_feedforward", "S2", {"law": "ay_feedforward"}),
    )
    monkeypatch.setattr(contract, "CALIBRATION_SEEDS", (100_001,))
    monkeypatch.setattr(contract, "BUDGET_TOLERANCE", 0.01)
    found = compare("double_lane_change", vehicle="van_2021", runs=2, entries=entries)
    passive, paper, feedforward = found.rows
    assert paper.factor == pytest.approx(1.0, abs=0.03)
    for one in (paper, feedforward):
        assert one.mean("moment_rms_nm") == pytest.approx(found.budget, rel=0.03)
        assert one.mean("roll_rms_deg") < 0.8 * passive.mean("roll_rms_deg")
    assert passive.mean("moment_rms_nm") == pytest.approx(0.0, abs=1.0)
    assert found.verdict(feedforward) != "worse"
    lines = table(found)
    assert len(lines) == 5
    assert all(line.count("|") == lines[0].count("|") for line in lines)
    assert {item["law"] for item in contract.to_json(found)} == {e.name for e in entries}


def test_figures_are_metrics():
    from hil.metrics import Metrics

    assert set(FIGURES) <= set(Metrics.__annotations__)
