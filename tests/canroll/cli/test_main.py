import argparse
import errno
import re
import sys
from importlib import import_module
from pkgutil import resolve_name

import pytest

from canroll.cli import main as cli
from canroll.cli.commands import COMMANDS
from canroll.errors import VerdictError
from canroll.runs import virtual_time


@pytest.fixture
def command(monkeypatch):
    """Register a command whose run is the function given."""

    def register(run):
        def options(parser):
            parser.add_argument("--count", type=int)

        monkeypatch.setitem(COMMANDS, "run", options)
        monkeypatch.setattr(cli, "resolve_name", lambda name: run)

    return register


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_options_and_a_handler(name):
    parser = cli.parser_of(name)
    assert parser.prog == f"canroll {name}"
    assert callable(resolve_name(parser.handler))


def test_help_names_every_command(capsys):
    assert cli.main(["--help"]) == 0
    out = capsys.readouterr().out
    named = [line.split()[0] for line in out.splitlines() if line.startswith("  ")]
    assert sorted(named) == sorted(COMMANDS)


def test_nothing_to_do_prints_help_and_is_a_usage_error(capsys):
    assert cli.main([]) == 2
    assert "simulate:" in capsys.readouterr().out


def test_unknown_command_suggests_the_nearest(capsys):
    assert cli.main(["rnu"]) == 2
    assert capsys.readouterr().err == "canroll: unknown command 'rnu': did you mean 'run'?\n"


def test_an_unknown_option_names_the_commands_own_help(capsys, command):
    command(lambda args: 0)
    assert cli.main(["run", "--cuont", "3", "more"]) == 2
    error = capsys.readouterr().err
    assert error == "canroll: 'run' does not take --cuont 3 more (see 'canroll run --help')\n"


@pytest.mark.parametrize(
    "command_line", ["campaign --res", "run moose --dur 1", "export-c d --ad 1"]
)
def test_an_option_has_one_spelling(capsys, command_line):
    """A command line that is written again, as that of a campaign, must be one that is taken."""
    assert cli.main(command_line.split()) == 2
    name, *_, option = command_line.removesuffix(" 1").split()
    assert f"'{name}' does not take {option}" in capsys.readouterr().err


def test_wrong_option_is_one_line(capsys, command):
    command(lambda args: 0)
    assert cli.main(["run", "--count", "many"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--count" in error and "canroll run --help" in error
    assert cli.main(["--nope"]) == 2


def test_errors_become_a_line_and_their_exit_code(capsys, command):
    def refuse(args: argparse.Namespace) -> int:
        raise VerdictError("no gain keeps this delay stable: lower the delay")

    command(refuse)
    assert cli.main(["run"]) == 1
    assert capsys.readouterr().err == "canroll: no gain keeps this delay stable: lower the delay\n"


def test_an_interrupted_run_writes_no_files(tmp_path, capsys, monkeypatch):
    def interrupt(self, t, image):
        raise KeyboardInterrupt

    monkeypatch.setattr(virtual_time.TickRows, "add", interrupt)
    words = ["run", "double_lane_change", "--law", "lqr", "--out", str(tmp_path / "out")]
    assert cli.main(words) == 130
    assert re.fullmatch(
        r"canroll: interrupted at \S+ s of the run: no files are written\n",
        capsys.readouterr().err,
    )
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_interrupt_is_130(command):
    def interrupt(args):
        raise KeyboardInterrupt

    command(interrupt)
    assert cli.main(["run"]) == 130


def test_the_commands_answer_is_the_exit_code(command):
    command(lambda args: args.count)
    assert cli.main(["run", "--count", "7"]) == 7


@pytest.mark.parametrize(
    ("package", "line"),
    [
        ("unicorn", "needs bincopy, capstone, unicorn and ziglang: pip install 'canroll[target]'"),
        ("asammdf", "needs asammdf: pip install 'canroll[asammdf]'"),
    ],
)
def test_a_missing_extra_is_a_line_that_says_how_to_install_it(
    command, capsys, monkeypatch, package, line
):
    monkeypatch.setitem(sys.modules, package, None)
    command(lambda args: import_module(f"{package}.part"))
    assert cli.main(["run"]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


def test_another_missing_module_is_not_hidden(command, capsys):
    command(lambda args: import_module("no_such_module_at_all"))
    assert cli.main(["run"]) == 3
    assert "No module named 'no_such_module_at_all'" in capsys.readouterr().err


def test_an_error_of_ours_asks_for_a_report(capsys, monkeypatch, tmp_path):
    def crash(arguments):
        raise ZeroDivisionError("nothing to\ndivide by")

    monkeypatch.setattr(cli, "dispatch", crash)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cli.main(["run"]) == 3
    line = capsys.readouterr().err
    assert line.startswith("canroll: internal error, ZeroDivisionError: nothing to: please report")
    assert line.count("\n") == 1
    (kept,) = tmp_path.glob("canroll-error-*.txt")
    assert str(kept) in line
    assert "Traceback" in kept.read_text()


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device", "out/trace.npz"),
            "canroll: No space left on device: out/trace.npz\n",
        ),
        (MemoryError(), "canroll: out of memory\n"),
    ],
)
def test_a_machine_that_is_full_is_no_error_of_ours(capsys, monkeypatch, error, message):
    def fail(arguments):
        raise error

    monkeypatch.setattr(cli, "dispatch", fail)
    assert cli.main(["run"]) == 2
    assert capsys.readouterr().err == message


def test_help_leaves_out_what_help_all_shows(capsys):
    texts = []
    for option in ("--help", "--help-all"):
        with pytest.raises(SystemExit) as ended:
            cli.main(["run", option])
        assert ended.value.code == 0
        texts.append(capsys.readouterr().out)
    assert "--vehicle" in texts[0]
    assert "--moment-share" not in texts[0]
    assert "--moment-share" in texts[1]
    assert cli.parse(["run", "moose", "--moment-share", "0.4"]).moment_share == 0.4
