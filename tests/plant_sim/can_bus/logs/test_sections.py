"""Logs whose times step: cut there, joined where they go on, and said so."""

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.logs.sections import find_sections
from canroll.plant_sim.can_bus.traffic.log_reader import read_log

MS = 1_000_000
DAY = 86_400_000 * MS
TIMES = np.arange(1000) * 10 * MS


def sizes(times):
    return [len(rows) for rows in find_sections(np.asarray(times)).rows]


def shifted(first, last, by_ns):
    times = TIMES.copy()
    times[first:last] += by_ns
    return times


def test_steady_times_are_one_section_without_a_word():
    sections = find_sections(TIMES)
    assert len(sections.rows) == 1
    rows, remark = sections.choose(None)
    assert rows.tolist() == list(range(1000))
    assert remark == ""


def test_small_disorder_and_pauses_of_a_drive_are_no_steps():
    times = TIMES.copy()
    times[500:502] = times[501], times[500]
    times[700:] += 50_000 * MS
    assert sizes(times) == [1000]


def test_a_bus_that_is_seldom_used_has_long_pauses():
    assert sizes(np.arange(20) * 100_000 * MS) == [20]


@pytest.mark.parametrize("by_ns", [3 * DAY, -5000 * MS, -9000 * MS])
def test_days_without_frames_and_a_jump_back_cut_the_log(by_ns):
    sections = find_sections(shifted(600, 1000, by_ns))
    assert [len(rows) for rows in sections.rows] == [600, 400]
    rows, remark = sections.choose(None)
    assert rows.tolist() == list(range(600))
    assert "at frame 601: section 1 of 2 is read, 600 of 1000 frames" in remark
    rows, remark = sections.choose(2)
    assert rows.tolist() == list(range(600, 1000))
    assert "section 2 of 2 is read, 400 of 1000" in remark


@pytest.mark.parametrize("by_ns", [1000 * MS, -1000 * MS, 3 * DAY, -3 * DAY, 200 * MS])
def test_what_a_set_clock_moved_is_cut_out_of_a_log_that_goes_on(by_ns):
    sections = find_sections(shifted(400, 490, by_ns))
    rows, remark = sections.choose(None)
    assert rows.tolist() == [*range(400), *range(490, 1000)]
    assert "at frame 401" in remark
    assert "at frame 491" in remark
    assert "910 of 1000 frames on one time line" in remark


def test_two_steps_of_the_clock_are_both_cut_out():
    times = shifted(400, 490, 1000 * MS)
    times[700:750] += 2000 * MS
    rows, _ = find_sections(times).choose(None)
    assert rows.tolist() == [*range(400), *range(490, 700), *range(750, 1000)]


def test_times_that_jump_back_again_and_again_are_refused():
    with pytest.raises(CanrollError, match="jump back 99 times in 1000 frames: they are no times"):
        find_sections(np.tile(np.arange(10) * 10 * MS, 100))


def test_differences_are_no_times():
    """``candump -t d``: 0.3 and 9.7 ms in turn."""
    with pytest.raises(CanrollError, match="the times of 500 of 1000 frames are before those of"):
        find_sections(np.tile([9_700_000, 300_000], 500))


def test_one_time_for_all_frames_is_none():
    with pytest.raises(CanrollError, match="all 50 frames have the same time"):
        find_sections(np.zeros(50, np.int64))


def log(tmp_path, times, name="drive.log"):
    path = tmp_path / name
    path.write_text(
        "".join(
            f"({100 + t * 1e-9:.6f}) can0 172#00000000000000{k % 256:02X}\n"
            for k, t in enumerate(times)
        )
    )
    return path


def test_a_section_starts_at_time_0_and_in_order(tmp_path):
    path = log(tmp_path, shifted(600, 1000, 3 * DAY))
    logged = read_log(path, section=2)["can0"]
    assert logged.received_ns[0] == 0
    assert logged.received_ns[-1] == 3990 * MS
    assert logged.payload[0, 7] == 600 % 256
    assert "forward by 3 d at frame 601" in logged.remarks[0]
    with pytest.raises(CanrollError, match="--section 3: there are sections 1 to 2"):
        read_log(path, section=3)
    with pytest.raises(CanrollError, match="--section 0: there are sections 1 to 2"):
        read_log(path, section=0)


def test_a_step_of_one_second_is_cut_out(tmp_path):
    logged = read_log(log(tmp_path, shifted(180, 270, 1000 * MS)))["can0"]
    assert len(logged.ident) == 910
    assert (np.diff(logged.received_ns) > 0).all()
    assert logged.received_ns[-1] == 9990 * MS
    assert "forward by 1.01 s at frame 181, back by 990 ms at frame 271" in logged.remarks[0]


def test_times_that_fall_throughout_are_called_negated():
    with pytest.raises(CanrollError, match="take the minus off"):
        find_sections(-TIMES)
