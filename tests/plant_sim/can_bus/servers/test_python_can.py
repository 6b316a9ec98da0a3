"""The tests of the installed python-can itself, with ``simbus`` in place of ``virtual``."""

import os
import re
import subprocess
import sys
import tarfile
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]
FILES = (
    "back2back_test.py",
    "contextmanager_test.py",
    "listener_test.py",
    "network_test.py",
    "notifier_test.py",
    "simplecyclic_test.py",
    "test_bridge.py",
    "test_bus.py",
    "test_detect_available_configs.py",
    "test_interface_virtual.py",
    "test_logger.py",
    "test_message_filtering.py",
    "test_player.py",
    "test_viewer.py",
    "zero_dlc_test.py",
)
"""Test modules that open buses; the others are about messages, files and other interfaces."""
EXCEPTIONS: dict[str, str] = {}
"""Tests of theirs that cannot pass, each with the reason."""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Return the unpacked source package of the installed python-can."""
    folder = tmp_path_factory.mktemp("python-can")
    package = f"python-can=={version('python-can')}"
    pip = [sys.executable, "-m", "pip", "download", "--no-deps", "--no-binary", "python-can"]
    done = subprocess.run([*pip, "-d", folder, package], capture_output=True, check=False)
    found = list(folder.glob("*.tar.gz"))
    if done.returncode or not found:
        pytest.skip(f"the source package of {package} cannot be had")
    with tarfile.open(found[0]) as archive:
        archive.extractall(folder, filter="data")
    return next(path.parent for path in folder.glob("*/test"))


@pytest.mark.long
def test_its_own_tests_pass_on_simbus(source):
    (source / "pytest.ini").write_text("[pytest]\n")
    options = [f"--deselect=test/{name}" for name in EXCEPTIONS]
    # CI: leaves out what python-can itself calls too sensitive to the speed of the machine
    paths = (ROOT, ROOT / "tests" / "support", os.environ.get("PYTHONPATH", ""))
    environment = os.environ | {"CI": "true", "PYTHONPATH": os.pathsep.join(map(str, paths))}
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-p", "virtual_as_simbus"),
            *("-c", "pytest.ini", "--rootdir", ".", *options, *(f"test/{n}" for n in FILES)),
        ],
        cwd=source,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    passed = re.search(r"(\d+) passed", done.stdout)
    assert passed and int(passed[1]) > 80
