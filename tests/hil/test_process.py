"""Real-time settings of a process last as long as its loop."""

import os
from pathlib import Path

import pytest

from canroll.cli.main import main
from canroll.hil import process


def scheduled():
    locked = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if "VmLck" in line
    )
    return os.sched_getscheduler(0), os.sched_getaffinity(0), locked


@pytest.mark.long
def test_the_settings_of_a_loop_end_with_it():
    before = scheduled()
    with process.prepared(cpu=min(before[1]), priority=process.ECU_PRIORITY) as notes:
        inside = scheduled()
        assert inside[1] == {min(before[1])}
        # one that is refused is noted
        assert (inside[0] == os.SCHED_FIFO) != any("priority" in note for note in notes)
    assert scheduled() == before


def test_a_program_in_this_process_leaves_it_as_it_was(capsys):
    before = scheduled()
    options = ["--duration", "0.05", "--wait", "0.05", "--serve", "127.0.0.1:0"]
    assert main(["plant", "double_lane_change", "--actuator", "bars", *options]) == 2
    assert "no ECU found" in capsys.readouterr().err
    assert scheduled() == before
