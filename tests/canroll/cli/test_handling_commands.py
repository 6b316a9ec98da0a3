"""The command that tests a vehicle: circle, response, limit."""

import json
from math import radians
from pathlib import Path

import pytest

from canroll.cli.main import main


def answer(capsys, *arguments):
    assert main(["handling", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_understeer_prints_the_gradients(capsys):
    result = answer(capsys, "circle", "--vehicle", "suv_2020", "--plant", "roll1")
    passive = result["passive"]
    assert passive["gradient"] == pytest.approx(passive["closed_form"], rel=0.01)
    assert "controlled" not in result
    assert main(["handling", "circle", "--plant", "roll1"]) == 0
    assert "understeer gradient" in capsys.readouterr().out


def test_response_prints_gains_and_phases(capsys):
    result = answer(capsys, "response", "--plant", "roll1", "--speed", "80")
    passive = result["passive"]
    assert len(result["frequency_hz"]) == len(passive["yaw_rate"]["gain"])
    assert passive["roll"]["phase_deg"][-1] < passive["roll"]["phase_deg"][0] < 0
    assert main(["handling", "response", "--plant", "roll1"]) == 0
    assert "per steering-wheel angle" in capsys.readouterr().out


CONTROLLED = ["--plant", "roll1", "--law", "plain_feedforward"]


@pytest.mark.slow
def test_understeer_shows_both_vehicles(capsys):
    alone = answer(capsys, "circle", "--plant", "roll1")
    both = answer(capsys, "circle", *CONTROLLED)
    assert both | alone == both
    assert both["controlled"]["roll_gradient"] < 0.9 * both["passive"]["roll_gradient"]
    # the wheelbase over twice the steering of a slow turn, from the gradient per g
    speed, wheelbase = both["passive"]["characteristic_speed"], 3.66
    assert radians(alone["passive"]["gradient"]) / 9.81 * speed**2 == pytest.approx(
        wheelbase, rel=0.01
    )
    assert both["law"] == "plain_feedforward" and both["command_limit"] > 0
    last = both["control"][-1]
    assert last["at_limit"] == 1.0
    assert sum(last["moment"]) == pytest.approx(both["command_limit"], rel=0.01)


@pytest.mark.slow
def test_the_controlled_understeer_names_where_control_ends(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "canroll.toml").write_text("moment-share = 1.0\n")
    assert main(["handling", "circle", "--plant", "roll1", "--law", "steering_lead"]) == 0
    text = capsys.readouterr().out
    for part in (
        "characteristic speed",
        "command at its limit of",
        "gradients of 5 turns, with control at such a limit in",
        "100 % of the time at most",
    ):
        assert part in text


def test_response_shows_both_vehicles_and_draws_them(capsys, tmp_path):
    alone = answer(capsys, "response", "--plant", "roll1")
    both = answer(capsys, "response", *CONTROLLED, "--out", str(tmp_path))
    assert both | alone == both
    assert both["controlled"]["roll"]["peak"] < both["passive"]["roll"]["peak"]
    assert both["passive"]["roll"]["peak"] == max(both["passive"]["roll"]["gain"])
    assert len(both["control"]) == len(both["frequency_hz"])
    assert (tmp_path / "response.png").read_bytes().startswith(b"\x89PNG")


LINEAR = ["response", "--linear", "--speed", "80"]


@pytest.mark.slow
def test_linear_response_prints_modes_responses_and_the_distance(capsys, tmp_path):
    assert main(["handling", *LINEAR, "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    for part in ("rear axle tramp", "moment, per kN·m", "distance to the design model"):
        assert part in text
    assert (tmp_path / "response.png").read_bytes().startswith(b"\x89PNG")
    found = answer(capsys, *LINEAR, "--lateral-acceleration", "4", "--load", "empty")
    assert found["load"] == "empty" and found["roll_deg"] > 0 and found["steer_deg"] > 0
    assert len(found["moment"]["roll_rate"]["gain"]) == len(found["frequency_hz"])
    assert found["design_distance"]["moment"]["roll_rate"] < 0.02
    assert all(mode["frequency_hz"] > 0 and mode["real"] < 0 for mode in found["modes"])


def test_linear_response_takes_a_body_of_a_package(capsys):
    package = Path(__file__).parents[3] / "examples" / "canroll-example" / "canroll_example"
    body = f"{package / 'body.py'}:HEAVY_ROOF"
    found = answer(capsys, *LINEAR, "--plant", body)
    assert "roll" in [mode["motion"] for mode in found["modes"]]


@pytest.mark.slow
def test_limit_of_the_fishhook_rises_with_control(capsys):
    options = ["limit", "fishhook", "--from", "80", "--to", "95", "--tolerance", "2"]
    result = answer(capsys, *options)
    assert 80 <= result["passive"]["passed_kmh"] < result["passive"]["failed_kmh"] <= 95
    assert result["controlled"]["passed_kmh"] > result["passive"]["passed_kmh"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("limit fishhok", "did you mean 'fishhook'"),
        ("limit fishhook --from 90 --to 50", "--from must lie below --to"),
        ("limit fishhook --speed 60", "--speed: it belongs to canroll handling response"),
        ("limit fishhook --tolerance 0", "tolerance"),
        ("limit", "limit needs a manoeuvre: canroll handling limit SCENARIO"),
        ("limit roundabout", "roundabout has no pass criterion"),
        ("circle moose", "moose: canroll handling circle drives its own manoeuvre"),
        ("circle --vehicle vna_real", "did you mean 'van_real'"),
        ("circle --radius 3", "--radius must be at least 20 m"),
        ("circle --out there", "--out: it belongs to canroll handling response"),
        ("circle --bus 500k", "--bus: it belongs to --law or --calibration"),
        ("circle --law passive", "--law passive has no control"),
        ("circle --law lqrr", "did you mean 'lqr'"),
        ("response --speed -5", "20 to 200 km/h"),
        ("response --plant nonliner", "did you mean 'nonlinear'"),
        ("response --friction 0.5", "--friction: it belongs to --linear"),
        ("response --law lqr --set friction=0.5", "--set: it belongs to canroll handling limit"),
        ("response --calibration there.toml", "there.toml"),
        ("response --load half", "choose from"),
        ("response --linear --law lqr", "--law: --linear drives nothing"),
        ("response --linear --speed 80 --friction 0.5", "--friction 0.5 has no effect"),
        ("response --linear --friction nan", "must be 0.05 to 1.5"),
        ("response --linear --lateral-acceleration -1", "must be 0 to 12 m/s²"),
        ("response --linear --speed 80 --lateral-acceleration 11", "no steady curve of 11 m/s²"),
        ("response --linear --out /proc/there", "cannot write /proc/there/response.png"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(capsys, line, message):
    assert main(["handling", *line.split()]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
