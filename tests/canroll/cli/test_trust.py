"""Code that a file names is executed where the command line says so, and not before."""

import json
import sys

import pytest

from canroll.cli.main import main
from canroll.registry import TRUST

TRAP = "from pathlib import Path\nPath('sprung').touch()\nthing = 1\n"
CODE = "trap.py:thing"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a module that says so when it is executed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "trap.py").write_text(TRAP)
    before = TRUST.get()
    yield tmp_path
    TRUST.set(before)


def sprung(folder):
    return (folder / "sprung").exists()


def refused(folder, capsys, words, place, name=CODE):
    """Whether a command refuses in one line, and ``--trust`` executes what it refused."""
    assert main(words) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"canroll: {place}") and f"'{name}'" in line and "--trust" in line
    assert not sprung(folder)
    main([*words, "--trust"])
    capsys.readouterr()
    return sprung(folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "r"
    words = ["run", "double_lane_change", "--law", "passive", "--plant", "roll1"]
    main([*words, "--duration", "0.3", "--out", str(out)])
    return out


@pytest.mark.parametrize("key", ["scenario", "plant", "bus"])
@pytest.mark.parametrize("command", ["run", "compare"])
def test_a_received_run(folder, run, capsys, key, command):
    received = folder / "r"
    received.mkdir()
    for path in run.iterdir():
        (received / path.name).write_bytes(path.read_bytes())
    data = json.loads((received / "result.json").read_text())
    (received / "result.json").write_text(json.dumps(data | {key: CODE}))
    assert refused(folder, capsys, [command, "r"], "r/result.json: ")


@pytest.mark.parametrize(
    "text",
    [
        f'scenario = "{CODE}"\n',
        f'scenario = "moose"\n[run]\nlaw = "{CODE}"\n',
        f'scenario = "moose"\n[run]\nplant = "{CODE}"\n',
        f'scenario = "moose"\n[run]\nbus = "{CODE}"\n',
        f'scenario = "moose"\n[draw]\nbus = {{values = ["500k", "{CODE}"]}}\n',
        f'scenario = "moose"\n[draw]\nscenario = {{values = ["moose", "{CODE}"]}}\n',
    ],
)
def test_a_campaign_file(folder, capsys, text):
    (folder / "c.toml").write_text(f"schema = 1\nruns = 1\n{text}")
    assert refused(folder, capsys, ["campaign", "c.toml", "--jobs", "1", "--json"], "c.toml")


@pytest.mark.parametrize("key", ["law", "plant", "bus"])
def test_a_project_file(folder, capsys, key):
    (folder / "canroll.toml").write_text(f'{key} = "{CODE}"\n')
    words = ["run", "moose", "--duration", "0.1", "--json"]
    assert refused(folder, capsys, words, "canroll.toml: ")


def test_a_program_in_a_project_file(folder, capsys):
    (folder / "canroll.toml").write_text('plant = "car.fmu#other.toml"\n')
    words = ["run", "moose", "--duration", "0.1", "--json"]
    assert not refused(folder, capsys, words, "canroll.toml: ", "car.fmu#other.toml")


def test_the_command_line_may_name_code(folder, capsys):
    assert main(["run", CODE, "--json"]) == 2
    assert sprung(folder)
