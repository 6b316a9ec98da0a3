"""docs/extend.md from its first example to its last, in one folder; test_docs runs its consoles."""

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from canroll.cli.main import main
from canroll.gain_gen.laws import LAWS

PAGE = (Path(__file__).parents[2] / "docs" / "extend.md").read_text()
BLOCKS = re.findall(r"^```(\w+) ?(\S*)\n(.*?)^```", PAGE, re.S | re.M)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the folder that the page leaves behind, without the bundle; each command succeeds."""
    path = tmp_path_factory.mktemp("extend")
    known = list(LAWS)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        for language, name, text in BLOCKS:
            if name and language != "console":
                (path / name).write_text(text)
            elif language == "python":
                exec(compile(text, "docs/extend.md", "exec"), {})
            elif language == "sh":
                for line in text.replace("\\\n", "").splitlines():
                    command, *arguments = shlex.split(line)
                    assert command == "canroll"
                    if arguments[0] != "export-c":
                        assert main(arguments) == 0, line
    for name in set(LAWS) - set(known):
        del LAWS[name]
    return path


def result_in(folder):
    return json.loads((folder / "result.json").read_text())


def test_every_kind_of_example_is_there():
    languages = [language for language, _, _ in BLOCKS]
    assert languages.count("python") == 3 and languages.count("sh") == 4
    assert {name for language, name, _ in BLOCKS if language != "console"} == {
        "",
        "gains.toml",
        "car.dbc",
        "car.toml",
        "soft_band.py",
    }


@pytest.mark.slow
def test_own_gains_help(folder):
    assert result_in(folder / "own")["law"] == "custom"
    assert result_in(folder / "own")["helps"]


@pytest.mark.slow
def test_an_own_stage_is_run(folder):
    banded = result_in(folder / "banded")
    plain = result_in(folder / "own")
    assert banded["helps"]
    moments = [found["controlled"]["moment_rms_nm"] for found in (banded, plain)]
    assert moments[0] < moments[1]


def test_faults_and_conditions_are_told(folder):
    worse = result_in(folder / "worse")
    assert worse["faults"] == ["Imu.RollRate=stuck@3:5", "front_left=weak:0.33@2"]
    assert worse["conditions"] == {"noise": "3", "supply": "10.5"}


@pytest.mark.long
def test_the_frames_of_an_own_bus_are_in_the_bundle(folder, monkeypatch):
    monkeypatch.chdir(folder)
    (line,) = re.findall(r"^canroll (export-c .*)$", PAGE, re.M)
    assert main(shlex.split(line)) == 0
    source = (folder / "own" / "bundle" / "src" / "canroll_signals.c").read_text()
    assert re.search(r"\b291\b|0x0*123\b", source) and re.search(r"\b801\b|0x0*321\b", source)
    if shutil.which("cc") and shutil.which("make"):
        command = ["make", "-C", folder / "own" / "bundle", "test"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=1800, check=True)
        assert "PASS" in done.stdout
