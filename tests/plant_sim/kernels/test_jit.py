"""Machine code cached by several processes, one body each, must work together in one more."""

import os
import subprocess
import sys

import pytest

from canroll.plant_sim.kernels import jit

TOGETHER = """
import numpy as np, vehicles
from canroll.plant_sim import bodies
from canroll.plant_sim.bodies import ports
from canroll.plant_sim.driving import maneuvers
from canroll.plant_sim.world import open_loop
van = vehicles.load("van_real")
for body in bodies.BODIES.values():
    run = maneuvers.build("roundabout", van)
    outputs, _ = open_loop.run_passive(van, body, run)
    print(f"{np.abs(outputs[:, ports.ROLL]).max():.9f}")
"""


@pytest.mark.long
def test_bodies_compiled_by_different_processes_do_not_call_each_other(tmp_path):
    def run(program, cache):
        environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
        done = subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    for body in ("roll", "linear_car", "nonlinear_car"):
        run(f"import canroll.plant_sim.bodies.{body}", tmp_path / "pieces")
    assert run(TOGETHER, tmp_path / "pieces") == run(TOGETHER, tmp_path / "whole")


def test_the_cache_of_an_extension_follows_its_file_and_those_beside_it(tmp_path):
    body, beside = tmp_path / "body.py", tmp_path / "beside.py"
    body.write_text("def step():\n    pass\n")
    beside.write_text("GAIN = 1\n")
    seen = set()
    for file, text in ((body, "def step():\n    return 1\n"), (beside, "GAIN = 2\n")):
        seen.add(jit._Locator(jit.njit, str(body)).get_source_stamp())
        file.write_text(text)
    seen.add(jit._Locator(jit.njit, str(body)).get_source_stamp())
    assert len(seen) == 3
    assert jit._Locator(jit.njit, jit.__file__).get_source_stamp() == jit.FOLDER.name


def test_a_copy_of_the_package_has_the_place_of_the_first_in_the_cache(monkeypatch, tmp_path):
    place = jit._Locator.get_suitable_cache_subpath
    here = place(str(jit.SOURCES / "bodies" / "roll.py"))
    extension = place(str(tmp_path / "bodies" / "roll.py"))
    monkeypatch.setattr(jit, "SOURCES", tmp_path)
    assert place(str(tmp_path / "bodies" / "roll.py")) == here != extension


MEANWHILE = """
import os, time
from numba import int64
from canroll.plant_sim.kernels import jit

@jit.njit
def successor(n):
    return n + 1

os.cpu_count = lambda: 2
print(jit.is_cached(successor), end=" ")
with jit.compiling(successor, (int64,)):
    while not jit.is_cached(successor):
        time.sleep(0.01)
print(successor(1), sum(successor.stats.cache_hits.values()))
try:
    os.waitpid(-1, 0)
except ChildProcessError:
    print("ended")
"""


def test_a_second_process_compiles_for_the_cache_meanwhile(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(MEANWHILE)
    ran = subprocess.run(
        [sys.executable, program],
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    assert ran.stdout == "False 2 1\nended\n"


AGAIN = """
from canroll.plant_sim.kernels import jit

@jit.njit
def successor(n):
    return n + 1

print(successor(1), sum(successor.stats.cache_hits.values()))
"""


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".nbc", ".nbi"])
def test_a_damaged_entry_is_compiled_again(tmp_path, suffix):
    program = tmp_path / "program.py"
    program.write_text(AGAIN)

    def run():
        return subprocess.run(
            [sys.executable, program],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
            capture_output=True,
            text=True,
            check=True,
            timeout=100,
        ).stdout

    assert run() == "2 0\n"
    (entry,) = (tmp_path / "cache").rglob(f"*{suffix}")
    assert entry.stat().st_mode & 0o777 == 0o600
    content = entry.read_bytes()
    for damaged in (content[: len(content) // 2], content[:-1] + bytes([content[-1] ^ 1])):
        entry.write_bytes(damaged)
        assert run() == "2 0\n"
    entry.chmod(0o622)
    assert [run(), run()] == ["2 0\n", "2 1\n"]
