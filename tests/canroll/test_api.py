import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import canroll
from canroll.errors import EXTRAS
from canroll.firmware.calibration import Q_MOMENT


def test_every_public_name_is_there():
    for name in dir(canroll):
        assert getattr(canroll, name).__doc__


def test_completion_shows_the_public_names_and_those_of_the_extensions():
    assert set(dir(canroll)) == {*canroll.__all__, "campaign", "fit", "validate"}


def test_importing_loads_nothing_heavy():
    program = (
        "import sys, canroll;print(sorted({'numpy', 'numba', 'scipy', 'cvxpy'} & set(sys.modules)))"
    )
    process = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=1800, check=True
    )
    assert process.stdout.strip() == "[]"


def test_extras_are_those_of_the_project():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    extras = tomllib.loads(text)["project"]["optional-dependencies"]
    # an extra that needs another one names that too
    named = {
        extra: {re.split("[><=]", p)[0] for p in listed if not p.startswith("canroll[")}
        for extra, listed in extras.items()
    }
    assert {extra: set(packages) for extra, packages in EXTRAS.items()} == {
        extra: packages for extra, packages in named.items() if extra not in ("dev", "judges")
    }


@pytest.mark.parametrize("as_file", [False, True])
def test_a_design_is_for_a_vehicle_a_file_or_a_name(as_file, tmp_path):
    van = canroll.load_vehicle("van_real")
    heavier = replace(van, design=replace(van.design, sprung_mass=2400.0))
    given = heavier
    if as_file:
        given = tmp_path / "heavier.toml"
        given.write_text(tomli_w.dumps(heavier.document))
    delay = canroll.Delay.constant(0.02)
    answer = canroll.design("lqr", vehicle=given, delay=delay)
    assert answer.task.vehicle.design == heavier.design
    assert answer.margins == canroll.design("lqr", canroll.Task(heavier, delay)).margins


def test_a_design_needs_a_task_or_vehicle_and_delay():
    delay = canroll.Delay.constant(0.02)
    task = canroll.Task(canroll.load_vehicle("van_real"), delay)
    for given in ({}, {"vehicle": "van_real"}, {"delay": delay}, {"task": task, "delay": delay}):
        with pytest.raises(canroll.CanrollError, match="needs a task, or else vehicle and delay"):
            canroll.design("lqr", **given)


def test_a_drive_is_stepped_and_moves_as_the_run():
    choices = {"law": "lqr", "plant": "roll1", "seed": 3}
    controlled = canroll.run("double_lane_change", **choices).controlled
    drive = canroll.drive("double_lane_change", **choices)
    assert drive.signals == {}
    roll, modes = [], []
    while drive.step():
        roll.append(drive.signals["roll"])
        modes.append(drive.mode)
    assert roll == [*controlled.signals["roll"][9::10]][: len(roll)]
    assert len(roll) == len(controlled.ticks)
    assert modes[0] == "INIT"
    assert modes[-1] == "ACTIVE"
    assert not drive.step()
    # the records of the ECU's state are the run's, too
    assert drive.ecu.moment == controlled.ticks["moment"][-1] * 2**Q_MOMENT


def test_matrices_may_be_given_as_they_are():
    class System:
        """As python-control has them."""

        def __init__(self, dt):
            self.A, self.B = np.array([[0.5]]), np.array([[0.0, 1.0, 0.0, 0.0]])
            self.C, self.D, self.dt = np.array([[-2e4]]), np.zeros((1, 4)), dt

    def roll(matrices, **more):
        choices = {"law": "custom", "plant": "roll1", "unverified": True, "duration": 2.0} | more
        return canroll.run("double_lane_change", matrices=matrices, **choices).controlled_metrics

    named = {name: getattr(System(None), name).tolist() for name in "ABCD"}
    assert roll(named) == roll(System(0.01)) == roll(System(None))
    assert roll({"K": [[1e5, 1e4]]}) != roll(named)
    for dt, what in ((0, "continuous"), (0.02, "sampled every 20 ms")):
        with pytest.raises(canroll.CanrollError, match=f"the system is {what}, the loop's tick"):
            roll(System(dt))
    with pytest.raises(canroll.CanrollError, match="matrices: unknown matrix 'Q'"):
        roll({"Q": [[1.0]]})


def test_a_script_without_a_main_guard_is_not_run_again_by_its_processes(tmp_path):
    script = tmp_path / "study.py"
    script.write_text(
        "import canroll\n"
        "print('begins')\n"
        "draws = canroll.campaign(runs=2, spread={'sprung_mass': 0.3}, plant='roll1', law='lqr',"
        " duration=0.5, jobs=2)\n"
        "print(len(draws.table))\n"
    )
    process = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=1800, check=True
    )
    assert process.stdout == "begins\n2\n"


def test_handling_and_buses_have_figures_and_a_table():
    circle = canroll.understeer("van_real", plant="linear_car", radius=60.0)
    assert repr(circle).startswith("<circle of 60 m: understeer gradient ")
    assert circle.table.column("roll_deg") == sorted(circle.table.column("roll_deg"))
    sines = canroll.response("van_real", plant="linear_car", speed_kmh=80.0)
    assert sines.table.columns[:3] == ("frequency_hz", "yaw_rate", "yaw_rate_phase_deg")
    network = canroll.bus("500k", simulate_s=0.1)
    assert network.good
    assert repr(network).startswith("<every message is in time: 50 messages")
    (segment,) = network.to_json()["segments"].values()
    assert network.table.column("bound_ms") == [
        message["response_bound_ms"] for message in segment["messages"]
    ]
    with pytest.raises(canroll.CanrollError, match="speed 10 km/h: must be 20 to 200 km/h"):
        canroll.response("van_real", speed_kmh=10.0)


def test_a_measured_drive_is_judged_and_fitted():
    log = Path(__file__).parents[2] / "examples/bmw_m8/double_lane_change.csv"
    car = "bmw_m8"
    verdict = canroll.validate(log, car, end=8.0)
    assert repr(verdict) == f"<{verdict.verdict}>"
    assert verdict.passed == (not any(verdict.table.column("failed")))
    assert verdict.table.column("signal")[0] == "yaw_rate"
    signals = {"roll_rate": "no_such_column:rad/s"}
    for call in (canroll.validate, canroll.fit):
        with pytest.raises(canroll.CanrollError, match="no_such_column"):
            call(log, car, signals=signals)
        with pytest.raises(canroll.CanrollError, match="from 5 to 2 s: nothing is between them"):
            call(log, car, begin=5.0, end=2.0)


def test_a_limit_is_bisected_and_says_what_limited():
    found = canroll.limit(
        "fishhook", law="passive", low_kmh=40.0, high_kmh=60.0, tolerance_kmh=20.0
    )
    assert [row["run"] for row in found.table] == ["passive"]
    assert "km/h" in repr(found)
    with pytest.raises(canroll.CanrollError, match="slalom has no pass criterion"):
        canroll.limit("slalom")
