"""Where the rate of an inertial unit's samples is judged, and at which rate they are due."""

import re
from pathlib import Path

import pytest

from canroll import dbc, vehicles
from canroll.gain_gen.models.task import Delay
from canroll.setup.controller import options_of, task_of

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]


def sample_period(**choices):
    return options_of(choices, vehicles.load("van_real")).sample_period


def test_it_is_judged_where_samples_are_counted(tmp_path):
    assert sample_period() == 0.01
    assert sample_period(observer="reference") == 0.0
    no_counter = {"dbc": str(ROOT / "examples/own_bus/own.dbc")}
    no_counter["map"] = str(ROOT / "examples/own_bus/own.toml")
    assert sample_period(**no_counter) == 0.0
    fd = {"dbc": str(dbc.FD_PATH), "map": str(dbc.FD_MAP)}
    assert sample_period(**fd) == 0.01
    shorter = dbc.FD_PATH.read_text(encoding="utf-8")
    counter = re.search(r"SG_ SampleCounter : \d+\|4@1\+ \(1,0\) \[0\|15\]", shorter)
    assert counter is not None
    path = tmp_path / "shorter.dbc"
    path.write_text(
        shorter.replace(counter[0], counter[0].replace("|4@", "|3@").replace("|15]", "|7]")),
        encoding="utf-8",
    )
    assert sample_period(**fd | {"dbc": str(path)}) == 0.0


def test_a_design_knows_the_cycle_times_of_its_bus(tmp_path):
    usual = task_of({}, Delay.constant(0.02)).periods
    assert usual == (0.01, 0.02, 0.01, 0.01, 0.01)
    slower = (ROOT / "examples/own_bus/own.dbc").read_text(encoding="utf-8")
    assert "BO_ 257 10;" in slower
    path = tmp_path / "slower.dbc"
    path.write_text(slower.replace("BO_ 257 10;", "BO_ 257 20;"), encoding="utf-8")
    own = {"dbc": str(path), "map": str(ROOT / "examples/own_bus/own.toml")}
    assert task_of(own, Delay.constant(0.02)).periods == (0.02, *usual[1:])
