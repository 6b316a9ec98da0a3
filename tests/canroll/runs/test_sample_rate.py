"""An inertial unit whose clock runs slow or fast, in whole runs."""

import re
from pathlib import Path

import numpy as np
import pytest

import dbc
import vehicles
from canroll.runs import experiment
from canroll.setup.controller import options_of, task_of
from firmware.plausibility import FAULT_SAMPLE_RATE_OFF
from firmware.state import ACTIVE, INIT
from gain_gen.models.task import Delay

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("faults", "latest"),
    [
        ([], None),
        (["bus=loss:0.1"], None),
        (["bus=error_rate:0.001@1"], None),
        (["node.Imu=clock_drift:0.01@1"], None),
        (["node.Imu=clock_drift:0.03@1"], 4.1),
        (["node.Imu=clock_drift:-0.03@1"], 4.1),
        (["node.Imu=clock_drift:0.3@1"], 1.25),
        (["node.Imu=clock_drift:-0.3@1"], 1.25),
    ],
)
def test_a_clock_that_drifts_is_found_and_nothing_else_is(faults, latest):
    settings, controller = experiment.plan(
        "double_lane_change", actuator="bars", faults=faults, backend="native", duration=4.5
    )
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    found = ticks["t"][ticks["fault_codes"] >> FAULT_SAMPLE_RATE_OFF & 1 == 1]
    assert (len(found) > 0) == (latest is not None)
    if latest is not None:
        assert 1.0 < found[0] < latest
        assert set(np.unique(ticks["mode"])) <= {INIT, ACTIVE}


@pytest.mark.parametrize("tick_ms", [5, 20])
@pytest.mark.parametrize("bus", ["125k_busy", "gateway_50ms"])
def test_other_ticks_and_slow_buses_are_no_other_rate(tick_ms, bus):
    settings, controller = experiment.plan(
        "double_lane_change", actuator="bars", tick_ms=tick_ms, bus=bus, duration=4.5
    )
    ticks = experiment.drive(settings, controller, enabled=True).ticks
    assert not (ticks["fault_codes"] >> FAULT_SAMPLE_RATE_OFF & 1).any()


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
