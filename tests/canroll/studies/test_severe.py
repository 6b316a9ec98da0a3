"""Severe manoeuvres: what is driven, that it is paired, and what is said of it."""

import json
import sys

import pytest

from canroll.cases.execution import Execution
from canroll.cli.main import main
from canroll.plant_sim.driving import maneuvers
from canroll.runs.experiment import run
from canroll.studies import severe
from canroll.studies.severe import MANOEUVRES, Severe, SevereStudy, study
from canroll.studies.variation import NONE

SHORT = (Severe("double_lane_change", 80.0), Severe("bumps", 40.0))
CHOICES = {"runs": 2, "spread": NONE, "manoeuvres": SHORT, "law": "lqr", "vehicle": "van_real"}


@pytest.fixture(scope="module")
def found():
    return study(**CHOICES)


def test_every_manoeuvre_exists_with_its_options():
    for manoeuvre in MANOEUVRES:
        slowest, fastest = maneuvers.speed_range(manoeuvre.scenario)
        assert slowest <= manoeuvre.speed_kmh / 3.6 <= fastest
        assert set(manoeuvre.options) <= set(maneuvers.options(manoeuvre.scenario))


@pytest.mark.slow
def test_each_is_driven_by_all_four(found):
    names = ["passive", severe.BAR, severe.PLAIN, "lqr"]
    assert found.table.column("name") == 2 * names
    assert found.about["actuator"] == "bars" and "note" not in found.about
    passive, bar, *_ = found.table
    assert bar["roll_max_deg"] < passive["roll_max_deg"]
    with Execution(only=0).cases() as cases:
        passive, _, _, law = study(cases=cases, **CHOICES).table
    single = run("double_lane_change", vehicle="van_real", law="lqr", speed_kmh=80.0)
    assert law["roll_max_deg"] == pytest.approx(single.controlled_metrics.roll_max_deg)
    assert passive["roll_rms_deg"] == pytest.approx(single.passive_metrics.roll_rms_deg)


def test_two_processes_and_one_case_alone_have_the_same_figures(found):
    """Cases 2 and 3 are the vehicles over the bumps, equal but for their noise."""
    one_each = []
    for case in (2, 3):
        with Execution(jobs=2, only=case).cases() as cases:
            one_each.append(study(cases=cases, **CHOICES))
    for alone in one_each:
        assert (alone.about["runs"], alone.about["effort_nm"]) == (1, found.about["effort_nm"])
        assert "[" not in alone.shown().rows[1][3]
    for first, second, both in zip(
        *(s.table for s in one_each), list(found.table)[4:], strict=True
    ):
        assert (first["name"], first["manoeuvre"]) == (both["name"], both["manoeuvre"])
        mean = 0.5 * (first["roll_max_deg"] + second["roll_max_deg"])
        assert both["roll_max_deg"] == pytest.approx(mean, rel=1e-12)
        assert both["worst"] == max(first["worst"], second["worst"])


def test_a_stiff_bar_rolls_the_body_over_a_bump_on_one_side(found):
    passive, bar, *_ = list(found.table)[4:]
    assert bar["roll_max_deg"] > 1.1 * passive["roll_max_deg"]


def test_the_table_has_a_row_each(found):
    shown = found.shown()
    assert len(shown.rows) == 8
    assert {len(row) for row in shown.rows} == {len(shown.head)}
    assert shown.rows[0][:2] == ("double lane change 80 km/h", "passive")


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_gets_a_table_and_a_pipe_markdown(found, terminal, capsys, monkeypatch):
    noted = SevereStudy(
        {**found.about, "note": severe.OF_FILE.format("m8")}, found.table, found.against
    )
    monkeypatch.setattr(severe, "study", lambda **_: noted)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["compare", "--scenario", "severe", "--runs", "2"]) == 0
    printed, noted = capsys.readouterr()
    assert ("| --- |" in printed) != terminal
    assert "double lane change" in printed
    assert not terminal or "|" not in printed
    assert noted.startswith("note: the vehicles are spread by --spread")


def test_manoeuvres_that_differ_in_one_option_name_it():
    titles = [manoeuvre.title for manoeuvre in MANOEUVRES]
    assert len(set(titles)) == len(titles)
    assert all("scale" in title for title in titles if title.startswith("sine with dwell"))


@pytest.mark.slow
def test_the_command_prints_it(capsys):
    words = "compare --scenario severe --runs 2 --law lqr --vehicle suv_2020 --json"
    assert main(words.split()) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["vehicle"] == "suv_2020"
    assert len(answer["rows"]) == 4 * len(MANOEUVRES)
