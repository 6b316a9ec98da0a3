"""The command ``canroll bus``: what it refuses, and its verdict."""

from pathlib import Path

import numpy as np
import pytest

from hil.cli import bus
from hil.cli.main import main

DBC = Path(__file__).parents[3] / "dbc" / "roll_control.dbc"
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


def test_an_overloaded_bus_is_an_answer_and_no_failure(tmp_path, capsys):
    assert main(["bus", traffic(tmp_path, period=10), "--simulate", "0.1"]) == 0
    assert "without a bound" not in capsys.readouterr().out
    assert main(["bus", traffic(tmp_path, period=1), "-b", "125000", "--simulate", "0.1"]) == 0
    assert "without a bound, bus overloaded" in capsys.readouterr().out


def test_an_age_equal_to_its_bound_is_not_above_it(monkeypatch, capsys):
    bound = {}
    total_delay = bus.total_delay

    def noted(*paths, **periods):
        bound["total"] = total_delay(*paths, **periods)
        return bound["total"]

    def ages(*network_and_loop, duration_ns):
        return np.array([round(bound["total"].age_max * 1e9) + bound["beyond_ns"]])

    monkeypatch.setattr(bus, "total_delay", noted)
    monkeypatch.setattr(bus, "simulate_ages", ages)
    for bound["beyond_ns"], code in ((0, 0), (1, 1)):
        assert main(["bus", str(DBC), "--simulate", "0.1"]) == code
    assert "above its bound" in capsys.readouterr().err
