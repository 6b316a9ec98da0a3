"""The example package is installed beside canroll and used without an edit of ours."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Return the folder that the example is installed in, and its source."""
    base = tmp_path_factory.mktemp("example")
    source, target = base / "source", base / "target"
    shutil.copytree(ROOT / "examples" / "canroll-example", source)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    pip += ["--no-build-isolation", "--target", target, source]
    subprocess.run(pip, check=True)
    return target, source


def in_example(installed, *arguments, cwd):
    environment = {**os.environ, "PYTHONPATH": f"{installed[0]}{os.pathsep}{ROOT}"}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


def test_all_that_it_offers_is_listed_and_driven(installed, tmp_path):
    canroll = ("-m", "canroll.cli.main")
    offered = {"laws": "skyhook", "bodies": "heavy_roof", "scenarios": "weave"}
    for kind, name in {**offered, "buses": "250k_van"}.items():
        listed = in_example(installed, *canroll, "list", kind, "--json", cwd=tmp_path)
        (row,) = [row for row in json.loads(listed.stdout) if row["name"] == name]
        assert row["origin"] == "canroll-example 1.0.0"
        assert row["description"]
    options = ["--law", "skyhook", "--plant", "heavy_roof", "--bus", "250k_van", "--out", "out"]
    driven = in_example(installed, *canroll, "run", "weave", *options, cwd=tmp_path)
    assert driven.returncode == 0, driven.stderr
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert (result["law"], result["plant"], result["bus"]) == ("skyhook", "heavy_roof", "250k_van")
    calibration = (tmp_path / "out" / "calibration.toml").read_text()
    assert 'law_from = "canroll-example 1.0.0"' in calibration


def test_its_own_suite_passes(installed, tmp_path):
    tests = installed[1] / "tests"
    arguments = ("-m", "pytest", "-q", "-p", "no:cacheprovider", tests)
    done = in_example(installed, *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stdout


def test_folders_beside_a_script_hide_nothing_of_ours(tmp_path):
    for name in ("dbc", "firmware", "vehicles"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "notes.txt").write_text("a user's own")
    script = tmp_path / "script.py"
    script.write_text(
        "import canroll\n"
        "result = canroll.run('double_lane_change', law='lqr', duration=2.0)\n"
        "print(canroll.load_vehicle('van_real').name, result.settings.law)\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, script],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "van_real lqr\n", done.stderr
