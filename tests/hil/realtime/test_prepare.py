"""``--prepare`` fills the caches, so that the run after it compiles nothing."""

import os
import subprocess
import sys

import pytest

from hil.cli.main import main


def canroll(cache, *arguments):
    """Run a command whose caches are in ``cache``; return what it said."""
    ran = subprocess.run(
        [sys.executable, "-m", "hil.cli.main", *arguments],
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def compiled(cache):
    """Return the files of machine code in a cache and when each was written."""
    files = [path for path in cache.rglob("*") if path.suffix in (".nbc", ".nbi", ".so")]
    return {path.relative_to(cache): path.stat().st_mtime_ns for path in files}


@pytest.mark.slow
def test_what_is_prepared_is_not_compiled_again(tmp_path):
    cache = tmp_path / "cache"
    said = canroll(cache, "hil", "double_lane_change", "--law", "lqr", "--prepare")
    assert said == ""
    before = compiled(cache)
    assert {path.suffix for path in before} == {".nbc", ".nbi", ".so"}
    out = tmp_path / "out"
    own_bus = ["--serve", "127.0.0.1:0", "--wait", "0"]
    canroll(cache, "plant", "double_lane_change", *own_bus, "--duration", "0.5")
    canroll(cache, "run", "double_lane_change", "--law", "lqr", "--out", str(out))
    assert compiled(cache) == before


def test_preparing_opens_no_bus(capsys):
    bus = ["-i", "socketcan", "-c", "none0"]
    assert main(["plant", "double_lane_change", *bus, "--prepare"]) == 0
    assert main(["hil", "double_lane_change", "--law", "lqr", *bus, "--prepare"]) == 0
    assert main(["hil", "--check", *bus, "--prepare"]) == 0
    assert capsys.readouterr() == ("", "")


def test_what_cannot_be_is_refused_while_preparing(capsys):
    assert main(["hil", "double_lane_chang", "--prepare"]) == 2
    assert "did you mean 'double_lane_change'?" in capsys.readouterr().err
