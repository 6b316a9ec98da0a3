"""The one table of choices: what it refuses, and that what is asked for survives being written."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import canroll
from canroll.cli.main import parse
from canroll.cli.options import choices_of
from canroll.errors import CanrollError, UnknownNameError
from canroll.gain_gen.calibration.options import ACTUATOR_NUMBER
from canroll.runs.conditions import fault_texts
from canroll.setup import choices
from canroll.setup.choices import CHOICES, check
from canroll.setup.words import arguments, described

ASKED = {
    "vehicle": "van_2021",
    "plant_vehicle": "suv_2020",
    "law": "lqr",
    "actuator": "bars",
    "observer": "steering",
    "plant": "nonlinear",
    "bus": "gateway_20ms",
    "dbc": "own.dbc",
    "map": "own.toml",
    "stage": Path("own.py"),
    "key": "bus.key",
    "backend": "python",
    "seed": 7,
    "speed_kmh": 71.00000000000001,
    "tick_ms": 5.0,
    "phase_ms": 3.0,
    "trigger": "every",
    "heartbeat_ms": 40.0,
    "gains": "as_printed",
    "matrices": Path("k.toml"),
    "unverified": True,
    "moment_share": 0.5,
    "feedforward": False,
    "identification": True,
    "offset_learning": True,
    "response_watch": False,
    "uncertainty": {"mass": "0.1"},
    "options": {"friction": "0.6"},
    "faults": ["Imu.RollRate=stuck@3:5", "front_left=weak:0.3@2"],
    "fault_file": Path("faults.toml"),
    "conditions": {"supply": "10"},
    "duration": 2.5,
}


def test_names_are_those_of_what_they_choose():
    assert set(ACTUATOR_NUMBER) == set(CHOICES["actuator"].values())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"speed": 80}, "unknown choice of a run 'speed': did you mean 'speed_kmh'?"),
        ({"tick": 5}, "unknown choice of a run 'tick': did you mean 'tick_ms'?"),
        ({"set": {}}, "unknown choice of a run 'set': did you mean 'options'?"),
        ({"speed_kmh": "80"}, "speed_kmh='80': must be a number"),
        ({"tick_ms": True}, "tick_ms=True: must be a number"),
        ({"seed": 1.5}, "seed=1.5: must be a whole number"),
        ({"identification": "on"}, "identification='on': must be True or False"),
        ({"law": 5}, "law=5: must be a name"),
        ({"calibration": 3}, "calibration=3: must be a text, or a path"),
        (
            {"vehicle": 3},
            "vehicle=3: must be a Vehicle, a dictionary of values by name, a path, or",
        ),
        ({"dbc": 3, "map": "m"}, "dbc=3: must be a path, a list of texts or paths, or a text"),
        ({"options": "friction=0.6"}, "options='friction=0.6': must be a dictionary"),
        ({"faults": {"Imu": "off"}}, "faults={'Imu': 'off'}: must be a text, or a list of texts"),
    ],
)
def test_a_wrong_keyword_says_what_is_meant(given, message):
    with pytest.raises(CanrollError) as caught:
        canroll.run("moose", **given)
    assert message in str(caught.value)


def test_numbers_of_numpy_are_numbers():
    check({"speed_kmh": np.float64(80), "tick_ms": 5, "seed": np.int64(3)})


def test_one_fault_needs_no_list():
    text = "Imu.RollRate=stuck@3:5"
    assert fault_texts({"faults": text}) == fault_texts({"faults": [text]}) == (text,)


def test_every_choice_has_its_own_option_and_help():
    words = [choice.word for choice in CHOICES.values()]
    assert len(set(words)) == len(words)
    assert all(choice.help for choice in CHOICES.values())


def test_what_is_written_on_a_command_line_is_what_was_asked_for():
    assert set(ASKED) == set(CHOICES) - {"calibration"}
    found = choices_of(parse(["run", "j_turn", *arguments(ASKED)]))
    assert found == ASKED


def test_a_repeated_option_is_written_and_read_again():
    several = {"dbc": ("car.dbc", "own.dbc")}
    assert arguments(several) == ["--dbc", "car.dbc", "--dbc", "own.dbc"]
    assert choices_of(parse(["run", "j_turn", *arguments(several)])) == several
    assert choices_of(parse(["run", "j_turn", "--dbc", "own.dbc"])) == {"dbc": "own.dbc"}
    assert described("dbc=car.dbc,map=own.toml,dbc=own.dbc") == several | {"map": "own.toml"}


def test_what_is_not_asked_for_is_not_written():
    assert arguments({"law": None, "feedforward": True, "identification": False}) == []
    assert choices_of(parse(["run", "j_turn"])) == {}


def test_key_and_value_read_as_options_do():
    text = "law=lqr,bus=125k_busy,tick=5,seed=3,identification=on,feedforward=off"
    assert described(text) == {
        "law": "lqr",
        "bus": "125k_busy",
        "tick_ms": 5.0,
        "seed": 3,
        "identification": True,
        "feedforward": False,
    }


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"law": "lqx"}, "unknown law 'lqx': did you mean 'lqr'"),
        ({"observer": "two"}, "unknown observer 'two'"),
        ({"bus": "500"}, "unknown bus '500': did you mean '500k'"),
        ({"plant": "roll"}, "unknown plant 'roll': did you mean 'roll1'"),
        ({"plant": "fullcar"}, "unknown plant 'fullcar': did you mean 'linear_car'"),
        ({"actuator": "bar"}, "unknown actuator 'bar': did you mean 'bars'"),
        ({"trigger": "evnt"}, "unknown trigger 'evnt': did you mean 'event'"),
        ({"backend": "pyton"}, "unknown backend 'pyton': did you mean 'python'"),
        ({"tick_ms": 21.0}, "tick 21 ms: must be 1 to 20 ms"),
        ({"seed": -1}, "seed -1: must be 0 to 2147483647"),
        ({"speed_kmh": 0.0}, "speed 0 km/h: must be above 0 km/h"),
        ({"sped": 3}, "unknown choice of a run 'sped'"),
        ({"calibration": "c.toml", "tick_ms": 5.0}, "fixes the tick: omit --tick"),
        ({"calibration": "c.toml", "feedforward": False}, "omit --no-feedforward"),
        ({"calibration": "c.toml", "law": "lqr"}, "fixes the law: omit --law"),
    ],
)
def test_what_cannot_be_is_refused(asked, message):
    with pytest.raises(CanrollError, match=message):
        check(asked)
    with pytest.raises(CanrollError, match=message):
        canroll.run("double_lane_change", **asked)


def test_a_calibration_drives_without_control_too():
    check({"calibration": "c.toml", "law": "passive", "bus": "500k"})


@pytest.mark.parametrize("text", ["law=lqx", "sped=3", "tick=fast", "identification=perhaps"])
def test_a_key_or_value_that_cannot_be_is_refused(text):
    with pytest.raises(CanrollError):
        described(text)


def test_a_law_that_is_added_can_be_chosen(monkeypatch):
    with pytest.raises(UnknownNameError):
        check({"law": "mine"})
    monkeypatch.setitem(choices.LAWS, "mine", lambda task: None)
    check({"law": "mine"})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "nosuch"], "unknown scenario 'nosuch'"),
        (["run", "moose", "--law", "nosuch"], "unknown law 'nosuch'"),
        (["run", "moose", "--plant", "nosuch"], "unknown plant 'nosuch'"),
        (["compare", "lqr", "--bus", "nosuch"], "unknown bus 'nosuch'"),
        (["timing", "--vehicle", "van_2021", "--bus", "nosuch"], "unknown bus 'nosuch'"),
        (["design", "--trigger", "always"], "unknown trigger 'always'"),
    ],
)
def test_a_wrong_word_costs_no_heavy_import(arguments, message):
    program = (
        "import sys; from canroll.cli.main import main; code = main(sys.argv[1:]);"
        "print(code, sorted({'numba', 'scipy', 'cvxpy', 'matplotlib', 'can'} & set(sys.modules)))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True,
        text=True,
        timeout=1800,
        check=True,
    )
    assert message in ran.stderr
    assert ran.stdout == "2 []\n"
