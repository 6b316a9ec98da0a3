"""``canroll vehicle``: files from mass and size, and vehicles beside their class."""

import json

import pytest

from canroll import vehicles
from canroll.cli.main import main

SIZES = [
    "--class",
    "van",
    "--mass",
    "2720",
    "--wheelbase",
    "3.66",
    "--track",
    "1.735",
    "--height",
    "2.5",
]


def test_a_new_vehicle_is_a_complete_file(tmp_path, capsys):
    file = tmp_path / "mine.toml"
    assert main(["vehicle", "new", str(file), *SIZES, "--set", "front_share=0.5"]) == 0
    out = capsys.readouterr().out
    assert f"written to {file} from 4 sizes and 1 ratio: 22 numbers estimated" in out
    assert "4 given by these, 34 of van_real" in out
    vehicle = vehicles.load(file)
    assert vehicle.total_mass == pytest.approx(2720, rel=1e-3)
    assert vehicle.geometry.static_front_share == pytest.approx(0.5)
    assert vehicle.design == vehicle.plant


def test_check_names_what_is_unusual(capsys):
    assert main(["vehicle", "check", "van_real", "--class", "van", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    unusual = {
        row["label"] for row in answer["ratios"] if not row["low"] <= row["value"] <= row["high"]
    }
    assert main(["vehicle", "check", "van_real", "--class", "van"]) == 0
    out = capsys.readouterr().out
    assert f"for a van: unusual: {', '.join(sorted(unusual, key=out.index))}" in out
    assert out.count("unusual\n") == len(unusual)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["new", "mine.txt", *SIZES], "mine.txt: the name of a vehicle file ends in .toml"),
        (["new", "mine.toml", *SIZES[2:]], "--class is missing: car, suv, van"),
        (["new", "mine.toml", *SIZES[:-2]], "--height is missing"),
        (["new", "mine.toml", *SIZES, "--set", "bars=many"], "--set bars=many: must be a number"),
        (["new", "no/folder/mine.toml", *SIZES], "cannot write no/folder/mine.toml"),
        (["check", "van_real", "--mass", "2000"], "--mass: it belongs to canroll vehicle new"),
        (["check", "van_real", "--class", "lorry"], "unknown class of vehicles 'lorry'"),
        (["check", "van_real", "--drive", "rear"], "--drive: it belongs to a class: add --class"),
        (["new", "mine.toml", *SIZES, "--drive", "rear"], "unknown drive of a van 'rear'"),
    ],
)
def test_what_makes_no_file_is_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["vehicle", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("action", "own", "others"),
    [
        ("new", ["--mass", "--drive", "cg_height         0.376 ±6 %"], ["--radius"]),
        ("check", ["--class", "--drive"], ["--mass", "--radius", "cg_height "]),
        ("tyre", ["--axes", "--radius"], ["--mass", "--class", "cg_height "]),
    ],
)
def test_each_action_has_its_own_help(action, own, others, capsys):
    with pytest.raises(SystemExit):
        main(["vehicle", action, "--help"])
    output = capsys.readouterr().out
    assert all(text in output for text in own)
    assert not any(text in output for text in others)


def test_ratios_of_lighter_vehicles_are_warned_of(tmp_path, capsys):
    sizes = [*SIZES[:3], "12000", *SIZES[4:-1], "3.4"]
    assert main(["vehicle", "new", str(tmp_path / "lorry.toml"), *sizes]) == 0
    assert "warning: the ratios are of vehicles up to 5 t" in capsys.readouterr().out


def test_a_file_is_not_overwritten(tmp_path, capsys):
    file = tmp_path / "mine.toml"
    file.write_text("mine")
    assert main(["vehicle", "new", str(file), *SIZES]) == 2
    assert "is there already" in capsys.readouterr().err
    assert file.read_text() == "mine"
