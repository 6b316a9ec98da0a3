"""Severe manoeuvres: what is driven, that it is paired, and what is said of it."""

import json
import sys
from dataclasses import replace

import pytest

from canroll.cases.execution import Execution
from canroll.cli.main import main
from canroll.runs.experiment import run
from canroll.studies import severe
from canroll.studies.severe import MANOEUVRES, Severe, markdown, study
from canroll.studies.variation import NONE
from plant_sim.driving import maneuvers

SHORT = (Severe("double_lane_change", 80.0), Severe("bumps", 40.0))


@pytest.fixture(scope="module")
def found():
    return study(runs=2, spread=NONE, manoeuvres=SHORT, law="lqr", vehicle="van_real")


def test_every_manoeuvre_exists_with_its_options():
    for manoeuvre in MANOEUVRES:
        slowest, fastest = maneuvers.speed_range(manoeuvre.scenario)
        assert slowest <= manoeuvre.speed_kmh / 3.6 <= fastest
        assert set(manoeuvre.options) <= set(maneuvers.options(manoeuvre.scenario))


@pytest.mark.slow
def test_what_is_driven_of_a_fitted_vehicle_is_said(found):
    assert found.note == ""
    assert "note" not in severe.to_json(found)
    said = replace(found, note=severe.OF_FILE.format("m8"))
    assert severe.to_json(said)["note"].startswith("the vehicles are spread by --spread")


@pytest.mark.slow
def test_each_is_driven_by_all_four(found):
    names = ["passive", severe.BAR, severe.PLAIN, "lqr"]
    assert [row.name for row in found.rows] == 2 * names
    assert found.actuator == "bars"
    passive, bar, _, law = found.rows[:4]
    assert bar.mean("roll_max") < passive.mean("roll_max")
    single = run("double_lane_change", vehicle="van_real", law="lqr", speed_kmh=80.0)
    one = law.figures[0, severe.FIGURES.index("roll_max")]
    assert one == pytest.approx(single.controlled_metrics.roll_max_deg)
    assert passive.figures[0, 0] == pytest.approx(single.passive_metrics.roll_rms_deg)


def test_two_processes_and_one_case_alone_have_the_same_figures(found):
    """Case 3 is the second vehicle over the bumps."""
    choices = {"runs": 2, "spread": NONE, "manoeuvres": SHORT, "law": "lqr", "vehicle": "van_real"}
    with Execution(jobs=2, only=3).cases() as cases:
        alone = study(cases=cases, **choices)
    assert (alone.runs, alone.effort) == (1, found.effort)
    for row, whole in zip(alone.rows, found.rows[4:], strict=True):
        assert (row.name, row.manoeuvre) == (whole.name, whole.manoeuvre)
        assert row.figures.tolist() == whole.figures[1:].tolist()
    assert "[" not in markdown(alone)[3]


def test_a_stiff_bar_rolls_the_body_over_a_bump_on_one_side(found):
    passive, bar, *_ = found.rows[4:]
    assert bar.mean("roll_max") > 1.1 * passive.mean("roll_max")


def test_the_table_has_a_row_each(found):
    lines = markdown(found)
    assert len(lines) == 2 + 8
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| double lane change 80 km/h | passive |")


@pytest.mark.parametrize("terminal", [True, False])
def test_a_terminal_gets_a_table_and_a_pipe_markdown(found, terminal, capsys, monkeypatch):
    monkeypatch.setattr(severe, "study", lambda **_: found)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["severe", "--runs", "2"]) == 0
    printed = capsys.readouterr().out
    assert ("| --- |" in printed) != terminal
    assert "double lane change" in printed
    assert not terminal or "|" not in printed


def test_manoeuvres_that_differ_in_one_option_name_it():
    titles = [manoeuvre.title for manoeuvre in MANOEUVRES]
    assert len(set(titles)) == len(titles)
    assert all("scale" in title for title in titles if title.startswith("sine with dwell"))


@pytest.mark.slow
def test_the_command_prints_it(capsys):
    arguments = ["severe", "--runs", "2", "--law", "lqr", "--vehicle", "suv_2020"]
    assert main([*arguments, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["vehicle"] == "suv_2020"
    assert len(answer["rows"]) == 4 * len(MANOEUVRES)
