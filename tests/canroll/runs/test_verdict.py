"""What the verdict of a run says, and what the command makes of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from canroll import vehicles
from canroll.cli import terminal
from canroll.cli.main import main
from canroll.handling.vehicle_tests import JUDGED
from canroll.plant_sim.driving import maneuvers, standards
from canroll.plant_sim.world.recording import SIGNALS
from canroll.report.tables import change, metric_rows
from canroll.runs import experiment, metrics, saved_run

SHORT = 2.5


@pytest.fixture(scope="module")
def short():
    return experiment.run("double_lane_change", duration=SHORT)


@pytest.mark.parametrize(
    "options", [["bumps", "--plant", "roll1"], ["double_lane_change", "--duration", "0.001"]]
)
def test_without_roll_there_is_nothing_to_reduce(options, capsys):
    assert main(["run", *options, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["verdict"].startswith("No roll to reduce: ")
    assert data["helps"] is None


def with_control(result, **figures):
    return replace(result, controlled_metrics=replace(result.controlled_metrics, **figures))


def test_a_worse_roll_rate_makes_the_verdict_mixed(short):
    before = short.passive_metrics.roll_rate_max_deg_s
    smooth = with_control(short, roll_rate_rms_deg_s=0.0, roll_rate_max_deg_s=1.04 * before)
    assert smooth.verdict.startswith("Control helps: ")
    rough = with_control(short, roll_rate_rms_deg_s=0.0, roll_rate_max_deg_s=1.06 * before)
    assert rough.helps
    assert rough.verdict.startswith("Mixed: ")
    assert "roll rate max" in rough.verdict and "roll rate RMS" not in rough.verdict


def test_wheels_on_the_road_are_said(short):
    lifted = replace(short.passive_metrics, nlt_front_max=0.9, nlt_rear_max=1.0)
    kept = "keeps the wheels on the road, which the passive car does not"
    assert kept in replace(short, passive_metrics=lifted).verdict and kept not in short.verdict
    both = with_control(replace(short, passive_metrics=lifted), nlt_front_max=1.0)
    assert kept not in both.verdict and "a wheel leaves" not in both.verdict
    only = with_control(short, nlt_front_max=1.0)
    assert only.verdict.startswith("Mixed: ") and "a wheel leaves the road" in only.verdict
    unknown = replace(short.passive_metrics, nlt_front_max=None, nlt_rear_max=None)
    assert kept not in replace(short, passive_metrics=unknown).verdict


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (0.100, 0.127, "; ride vertical 0.127 instead of 0.100 m/s² (+27 %)"),
        (0.100, 0.104, ""),
        # nobody feels 0.010 m/s²
        (0.004, 0.010, ""),
        (0.0, 0.02, "; ride vertical 0.020 instead of 0.000 m/s²"),
        (None, None, ""),
    ],
)
def test_a_worse_ride_that_is_felt_is_said(short, before, after, words):
    passive = replace(short.passive_metrics, ride_vertical_ms2=before)
    verdict = with_control(replace(short, passive_metrics=passive), ride_vertical_ms2=after).verdict
    assert verdict.startswith("Control helps: ")
    assert verdict.endswith(words) if words else "ride" not in verdict


def test_a_rollover_never_helps(short):
    assert with_control(short, rollover=True).helps is False


@pytest.mark.parametrize("larger", ["roll_rms_deg", "roll_max_deg"])
def test_no_is_exit_code_1_with_the_answer_printed(short, larger, monkeypatch, capsys, tmp_path):
    worse = with_control(short, **{larger: 99.0})
    monkeypatch.setattr(experiment, "run", lambda *args, **options: worse)
    out = tmp_path / "out"
    assert main(["run", "double_lane_change", "--json", "--out", str(out)]) == 1
    assert json.loads(capsys.readouterr().out)["helps"] is False
    assert (out / "report.html").exists()


@pytest.mark.parametrize("scenario", ["banked_curve", "random_road"])
def test_the_ceiling_is_blank_where_it_cannot_be_told(scenario):
    result = experiment.run(scenario, law="passive", duration=SHORT)
    assert set(result.to_json()["without_roll"].values()) == {None}


def test_the_ceiling_is_blank_with_a_wheel_in_the_air_and_never_above_1(make_trace):
    van = vehicles.load("van_real")
    trace = make_trace()
    trace.signals["ay"] = 50 * trace.signals["ay"]
    assert max(metrics.load_transfer_without_roll(trace, van, 0.5).values()) == 1
    trace.signals["wheel_load_front_left"][100] = 0.0
    assert set(metrics.load_transfer_without_roll(trace, van, 0.5).values()) == {None}


def test_roll1_is_warned_of_where_tyres_and_wheels_reach_their_limit():
    result = experiment.run("j_turn", law="passive", duration=0.1, plant="roll1")
    assert any("--plant nonlinear" in line for line in result.warnings)


def test_change_is_blank_against_nothing_and_path_rows_need_a_path(short):
    assert change(2.1, 0.002, 2).text == ""
    assert change(3.0, 2.0, 2).text == "+50 %"
    no_path = replace(
        short,
        passive_metrics=replace(short.passive_metrics, path_error_rms_m=0.0, path_error_max_m=0.0),
    )
    assert len(metric_rows(short)) == len(metric_rows(no_path)) + 2


def test_what_limit_accepts_is_what_has_criteria():
    van = vehicles.load("van_real")
    still = {name: np.zeros(10_000) for name in SIGNALS}
    still["steer"] = np.full(10_000, 0.01)
    assert [name for name in maneuvers.names() if standards.judge(name, van, still)] == sorted(
        JUDGED, key=maneuvers.names().index
    )


def test_limit_help_tells_its_own_default_plant(capsys):
    with pytest.raises(SystemExit):
        main(["handling", "limit", "--help"])
    out = " ".join(capsys.readouterr().out.split())
    assert "(default: nonlinear)" in out and "--speed" not in out


def test_a_table_into_a_closed_pipe_is_no_failure():
    """rich would exit with 1 here; the command must see the broken pipe itself."""
    with pytest.raises(BrokenPipeError):
        terminal.Console().on_broken_pipe()


def test_every_option_in_effect_is_written(tmp_path, capsys):
    assert main(["run", "moose", "--law", "passive", "--out", str(tmp_path)]) in {0, 1}
    title, _, line = capsys.readouterr().out.splitlines()[:3]
    assert title.startswith("moose, van_real at ")
    assert line.startswith("friction 0.6, chassis control ") and "preview time " in line
    assert ">0.6<" in (tmp_path / "report.html").read_text()
    written = json.loads((tmp_path / "result.json").read_text())["options_in_effect"]
    assert written["friction"] == 0.6 and "preview_time" in written
    assert saved_run.load(tmp_path).to_json()["options_in_effect"] == written


def test_an_option_without_an_effect_is_not_written():
    result = experiment.run("double_lane_change", law="passive", plant="roll1")
    assert "friction" not in result.options
    assert "preview_time" not in experiment.run("fishhook", law="passive").options
