"""The reference of public names builds from their docstrings without a warning."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.long
def test_it_builds_without_a_warning(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "api-reference", tmp_path],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{tmp_path}/index.html\n", "")
    page = (tmp_path / "canroll.html").read_text(encoding="utf-8")
    for name in ("run", "design", "load_vehicle", "Result"):
        assert f'id="{name}"' in page
    assert (tmp_path / "plant_sim" / "can_bus" / "bounds" / "delay_bounds.html").is_file()
