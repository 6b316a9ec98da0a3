"""The commands that measure the vehicle: limit, understeer, response."""

import json

import pytest

from hil.cli.main import main


def answer(capsys, *arguments):
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_understeer_prints_the_gradients(capsys):
    result = answer(capsys, "understeer", "--vehicle", "suv_2020", "--plant", "roll1")
    assert result["gradient"] == pytest.approx(result["closed_form"], rel=0.01)
    assert main(["understeer", "--plant", "roll1"]) == 0
    assert "understeer gradient" in capsys.readouterr().out


def test_response_prints_gains_and_phases(capsys):
    result = answer(capsys, "response", "--plant", "roll1", "--speed", "80")
    assert len(result["frequency_hz"]) == len(result["yaw_rate"]["gain"])
    assert result["roll"]["phase_deg"][-1] < result["roll"]["phase_deg"][0] < 0
    assert main(["response", "--plant", "roll1"]) == 0
    assert "per steering-wheel angle" in capsys.readouterr().out


@pytest.mark.slow
def test_limit_of_the_fishhook_rises_with_control(capsys):
    options = ["limit", "fishhook", "--from", "80", "--to", "95", "--tolerance", "2"]
    result = answer(capsys, *options)
    assert 80 <= result["passive"]["passed_kmh"] < result["passive"]["failed_kmh"] <= 95
    assert result["controlled"]["passed_kmh"] > result["passive"]["passed_kmh"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["limit", "fishhok"], "did you mean 'fishhook'"),
        (["limit", "fishhook", "--from", "90", "--to", "50"], "--from must lie below --to"),
        (["limit", "fishhook", "--speed", "60"], "does not take --speed 60"),
        (["limit", "fishhook", "--tolerance", "0"], "tolerance"),
        (["understeer", "--vehicle", "vna_real"], "did you mean 'van_real'"),
        (["understeer", "--radius", "3"], "--radius must be at least 20 m"),
        (["response", "--speed", "-5"], "20 to 200 km/h"),
        (["response", "--plant", "nonliner"], "did you mean 'nonlinear'"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(capsys, arguments, message):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
