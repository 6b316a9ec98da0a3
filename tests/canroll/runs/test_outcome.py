"""The answer of a pair of runs: roll, rollover and the standard together."""

from dataclasses import replace

import pytest

from canroll.cli import run_view, terminal
from canroll.plant_sim.driving.standards import Verdict
from canroll.report.run_page import verdict
from canroll.runs import experiment
from canroll.runs.limit_cycle import LimitCycle
from canroll.runs.metrics import Metrics
from canroll.runs.standard import Standard, StandardJudgement, StandardOutcome

BEFORE = Metrics(
    1.0, 2.0, 3.0, 8.0, 0.5, 0.5, 0.0, 0.0, 0.1, 0.2, 0.01, 0.02, 0.03, 0.0, 0.0, rollover=False
)
AFTER = replace(BEFORE, roll_rms_deg=0.5, roll_max_deg=1.0, moment_rms_nm=900.0)
OVER = replace(BEFORE, roll_rms_deg=0.3, roll_max_deg=9.0, rollover=True)


def cones(hit):
    return StandardJudgement(
        (Verdict("cones hit", "ISO 3888-2, 4", float(hit), 0.0, "", hit == 0),)
    )


def outcome(passive=BEFORE, controlled=AFTER, cones_passive=0, cones_controlled=0, cycle=None):
    judged = Standard("ISO 3888-2, non-standard: x", cones(cones_passive), cones(cones_controlled))
    return StandardOutcome(passive, controlled, cycle, judged)


def test_green_is_less_roll_with_the_standard_met():
    found = outcome()
    assert (found.helps, found.good) == (True, True)
    assert found.sentence == "Control helps: largest roll angle 1.00° instead of 2.00° (−50 %)"


def test_a_manoeuvre_without_criteria_is_judged_by_roll_alone():
    found = replace(
        outcome(), standard=Standard("none", StandardJudgement(()), StandardJudgement(()))
    )
    assert found.good is True and found.sentence.startswith("Control helps: largest")


def test_a_standard_that_neither_run_meets_is_neither_good_nor_bad():
    found = outcome(cones_passive=9, cones_controlled=7)
    assert (found.helps, found.good) == (True, None)
    assert found.sentence == (
        "Control helps, ISO 3888-2 not met: cones hit 7 (limit 0); "
        "largest roll angle 1.00° instead of 2.00° (−50 %)"
    )


def test_a_standard_that_control_alone_fails_is_bad():
    found = outcome(cones_controlled=1)
    assert (found.helps, found.good) == (True, False)
    assert "ISO 3888-2 met only without it: cones hit 1 (limit 0)" in found.sentence


def test_a_rollover_that_control_prevents_is_the_headline_even_where_the_rms_rose():
    found = outcome(passive=OVER)
    assert AFTER.roll_rms_deg > OVER.roll_rms_deg
    assert (found.helps, found.good) == (True, True)
    assert found.sentence.startswith("Control prevents the rollover: largest roll angle 1.00°")


@pytest.mark.parametrize(
    ("passive", "headline"),
    [(OVER, "Control does not prevent the rollover: "), (BEFORE, "Control causes a rollover: ")],
)
def test_a_rollover_with_control_is_bad(passive, headline):
    found = outcome(passive=passive, controlled=replace(AFTER, rollover=True))
    assert (found.helps, found.good) == (False, False)
    assert found.sentence.startswith(headline)


def test_a_prevented_rollover_does_not_excuse_a_limit_cycle():
    found = outcome(passive=OVER, cycle=LimitCycle(5.0, 900.0, 1.0, 3.0))
    assert found.good is False and found.sentence.startswith("The loop is unstable, limit cycle: ")


def test_the_criterion_that_decided_is_named():
    found = outcome(controlled=replace(AFTER, roll_rms_deg=1.08))
    assert found.good is False
    assert found.sentence == (
        "Control does not help: RMS roll angle not reduced, 1.08° instead of 1°; "
        "largest roll angle 1.00° instead of 2.00° (−50 %)"
    )
    higher = outcome(controlled=replace(AFTER, roll_max_deg=2.5))
    assert higher.sentence == (
        "Control does not help: largest roll angle 2.50° instead of 2.00° (+25 %)"
    )


@pytest.mark.parametrize(
    ("passive", "hit", "sentence"),
    [
        (BEFORE, 0, "Without control: largest roll angle 2.00°"),
        (BEFORE, 3, "Without control, ISO 3888-2 not met: cones hit 3 (limit 0); largest roll"),
        (OVER, 0, "Without control the vehicle rolls over: largest roll angle 9.00°"),
    ],
)
def test_a_run_without_control_is_never_judged_good_or_bad(passive, hit, sentence):
    found = outcome(passive=passive, controlled=None, cones_passive=hit)
    found = replace(found, standard=replace(found.standard, controlled=None))
    assert (found.helps, found.good) == (None, None)
    assert found.sentence.startswith(sentence)


@pytest.fixture(scope="module")
def driven():
    return experiment.run("double_lane_change", duration=1.0)


@pytest.mark.parametrize(
    ("hits", "good", "colour"),
    [((0, 0), True, "green"), ((9, 7), None, "yellow"), ((0, 7), False, "red")],
)
def test_terminal_page_json_and_exit_code_agree(driven, hits, good, colour, monkeypatch):
    judged = Standard("ISO 3888-2", *map(cones, hits))
    result = replace(driven, standard=judged, passive_metrics=BEFORE, controlled_metrics=AFTER)
    shown = []
    monkeypatch.setattr(
        terminal.Console, "print", lambda self, *texts, **options: shown.extend(texts)
    )
    terminal.show(run_view.parts(result))
    styles = {str(text): text.style for text in shown if isinstance(text, terminal.Text)}
    data = result.to_json()
    assert styles[data["verdict"]] == colour
    page = verdict(result)
    assert (page.good, data["good"], result.exit_code) == (good, good, 1 if good is False else 0)
    assert data["verdict"].startswith(f"{page.headline}: ")
