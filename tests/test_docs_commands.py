"""docs/commands.md tells of every command its exit code 1 and the keys of its JSON object."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from canroll.cli import main as cli
from canroll.cli.commands import COMMANDS

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
SECTIONS = {
    name: text
    for names, text in re.findall(r"^## canroll (.+?)$(.*?)(?=^## |\Z)", PAGE, re.M | re.S)
    for name in names.split(", ")
}


def keys(command, of=""):
    """Return the keys that the section of ``command`` has in tables of JSON, dots for depth.

    ``of``: what the tables are of; by default the command.
    """
    tables = re.findall(r"^\| key(?: of (?:a )?(\S+))? \|(.*?)\n\n", SECTIONS[command], re.M | re.S)
    taken = [table for kind, table in tables if kind == (of or (kind and command))]
    cells = [row.split(" | ")[0] for table in taken for row in table.splitlines()[2:]]
    return {key for cell in cells for key in re.findall(r"`(.+?)`", cell)}


def tops(paths):
    return {path.split(".")[0] for path in paths}


@pytest.mark.drift
def test_every_command_has_its_exit_code():
    rows = PAGE.partition("| exit code 1 |")[2].partition("\n\n")[0].splitlines()
    named = [name for row in rows for name in re.findall(r"`([a-z-]+)`", row.split(" | ")[0])]
    assert sorted(named) == sorted(COMMANDS)


ARGUMENTS = {
    "run": ["double_lane_change", "--duration", "1"],
    "campaign": ["--runs", "2", "--jobs", "1"],
    "handling": ["circle", "--plant", "roll1", "--law", "plain_feedforward"],
    "bus": [str(ROOT / "dbc" / "roll_control.dbc"), "--simulate", "1"],
    "prove": [],
    "timing": ["--duration", "0.1"],
    "hil": ["double_lane_change", "--duration", "1", "--pace", "lockstep"],
}
SLOW = ("campaign", "handling", "timing", "hil", "prove")


@pytest.mark.parametrize(
    "command",
    [pytest.param(c, marks=pytest.mark.slow) if c in SLOW else c for c in ARGUMENTS],
)
def test_keys_are_those_of_the_object(command, capsys):
    cli.main([command, *ARGUMENTS[command], "--json"])
    found = json.loads(capsys.readouterr().out)
    told = keys(command) | (keys("run") if command == "hil" else set())
    told |= keys(command, "pair")
    assert tops(told) == set(found)
    for path in told:
        value = found
        for part in re.split(r"\.(?!\d)", path):
            value = value[part]


@pytest.mark.slow
def test_keys_of_a_design_and_of_its_margins(tmp_path, capsys):
    assert cli.main(["design", "--law", "lqr", "--out", str(tmp_path), "--json"]) == 0
    assert keys("design") == set(json.loads(capsys.readouterr().out))
    assert cli.main(["margins", str(tmp_path / "calibration.toml"), "--json"]) == 0
    # of a vehicle that a log was fitted to, alone
    assert keys("margins") - {"fit"} == set(json.loads(capsys.readouterr().out))


@pytest.mark.slow
def test_keys_of_a_certificate(tmp_path, capsys, monkeypatch):
    """They are those of two cars of the family as of all."""
    pytest.importorskip("flint")
    from canroll.extensions.certify import subject

    family_of = subject.family_of

    def of_two(task):
        family = family_of(task)
        return replace(family, members=family.members[:2])

    monkeypatch.setattr(subject, "family_of", of_two)
    assert cli.main(["design", "--law", "hinf_delay", "--out", str(tmp_path), "--json"]) == 0
    capsys.readouterr()
    assert cli.main(["certify", str(tmp_path / "calibration.toml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    nested = {"name", "claims", *found["conditions"][0]["claims"][0]}
    nested |= {"proved_to_s", "unstable", "sequence_s", "growth_per_tick", "every tick"}
    nested |= {"event trigger", "1 lost"}
    rows = re.findall(r"^\| (`.+?) \|", SECTIONS["certify"].partition("| key |")[2], re.M)
    assert {key for row in rows for key in re.findall(r"`(.+?)`", row)} == set(found)
    assert set(re.findall(r"`(.+?)`", SECTIONS["certify"])) >= set(found) | nested


@pytest.mark.parametrize(
    ("line", "of"),
    [
        ("response --linear", "linearisation"),
        ("response --plant roll1", "response"),
        ("limit double_lane_change --plant roll1 --from 60 --tolerance 50", "limit"),
    ],
)
def test_keys_of_a_handling_test(line, of, capsys):
    assert cli.main(["handling", *line.split(), "--json"]) == 0
    found = set(json.loads(capsys.readouterr().out))
    assert keys("handling", of) - {"controlled"} == found - {"controlled"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "of"),
    [
        ("--runs 2 --vehicle van_2021 --plant roll1 --only 0", "population"),
        ("--scenario severe --runs 2 --law lqr --only 0", "severe"),
    ],
)
def test_keys_of_a_population(line, of, capsys):
    assert cli.main(["compare", *line.split(), "--json"]) == 0
    assert keys("compare", of) >= set(json.loads(capsys.readouterr().out))


def test_keys_of_the_reproduction():
    from canroll.extensions.papers.reproduce import to_json

    assert keys("reproduce") == {*to_json([]), "files"}


def test_keys_of_what_watch_sees():
    from canroll.hil.watch.observation import Observation

    assert keys("watch") == set(Observation(500_000).summary())
