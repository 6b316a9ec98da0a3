"""Verdicts of the standards, and the replay of the passive run's steering."""

import json
from dataclasses import replace

import numpy as np
import pytest

from canroll.cli import run_view, terminal
from canroll.cli.main import main
from canroll.plant_sim.driving import maneuvers, standards
from canroll.report.run_page import run_page
from canroll.runs import experiment, standard, steering_replay


@pytest.fixture(scope="module")
def nonlinear():
    return experiment.run("double_lane_change", plant="nonlinear", law="lqr", speed_kmh=100)


@pytest.fixture(scope="module")
def linear():
    return experiment.run("double_lane_change", law="lqr", plant="roll1")


def test_both_runs_are_judged_as_the_standard_does(nonlinear):
    data = json.loads(json.dumps(nonlinear.to_json()["standard"], allow_nan=False))
    assert data["name"] == "ISO 3888-1, non-standard: driven faster than 80 km/h"
    for name, trace in (("passive", nonlinear.passive), ("controlled", nonlinear.controlled)):
        wanted = standards.judge("double_lane_change", nonlinear.settings.vehicle, trace.signals)
        assert [c["criterion"] for c in data[name]["criteria"]] == [v.criterion for v in wanted]
        assert [c["value"] for c in data[name]["criteria"]] == [v.value for v in wanted]
        assert data[name]["passed"] == all(verdict.passed for verdict in wanted)


def test_a_narrower_lane_is_no_standard_lane():
    result = experiment.run("double_lane_change", vehicle="van_2021", law="passive", duration=1.0)
    assert "non-standard: lane offset" in result.standard.name


def test_a_run_that_was_cut_short_is_not_judged():
    result = experiment.run("sine_with_dwell", law="passive", duration=1.0)
    data = result.to_json()["standard"]
    assert data["passive"] == {"passed": None, "criteria": []} and data["controlled"] is None
    assert standard.lines(result.standard) == []


def test_a_manoeuvre_without_standard_has_no_verdict():
    result = experiment.run("roundabout", law="passive")
    data = result.to_json()["standard"]
    assert data["name"] == "none" and data["passive"] == {"passed": None, "criteria": []}


def test_a_rollover_fails_whatever_else_was_not_driven(make_trace, linear):
    trace = make_trace()
    signals = {**trace.signals, "rollover": np.ones_like(trace.signals["time"])}
    for wheel in standards.WHEELS:
        signals[f"wheel_height_{wheel}"] = np.zeros_like(trace.signals["time"])
    vehicle = linear.settings.vehicle
    maneuver = maneuvers.build("fishhook", vehicle)
    found = standard.assess(maneuver, vehicle, replace(trace, signals=signals, duration=2.0), None)
    assert found.passive.passed is False
    assert "rolled over" in standard.sentence(found.passive)
    assert json.dumps(found.to_json(), allow_nan=False)


def test_replay_steers_as_the_passive_run(nonlinear):
    first, second = nonlinear.passive.signals["steer"], nonlinear.replay.signals["steer"]
    np.testing.assert_allclose(second, first, rtol=0, atol=1e-12)
    assert not np.array_equal(first, nonlinear.controlled.signals["steer"])
    assert nonlinear.replay_metrics.moment_max_nm > 100
    data = nonlinear.to_json()
    assert set(data["replay"]) == set(data["controlled"])
    assert data["replay"]["roll_max_deg"] < data["passive"]["roll_max_deg"]


def test_the_path_error_of_a_replay_is_measured_as_the_driver_does(nonlinear):
    """On the passive run, where the driver kept his own account: one step later."""
    settings = nonlinear.settings
    maneuver = maneuvers.build("double_lane_change", settings.vehicle, settings.speed)
    again = np.concatenate([*steering_replay.path_error(nonlinear.passive, maneuver.drive)])
    recorded = nonlinear.passive.signals["path_error"]
    np.testing.assert_allclose(again[:-1], recorded[1:], rtol=0, atol=1e-9)
    assert 0.05 < nonlinear.replay_metrics.path_error_max_m < 2.0


def test_no_replay_where_control_does_not_change_the_steering(linear):
    assert linear.replay is None and linear.to_json()["replay"] is None
    assert np.array_equal(linear.passive.signals["steer"], linear.controlled.signals["steer"])
    played_back = experiment.drive(
        linear.settings,
        experiment.plan("double_lane_change", law="lqr")[1],
        enabled=True,
        steer=linear.passive.signals["steer"],
    )
    for name in ("roll", "y", "moment_front"):
        np.testing.assert_allclose(
            played_back.signals[name], linear.controlled.signals[name], rtol=0, atol=1e-6
        )


def test_no_replay_of_steering_that_nobody_closes():
    result = experiment.run("sine_with_dwell", plant="nonlinear", law="lqr", duration=2.0)
    assert result.replay is None


def test_the_terminal_and_the_page_show_both(nonlinear, linear, capsys):
    page = run_page(nonlinear)
    assert '<th scope="col">replay</th>' in page and 'data-key="replay.roll_max_deg"' in page
    assert "<h2>ISO 3888-1, non-standard: driven faster than 80 km/h</h2>" in page
    assert '<th scope="col">replay</th>' not in run_page(linear)
    assert main(["run", "double_lane_change", "--law", "lqr", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["standard"]["name"] == "ISO 3888-1"
    terminal.show(run_view.parts(nonlinear))
    text = capsys.readouterr().out
    assert "replay" in text and "\n  controlled  " in text and "cones hit" in text
    terminal.show(run_view.parts(linear))
    assert "no replay, as it would equal the controlled run" in capsys.readouterr().out


@pytest.mark.parametrize("plant", ["roll1", "linear_car", "nonlinear"])
def test_the_driver_of_van_real_clears_the_cones(plant):
    """Tuned on the passive car; with control, which the driver was not tuned for, it holds too."""
    result = experiment.run("double_lane_change", plant=plant)
    assert result.settings.speed == pytest.approx(80 / 3.6)
    assert result.standard.passive.passed
    assert result.standard.controlled.passed
