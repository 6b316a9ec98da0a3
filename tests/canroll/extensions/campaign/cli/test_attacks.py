"""``canroll faults --catalogue attacks``: buses, tables, verdicts and exit codes."""

import json
from types import SimpleNamespace

import pytest

from canroll.cli.main import main
from canroll.extensions.campaign.attacks import suite
from canroll.extensions.campaign.attacks.suite import AttackOutcome, Suite
from canroll.extensions.campaign.cli.faults import chosen


def outcome(accepted, refused, harm=("roll",)):
    return AttackOutcome("spoofed", 40, accepted, refused, 2.5, 900.0, 0.25, ("command",), harm)


def made(bus, accepted):
    secured = bus == "secured_fd"
    settings = SimpleNamespace(bus=bus, bus_name=bus)
    outcomes = (outcome(0, None), outcome(accepted, (30, 10) if secured else None))
    return Suite(settings, secured, 2.38, outcomes)


@pytest.fixture
def driven(monkeypatch):
    asked = []

    def run(scenario, *, named, cases, **choices):
        assert (named, cases.execution.jobs) == ("", 2)
        asked.append((scenario, choices))
        return made(choices["bus"], choices.pop("seed", 0))

    monkeypatch.setattr(suite, "run", run)
    return asked


def test_both_buses_are_attacked(driven, capsys):
    assert main(["faults", "--catalogue", "attacks", "--jobs", "2"]) == 0
    assert [choices["bus"] for _, choices in driven] == ["500k", "secured_fd"]
    shown = capsys.readouterr().out
    assert "500k, not authenticated: 80 forged frames, accepted 0 times; 1 of 1 attacks" in shown
    assert "without control" in shown


@pytest.mark.parametrize(("bus", "code"), [("500k", 0), ("secured_fd", 1)])
def test_only_what_gets_through_authentication_fails(driven, bus, code, capsys):
    words = ["moose", "--catalogue", "attacks", "--bus", bus, "--seed", "3", "--jobs", "2"]
    assert main(["faults", *words, "--json"]) == code
    assert driven[0][0] == "moose"
    (found,) = json.loads(capsys.readouterr().out)["suites"]
    assert (found["accepted"], found["authenticated"]) == (3, code == 1)
    assert found["attacks"][1]["refused"] == ([30, 10] if code else None)


def test_a_key_is_for_the_bus_that_has_one():
    assert chosen({"key": "k", "seed": 1}) == [
        {"seed": 1, "bus": "500k"},
        {"key": "k", "seed": 1, "bus": "secured_fd"},
    ]
    assert chosen({"dbc": "own.dbc", "map": "own.toml"}) == [{"dbc": "own.dbc", "map": "own.toml"}]
