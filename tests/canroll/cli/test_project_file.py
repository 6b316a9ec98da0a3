import subprocess
import sys

import pytest

from canroll.cli.main import main, parse
from canroll.errors import CanrollError
from canroll.studies import equal_effort, severe


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(folder, text):
    (folder / "canroll.toml").write_text(text)


def test_a_command_takes_the_options_of_the_file(folder, capsys):
    written(
        folder, 'vehicle = "suv_2020"\nbus = "gateway_20ms"\nset = {friction = 0.7}\nseed = 3\n'
    )
    args = parse(["run", "moose", "--bus", "500k"])
    assert (args.vehicle, args.bus, args.seed) == ("suv_2020", "500k", 3)
    assert dict(args.options) == {"friction": "0.7"}
    assert "canroll.toml: --vehicle suv_2020" in capsys.readouterr().err
    assert args.arguments[0] == "run"
    assert "--vehicle" in args.arguments


def test_a_command_takes_what_it_knows(folder, capsys):
    written(folder, 'vehicle = "suv_2020"\nlaw = "lqr"\n')
    assert parse(["handling", "circle"]).vehicle == "suv_2020"
    assert "--law" not in capsys.readouterr().err
    assert parse(["list", "laws"]).kind == "laws"


def test_a_handling_test_takes_control_from_the_file_where_it_is_asked_for(folder, capsys):
    written(folder, 'vehicle = "suv_2020"\nlaw = "lqr"\nbus = "gateway_20ms"\n')
    assert parse(["handling", "response", "--linear"]).law is None
    args = parse(["handling", "response", "--law", "hinf_delay"])
    assert (args.law, args.bus) == ("hinf_delay", "gateway_20ms")
    assert parse(["handling", "limit", "moose"]).law == "lqr"


def test_what_does_not_apply_to_a_saved_run_is_no_fault_of_the_file(folder, capsys):
    written(folder, 'vehicle = "suv_2020"\n')
    assert main(["run", "."]) == 2
    assert "not a saved run" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["hil moose", "compare lqr", "export-c out", "faults"])
def test_what_a_command_takes_from_the_file_alone_is_not_in_its_help(folder, command, capsys):
    written(folder, "identification = true\nuncertainty = {mass = 0.05}\n")
    args = parse(command.split())
    assert args.identification and args.uncertainty == [("mass", "0.05")]
    assert "canroll.toml: --identification" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*command.split(), "--help-all"])
    assert "--identification" not in capsys.readouterr().out


@pytest.mark.parametrize("of", [["--scenario", "severe"], ["--runs", "2"]])
def test_a_population_passes_over_what_the_file_says_of_single_runs(folder, monkeypatch, of):
    written(folder, 'vehicle = "suv_2020"\nlaw = "lqr"\nseed = 3\nspeed = 70.0\n')
    driven = []

    def drive(*_, **choices):
        driven.append(choices)
        raise CanrollError("driven")

    monkeypatch.setattr(severe, "study", drive)
    monkeypatch.setattr(equal_effort, "compare", drive)
    monkeypatch.setattr(equal_effort, "half_upright", lambda *_, **__: 400.0)
    assert main(["compare", *of]) == 2
    assert driven[0]["vehicle"] == "suv_2020" and "seed" not in str(driven)


def test_what_belongs_to_another_option_is_not_taken(folder):
    written(folder, 'plant = "roll1"\nset = {friction = 0.7}\n')
    assert parse(["compare", "lqr"]).options == [("friction", "0.7")]
    assert parse(["handling", "circle"]).options is None
    assert parse(["handling", "limit", "moose"]).options == [("friction", "0.7")]


def test_a_calibration_fixes_what_the_file_says(folder):
    written(folder, 'vehicle = "suv_2020"\nbus = "gateway_20ms"\n')
    args = parse(["run", "moose", "--calibration", "c.toml"])
    assert (args.vehicle, args.bus) == (None, "gateway_20ms")


def test_flags_and_repeated_options(folder):
    written(folder, 'feedforward = false\ndbc = ["a.dbc", "b.dbc"]\nmap = "m.toml"\n')
    args = parse(["run", "moose"])
    assert args.feedforward is False
    assert args.dbc == ("a.dbc", "b.dbc")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('vehicel = "x"\n', "did you mean 'vehicle'?"),
        ("vehicle = 3\n", "vehicle = 3: must be a text"),
        ("seed = 1.5\n", "seed=1.5: must be a whole number"),
        ('law = "lrq"\n', "did you mean 'lqr'?"),
        ("law =\n", "cannot read canroll.toml"),
    ],
)
def test_a_mistake_in_the_file_is_named(folder, capsys, text, message):
    written(folder, text)
    assert main(["run", "moose"]) == 2
    error = capsys.readouterr().err
    assert "canroll.toml" in error
    assert message in error
    assert error.count("\n") == 1


def test_another_file_or_none(folder, monkeypatch):
    written(folder, "seed = 3\n")
    (folder / "other.toml").write_text("seed = 4\n")
    for value, seed in (("other.toml", 4), ("", None)):
        monkeypatch.setenv("CANROLL_PROJECT_FILE", value)
        assert parse(["run", "moose"]).seed == seed


def test_a_run_with_the_file_is_the_run_with_the_options(folder):
    command = [sys.executable, "-m", "canroll.cli.main"]
    command += ["run", "moose", "--duration", "1", "--json"]
    options = ["--law", "lqr", "--bus", "gateway_20ms"]
    said = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    written(folder, 'law = "lqr"\nbus = "gateway_20ms"\n')
    read = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    assert read.stdout == said.stdout
