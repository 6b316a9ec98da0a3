"""The command ``canroll bus``: what it refuses, and its verdict."""

import pytest

from hil.cli import main

ROW = """
[[message]]
name = "{name}"
id = {ident}
bytes = 8
period_ms = {period}
"""


def traffic(folder, *, period):
    path = folder / "set.toml"
    names = (("Imu", 0xA0), ("SuspensionForceCommand", 0x80))
    path.write_text("".join(ROW.format(name=n, ident=i, period=period) for n, i in names))
    return str(path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--serve", "99999"], "a port is 0 to 65535"),
        (["--bitrate", "2000000"], "at most 1000000 bit/s"),
        (["--sensor", "Imi"], "did you mean 'Imu'?"),
        (["--command", "SuspensionForce"], "did you mean 'SuspensionForceCommand'?"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, capsys, options, message):
    assert main(["bus", traffic(tmp_path, period=10), *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_an_overloaded_bus_is_a_failed_verdict(tmp_path, capsys):
    assert main(["bus", traffic(tmp_path, period=10), "--simulate", "0.1"]) == 0
    assert main(["bus", traffic(tmp_path, period=1), "-b", "125000", "--simulate", "0.1"]) == 1
    assert "without a bound" in capsys.readouterr().out
