"""The core runs with the folders of all extensions deleted."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DESIGNED = ("design", "--law", "lqr", "--out", "designed")
RUN = ("run", "double_lane_change", "--calibration", "designed/calibration.toml", "--duration", "1")


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """A copy of the product without the extensions."""
    folder = tmp_path_factory.mktemp("core")
    leave_out = shutil.ignore_patterns("__pycache__", "extensions")
    shutil.copytree(ROOT / "canroll", folder / "canroll", ignore=leave_out)
    return folder


def python(core, folder, *words):
    """Run Python with the copy before all else that is installed."""
    environment = {**os.environ, "PYTHONPATH": str(core)}
    return subprocess.run(
        [sys.executable, "-P", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )


@pytest.mark.slow
def test_every_module_of_the_core_is_imported(core):
    names = [
        ".".join(path.relative_to(core).with_suffix("").parts).removesuffix(".__init__")
        for path in sorted((core / "canroll").rglob("*.py"))
    ]
    program = f"for name in {names}: __import__(name)"
    done = python(core, core, "-c", program)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_commands_of_the_core_run_and_others_are_unknown(core, tmp_path):
    for words in (DESIGNED, RUN, ("bus", "500k"), ("prove",), ("export-c", "bundle")):
        done = python(core, tmp_path, "-m", "canroll.cli.main", *words)
        assert (done.returncode, done.stderr) == (0, ""), words
    assert "--xcp" not in python(core, tmp_path, "-m", "canroll.cli.main", "ecu", "--help").stdout
    listed = python(core, tmp_path, "-m", "canroll.cli.main", "--help").stdout
    for name in ("fit", "certify", "campaign", "reproduce", "export-fmu"):
        assert f"  {name} " not in listed
        done = python(core, tmp_path, "-m", "canroll.cli.main", name)
        assert done.returncode == 2 and f"unknown command '{name}'" in done.stderr
