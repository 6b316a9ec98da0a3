"""Tables on a terminal and in a pipe."""

import pytest

from canroll.cli import terminal
from canroll.report.page import PageTable

ATTACKS = PageTable(
    "",
    ("", "sent", "accepted", "roll max (deg)", "fault codes"),
    [
        (
            "spoofed AntiRollBarCommand: TorqueFront, TorqueRear",
            "101",
            "101",
            "2.97",
            "heard, late",
        ),
        ("none", "0", "0", "1.54", ""),
    ],
)


def test_a_pipe_has_no_edge(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    terminal.show([ATTACKS])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert "TorqueFront, TorqueRear   101       101            2.97  heard, late" in lines[1]


@pytest.mark.parametrize("columns", (40, 60, 80))
def test_a_narrow_terminal_shows_every_letter_and_breaks_between_words(
    capsys, monkeypatch, columns
):
    monkeypatch.setenv("COLUMNS", str(columns))
    terminal.show([ATTACKS])
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= columns
    everything = "".join(letter for text in (*ATTACKS.head, *ATTACKS.rows[0]) for letter in text)
    assert sorted("".join(out.split())) == sorted(
        "".join((everything + "".join(ATTACKS.rows[1])).split())
    )
    if columns > 40:
        assert "AntiRollBarCommand:" in out
        assert "accepted" in out


def test_a_pipe_gets_a_line_a_minute_on_stderr(capsys, monkeypatch):
    clock = iter((0.0, 30.0, 61.0, 90.0, 125.0))
    monkeypatch.setattr(terminal.time, "monotonic", lambda: next(clock))
    with terminal.progress(quiet=False) as progress:
        for share in (0.1, 0.2, 0.3, 0.4):
            progress("controlled", share)
    printed = capsys.readouterr()
    assert printed.err == "controlled: 20 % after 1 min\ncontrolled: 40 % after 2 min\n"
    assert not printed.out


def test_json_is_quiet(capsys, monkeypatch):
    clock = iter((0.0, 61.0))
    monkeypatch.setattr(terminal.time, "monotonic", lambda: next(clock))
    with terminal.progress(quiet=True) as progress:
        progress("controlled", 0.1)
    assert not capsys.readouterr().err
