"""``canroll validate``: what it answers, writes and refuses."""

import json

import numpy as np
import pytest

from canroll import vehicles
from canroll.cli.main import main
from tests.support.measured_drives import driven, dwell, free, ramp, time_of

VAN = ["--vehicle", "van_real"]
SOFTER = ["--vehicle-set", "tyre.cornering_stiffness_front=120000"]
NAMES = {"steering": "steering_wheel_rad", "speed": "speed_m_s", "lateral_acceleration": "ay_m_s2"}


def written(path, steering):
    columns = {"time": time_of(0.01 * len(steering))}
    columns |= driven(vehicles.load("van_real"), steering, 22.0)
    head = ",".join(NAMES.get(name, name) for name in columns)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=head, comments="")
    return str(path)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    steerings = {"drive": free(), "dwell": dwell(1.5), "circle": ramp(1.8)}
    return {name: written(folder / f"{name}.csv", s) for name, s in steerings.items()}


def test_the_answer_comes_first_and_the_page_has_the_bands(logs, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["validate", logs["dwell"], *VAN, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("van_real moves as measured: 6.0 s of dwell.csv, sine with dwell\n")
    assert len(printed.splitlines()) <= 25
    result = json.loads((out / "validation.json").read_text())
    assert result["passed"] is True
    assert result["logs"][0]["manoeuvre"] == "sine_with_dwell"
    page = (out / "report.html").read_text()
    for text in ("Validated", "inner corridor of ISO/TS 18571", "lateral displacement"):
        assert text in page


def test_a_car_that_fails_has_exit_code_1_and_says_why(logs, capsys):
    assert main(["validate", logs["circle"], *VAN, *SOFTER, "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["passed"] is False
    assert result["files"] == {}
    (log,) = result["logs"]
    failed = [band["name"] for band in log["bands"] if not band["passed"]]
    assert failed == ["steering"]
    assert "times the tolerance" in log["failures"][0]
    assert main(["validate", logs["drive"], *VAN, *SOFTER, "--out", ""]) == 2
    capsys.readouterr()


@pytest.mark.slow
def test_several_logs_are_a_table_in_which_those_that_fail_come_first(logs, tmp_path, capsys):
    out = str(tmp_path)
    assert main(["validate", *logs.values(), *VAN, "--out", out]) == 0
    assert capsys.readouterr().out.startswith("van_real moves as measured in 3 logs\n")
    assert main(["validate", *logs.values(), *VAN, *SOFTER, "--out", out]) == 1
    printed = capsys.readouterr().out
    assert "does not move as measured in 3 of 3 logs" in printed.splitlines()[0]
    assert len(printed.splitlines()) <= 25


def test_tolerances_and_limits_can_be_set(logs, tmp_path, capsys):
    wide = [f"--tolerance=circle.{name}=60:1" for name in ("steering", "roll", "sideslip")]
    words = ["validate", logs["circle"], *VAN, *SOFTER, "--out", str(tmp_path)]
    assert main([*words, *wide]) == 0
    assert "2 more" not in capsys.readouterr().out
    words = ["validate", logs["drive"], *VAN, "--json"]
    assert main([*words, "--explained", "yaw_rate=1", "--rating", "1"]) == 1
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "--vehicle is missing"),
        ([*VAN, "--zero", "1"], "--zero 1: expected FROM:TO in s"),
        ([*VAN, "--zero", "100:101"], "--zero: no steering-wheel angle from 100 to 101 s"),
        ([*VAN, "--zero", "0:1", "--measurement", "x"], "--measurement has the offsets"),
        ([*VAN, "--measurement", "missing.json"], "cannot read missing.json"),
        ([*VAN, "--manoeuvre", "slalom"], "unknown manoeuvre of a log 'slalom'"),
        ([*VAN, "--manoeuvre", "step_steer"], "its steering is no step"),
        ([*VAN, "--explained", "yaw=1"], "unknown signal of a log 'yaw': choose from"),
        ([*VAN, "--explained", "yaw_rate=x"], "--explained yaw_rate=x: expected a number"),
        ([*VAN, "--explained", "yaw_rate=2"], "must be at most 1"),
        ([*VAN, "--tolerance", "pek=1"], "unknown tolerance 'pek': did you mean 'peak'?"),
        ([*VAN, "--tolerance", "peak"], "peak: expected key=value"),
        ([*VAN, "--rating", "2"], "--rating 2: must be 0 to 1"),
        ([*VAN, "--error", "0"], "--error 0: must be above 0"),
        ([*VAN, "--from", "5", "--to", "4"], "nothing is between them"),
        ([*VAN, "--map", "x.toml"], "--map: it belongs to --dbc"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(logs, capsys, words, message):
    assert main(["validate", logs["drive"], *words, "--json"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
