"""A command of the server's is a process of its own: arguments, folder, streams, exit code."""

import os
import subprocess

import pytest

from tools.warm import served

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shell(tmp_path_factory):
    """Return a function that runs a line of the shell in an empty folder."""
    folder = tmp_path_factory.mktemp("empty")
    with served() as programs:
        path = f"{programs}{os.pathsep}{os.environ['PATH']}"

        def run(line):
            return subprocess.run(
                line,
                shell=True,
                cwd=folder,
                env=os.environ | {"PATH": path},
                capture_output=True,
                text=True,
                check=False,
            )

        yield run


def test_it_ends_with_the_exit_code_and_writes_to_its_own_streams(shell):
    wrong = shell("canroll run no_such_scenario")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert "no_such_scenario" in wrong.stderr
    assert shell("canroll list laws | grep -c lqr").stdout.strip() > "0"
    help_text = shell("canroll run --help")
    assert help_text.returncode == 0 and "--duration" in help_text.stdout


@pytest.mark.long
def test_it_sees_its_folder_and_environment_and_leaves_nothing_to_the_next(shell):
    shell("printf '[run]\\nduration = 0.2\\nnonsense = 1\\n' > canroll.toml")
    assert "canroll.toml" in shell("canroll run double_lane_change").stderr
    shell("rm canroll.toml")
    code = shell("XDG_CACHE_HOME=$PWD/none canroll list options > options.txt; ls").stdout
    assert "options.txt" in code
    shell("canroll run double_lane_change --duration 0.2 --out out")
    assert shell("ls out").stdout
