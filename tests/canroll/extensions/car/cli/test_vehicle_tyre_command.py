"""``canroll vehicle tyre``: the file and its picture, JSON, and one line for what goes wrong."""

import json

import pytest

from canroll.cli.main import main
from canroll.extensions.car.cli import options
from canroll.extensions.car.tyres.measured import AXES
from canroll.vehicles.tyres import tir
from canroll.vehicles.tyres.magic_formula import Coefficients

LINES = ["slip_angle_deg,load_kn,lateral_force_n"]
for _load in (2.0, 4.0, 6.0):
    for _slip in range(-12, 13):
        # a tyre that is no magic formula: saturation by an algebraic function
        _share = 0.25 * _slip / (1.0 + abs(0.25 * _slip) ** 2.5) ** 0.4
        LINES.append(f"{_slip},{_load},{-1000.0 * _load * (1.1 - 0.05 * _load) * _share:.6g}")


@pytest.fixture
def table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.csv").write_text("\n".join(LINES) + "\n")


def test_a_file_and_a_picture_are_written_and_the_answer_is_in_lines(table, tmp_path, capsys):
    assert main(["vehicle", "tyre", "t.csv", "--out", "own.tir"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("22 lateral coefficients fitted to 75 points of t.csv:")
    assert "RMS difference" in out and "not identifiable from the table, as before: PDY3" in out
    assert "guessed, not of the table: PCX1" in out and "written to .: own.tir, own.png" in out
    tyre = tir.read(tmp_path / "own.tir")
    assert isinstance(tyre, Coefficients) and tyre["FZMAX"] == 6000.0
    assert (tmp_path / "own.png").read_bytes().startswith(b"\x89PNG")
    first = (tmp_path / "own.tir").read_bytes(), (tmp_path / "own.png").read_bytes()
    assert main(["vehicle", "tyre", "t.csv", "--out", "own.tir"]) == 0
    assert ((tmp_path / "own.tir").read_bytes(), (tmp_path / "own.png").read_bytes()) == first


def test_json_has_every_coefficient_with_its_deviation(table, capsys):
    assert main(["vehicle", "tyre", "t.csv", "--out", "own.tir", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    states = {row["key"]: row["state"] for row in answer["coefficients"]}
    assert states["PDY1"] == "identified" and states["PKY6"] == "kept"
    assert len(answer["covariance"]) == len(states) == 22
    # what a magic formula can be of such a curve
    assert answer["points"] == 75 and answer["rms"] < 0.01 * 4800.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["t.csv"], "--out is missing: the tyre file to write"),
        (["t.csv", "--out", "own.toml"], "--out own.toml: the name of a tyre file ends in .tir"),
        (["t.csv", "--out", "no/own.tir"], "cannot write no/own.tir: no such folder no"),
        (["t.csv", "--out", "own.tir", "--from", "own.tir"], "it is the file of --from"),
        (["t.csv", "--out", "own.tir", "--from", "no.tir"], "cannot read tyre file no.tir"),
        (["t.csv", "--out", "own.tir", "--axes", "adapted-sae"], "give --axes iso"),
        (["t.csv", "--out", "own.tir", "--radius", "31"], "--radius 31: must be that of a tyre"),
        (["t.csv", "--out", "own.tir", "--class", "van"], "--class: it belongs to canroll"),
        (["no.csv", "--out", "own.tir"], "cannot read no.csv"),
    ],
)
def test_what_makes_no_tyre_is_one_line(table, arguments, message, tmp_path, capsys):
    assert main(["vehicle", "tyre", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"]


def test_options_of_a_tyre_belong_to_it(capsys):
    assert tuple(AXES) == options.AXES
    assert main(["vehicle", "check", "van_real", "--axes", "sae"]) == 2
    assert "--axes: it belongs to canroll vehicle tyre" in capsys.readouterr().err
