"""``canroll design``: which constant faults can be found with the signals that it receives."""

import json
from pathlib import Path

import pytest

from canroll.cli import design_view
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.gain_gen.monitors.detectability import ConstantFault, Detectable, Limit
from canroll.gain_gen.monitors.uncertainty import Uncertainty, stated


def test_sizes_have_their_units_and_what_is_never_found_says_so():
    seen = Detectable(
        ConstantFault("moment", "N·m", {}),
        (Limit("body", 1, 120.4, 1756.3),),
        float("inf"),
        ("rate",),
    )
    unseen = Detectable(ConstantFault("rate", "m/s", {}), (), float("inf"), ())
    table = design_view.detectability([seen, unseen], Uncertainty())
    assert table.rows == [
        ("moment", "120 N·m", "1756 N·m", "never", "body", "rate"),
        ("rate", "never", "never", "never", "", ""),
    ]


def designed(tmp_path, capsys, *more):
    arguments = ["design", "--law", "lqr", "--actuator", "bars", "--out", str(tmp_path)]
    assert main([*arguments, *more]) == 0
    return capsys.readouterr().out


def test_the_table_is_of_the_signals_that_are_received(tmp_path, capsys):
    every = json.loads(designed(tmp_path, capsys, "--json"))["detectability"]
    names = [row["fault"] for row in every]
    assert "moment of the front axle" in names and "roll rate" in names
    assert all(row["straight"] <= row["slalom"] for row in every)
    few = json.loads(designed(tmp_path, capsys, "--json", "--no-watch-response"))["detectability"]
    assert [row["fault"] for row in few] == ["lateral acceleration"]


def test_it_is_printed_with_the_other_numbers(tmp_path, capsys):
    text = designed(tmp_path, capsys, "--verbose")
    assert design_view.allowed_for(Uncertainty()) in text
    assert "moment of the front axle" in text


@pytest.mark.slow
def test_margins_finds_the_same_from_the_file_and_more_of_a_car_known_better(tmp_path, capsys):
    designed_for = json.loads(designed(tmp_path, capsys, "--json"))["detectability"]
    file = str(tmp_path / "calibration.toml")
    assert main(["margins", file, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)["detectability"]
    assert again == designed_for
    known = ("--uncertainty", "mass=0.05", "--uncertainty", "height=0.02")
    assert main(["margins", file, "--json", *known]) == 0
    better = json.loads(capsys.readouterr().out)["detectability"]
    assert all(row["slalom"] <= old["slalom"] for row, old in zip(better, again, strict=True))
    assert better[2]["slalom"] < 0.7 * again[2]["slalom"]
    assert main(["margins", file, *known]) == 0
    assert design_view.allowed_for(Uncertainty(mass=0.05, height=0.02)) in capsys.readouterr().out


def test_a_width_of_a_file_is_refused_by_the_file_and_its_key():
    file = Path("calibration.toml")
    with pytest.raises(CanrollError, match=r"^calibration\.toml: uncertainty\.mass=1: must be"):
        stated({"mass": 1}, file=file)
    with pytest.raises(CanrollError, match=r"^unknown key of calibration\.toml"):
        stated({"x": 1}, file=file)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("mas=1", "unknown uncertainty 'mas': did you mean 'mass'?"),
        ("mass=much", "--uncertainty mass=much: 'much' is not a number"),
        ("mass=1", "--uncertainty mass=1: must be below 1, a share of the nominal value"),
        ("bank=-1", "--uncertainty bank=-1: must be 0 or more"),
        ("bank=nan", "--uncertainty bank=nan: must be 0 or more"),
        ("alarms_per_hour=0", "--uncertainty alarms_per_hour=0: noise always raises some"),
    ],
)
def test_a_width_that_is_none_is_refused(given, reason):
    with pytest.raises(CanrollError) as refused:
        stated(dict([given.split("=")]))
    assert str(refused.value).startswith(reason)
