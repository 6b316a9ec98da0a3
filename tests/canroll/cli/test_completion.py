"""The script of ``canroll list completion``, sourced by the shell it is for."""

import shutil
import subprocess
from contextlib import redirect_stdout

import pytest

from canroll.cli.main import main

BASH = """
source "$1"; shift
function=$(complete -p canroll | sed 's/.*-F \\([^ ]*\\).*/\\1/')
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
"$function"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    pytest.importorskip("shtab", reason="needs shtab")
    if shutil.which("bash") is None:
        pytest.skip("needs bash")
    path = tmp_path_factory.mktemp("completion") / "canroll.sh"
    with path.open("w") as file, redirect_stdout(file):
        assert main(["list", "completion", "--shell", "bash"]) == 0
    return path


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["canroll", "desi"], {"design"}),
        (["canroll", "run", "double"], {"double_lane_change"}),
        (["canroll", "run", "moose", "--law", "lqg"], {"lqg_delay"}),
        (["canroll", "run", "moose", "--vehicle", "van_2"], {"van_2021", "van_2022"}),
        (["canroll", "design", "--delay"], {"--delay", "--delay-min"}),
        (["canroll", "run", "moose", "--back"], {"--backend"}),
    ],
)
def test_words_are_completed(script, words, expected):
    command = ["bash", "-c", BASH, "bash", str(script), *words]
    shown = subprocess.run(command, capture_output=True, text=True, check=True)
    assert set(shown.stdout.split()) == expected
