"""``--prepare`` compiles what a run needs, or loads it from the cache."""

import subprocess
import sys

import pytest

from canroll.cli.main import main

KERNELS = """
import gc, sys
from numba.core.dispatcher import Dispatcher
from canroll.cli.main import main

assert main(sys.argv[2:]) == 0
with open(sys.argv[1], "w") as file:
    for kernel in gc.get_objects():
        if isinstance(kernel, Dispatcher):
            function = kernel.py_func
            for types in kernel.signatures:
                print(function.__module__, function.__name__, types, file=file)
"""


def kernels_of(folder, *arguments):
    """The kernels that a command has compiled, or loaded from the cache, with their types."""
    names = folder / "names"
    ran = subprocess.run(
        [sys.executable, "-c", KERNELS, names, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr
    return set(names.read_text().splitlines()), ran.stdout


@pytest.mark.slow
def test_what_is_prepared_is_all_that_a_run_needs(tmp_path):
    prepare = ("hil", "double_lane_change", "--law", "lqr", "--prepare")
    prepared, said = kernels_of(tmp_path, *prepare)
    assert said == ""
    assert any("world_kernel advance" in name for name in prepared)
    own_bus = ("--serve", "127.0.0.1:0", "--wait", "0")
    plant, _ = kernels_of(tmp_path, "plant", "double_lane_change", *own_bus, "--duration", "0.5")
    assert plant
    assert plant <= prepared
    run, _ = kernels_of(tmp_path, "run", "double_lane_change", "--law", "lqr", "--json")
    assert run
    assert run <= prepared


def test_preparing_opens_no_bus(capsys):
    bus = ["-i", "socketcan", "-c", "none0"]
    assert main(["plant", "double_lane_change", *bus, "--prepare"]) == 0
    assert main(["hil", "double_lane_change", "--law", "lqr", *bus, "--prepare"]) == 0
    assert capsys.readouterr() == ("", "")


def test_what_cannot_be_is_refused_while_preparing(capsys):
    assert main(["hil", "double_lane_chang", "--prepare"]) == 2
    assert "did you mean 'double_lane_change'?" in capsys.readouterr().err
