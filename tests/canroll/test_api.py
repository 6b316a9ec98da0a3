import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w

import canroll
from canroll.errors import EXTRAS


def test_every_public_name_is_there():
    for name in canroll.__all__:
        assert getattr(canroll, name).__doc__


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
