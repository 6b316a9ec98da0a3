"""Terminals and disks as they are: closed, ASCII only, full; a file that starts with a BOM."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from canroll import vehicles
from canroll.cli import main as cli
from canroll.errors import CanrollError
from canroll.gain_gen.laws.custom import read_matrices
from canroll.plant_sim.can_bus import load_profile
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.driving import signal_file
from canroll.report.staging import check_parent

ROOT = Path(__file__).parents[3]
BOM = b"\xef\xbb\xbf"
LIST = "-m canroll.cli.main list"


def shell(line, **environment):
    """Run a line of bash with ``canroll`` as ``$CANROLL``."""
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line.replace("canroll", f"{sys.executable} {LIST}")],
        capture_output=True,
        cwd=ROOT,
        env={**os.environ, **environment},
        check=False,
    )


@pytest.mark.parametrize(
    "line", ["canroll laws | head -1", "canroll laws >&-", "canroll laws <&- >&- 2>&-"]
)
def test_a_closed_output_is_quiet(line):
    done = shell(line)
    assert done.returncode in (0, 141)
    assert done.stderr == b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_is_one_line():
    done = shell("canroll laws >/dev/full")
    assert done.returncode == 2
    assert done.stderr == b"canroll: No space left on device\n"


@pytest.mark.parametrize(
    "environment",
    [
        {"PYTHONIOENCODING": "ascii"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    ],
)
def test_an_ascii_terminal_shows_everything(environment):
    done = shell("canroll vehicles && canroll scenarios && canroll laws", **environment)
    assert done.returncode == 0
    assert done.stderr == b""
    assert done.stdout.isascii()


def test_what_ascii_lacks_is_replaced_by_its_like(capfdbinary, monkeypatch):
    monkeypatch.setattr(
        sys,
        "stdout",
        open(os.dup(1), "w", encoding="ascii"),  # noqa: SIM115
    )
    cli.prepare_streams()
    print("1.54° instead of 2.38° (−35 %), ε", flush=True)
    assert capfdbinary.readouterr().out == b"1.54 deg instead of 2.38 deg (-35 %), ?\n"


def test_a_file_that_cannot_be_written_is_found_before_the_run(tmp_path, capsys):
    if os.geteuid():
        (tmp_path / "read_only").mkdir(mode=0o500)
        place = tmp_path / "read_only"
    else:
        place = Path("/proc")
    for option in ("--log", "--signals"):
        path = place / ("a.asc" if option == "--log" else "a.csv")
        # an unknown option of the manoeuvre would be found at the start of the run
        assert cli.main(["run", "moose", option, str(path), "--set", "nonsense=1"]) == 2
        assert f"canroll: cannot write {path}" in capsys.readouterr().err


def test_looking_whether_a_file_can_be_written_leaves_it_as_it_is(tmp_path):
    old, new = tmp_path / "old.log", tmp_path / "new.log"
    old.write_text("kept")
    assert check_parent(old) == old and check_parent(new) == new
    assert old.read_text() == "kept"
    assert not new.exists()
    with pytest.raises(CanrollError, match="it is a folder"):
        check_parent(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "read"),
    [
        ("n.toml", b"schema = 1\nbitrate = 500000\nload = 0.3\n", lambda p: load_profile(str(p))),
        ("t.toml", b'[[message]]\nname="A"\nid=1\nbytes=8\nperiod_ms=10\n', load_traffic),
        ("g.toml", b"K = [[1.0, 2.0]]\n", read_matrices),
        (
            "s.csv",
            b"time,steering_wheel_deg\n0,0\n1,2\n",
            lambda p: signal_file.read(str(p), ["steering_wheel_deg"]),
        ),
        ("v.toml", Path(vehicles.__file__).with_name("van_real.toml").read_bytes(), vehicles.load),
    ],
)
def test_a_byte_order_mark_is_not_content(name, content, read, tmp_path):
    path = tmp_path / name
    for start in (b"", BOM):
        path.write_bytes(start + content)
        read(path)
