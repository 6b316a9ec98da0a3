"""``canroll design`` and ``margins`` of a vehicle with the spread of a fit."""

import json

import pytest
import tomli_w

from canroll import vehicles
from canroll.cli.main import main

pytestmark = pytest.mark.slow


@pytest.fixture
def file(tmp_path):
    fit = {
        "log": "a.csv",
        "names": ["plant.roll_stiffness", "tyre.cornering_stiffness_front"],
        "deviations": [15000.0, 9000.0],
        "correlation": [[1.0], [0.3, 1.0]],
    }
    path = tmp_path / "fitted.toml"
    path.write_text(tomli_w.dumps(vehicles.load("van_real").document | {"fit": fit}))
    return path


@pytest.mark.long
def test_a_design_says_the_worst_of_the_draws_and_margins_says_the_same(file, tmp_path, capsys):
    options = ["--law", "plain_feedforward", "--vehicle", str(file), "--bus", "gateway_20ms"]
    assert main(["design", *options, "--out", str(tmp_path)]) == 0
    printed = [line for line in capsys.readouterr().out.splitlines() if "fit" in line]
    assert any(line.startswith("worst of 20 draws of the fit: gain margin ") for line in printed)
    assert main(["margins", str(tmp_path / "calibration.toml")]) == 0
    again = capsys.readouterr().out
    assert "worst over all delays and draws" in again
    assert "\nworst of 20 draws of the fit: gain margin " in again
    assert main(["margins", str(tmp_path / "calibration.toml"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    rows = [row for row in answer["family"] if row["draw"]]
    assert {row["draw"] for row in rows} == set(range(1, 21))
    assert min(row["gain_db"] for row in rows) == answer["fit"]["draws_gain_db"]
    assert answer["fit"]["draws_gain_db"] < answer["fit"]["fitted_gain_db"]
