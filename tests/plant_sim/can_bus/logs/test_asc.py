"""Logs of Vector's tools: times, headers, and frames that python-can's reader takes for others."""

import numpy as np
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.traffic.log_reader import read_log
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, EXTENDED, FD, REMOTE

DATE = "date Mon Dec 6 11:21:13 am 2021\n"
HEAD = f"{DATE}base hex  timestamps absolute\ninternal events logged\nBegin TriggerBlock x\n"
TAIL = "103625  136   {flags} 98005364 4ba00150 4b280150 20002776 2000091c"


def read(tmp_path, text):
    path = tmp_path / "log.asc"
    path.write_text(text, encoding="utf-8")
    return read_log(path)


def only(tmp_path, text):
    (logged,) = read(tmp_path, text).values()
    return logged


def frames(count, *, step=0.01, since=0.0, ident="122"):
    return "".join(
        f"   {since + step * k:.6f} 1  {ident}  Rx   d 8 1 2 3 4 5 6 7 {k % 10}\n"
        for k in range(count)
    )


def test_relative_times_are_those_since_the_last_event(tmp_path):
    text = f"{DATE}base dec  timestamps relative\n" + (
        "   0.010000 1  290             Rx   d 8 1 2 3 4 5 6 7 255\n"
        "   0.004000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n"
        "   0.006000 1  290             Rx   d 8 1 2 3 4 5 6 7 0\n"
    )
    logged = only(tmp_path, text + frames(98, step=0.0, since=0.01, ident="290"))
    assert len(logged.ident) == 100
    assert set(np.diff(logged.received_ns)) == {10_000_000}
    assert set(logged.ident) == {290}
    assert logged.payload[0, 7] == 255


@pytest.mark.parametrize(
    "head",
    [
        f"{DATE}base hex  timestamps absolute\n",
        f"{DATE}base hex  no internal events logged\n// version 7.1.0\n",
        f"{DATE}base hex  timestamps absolute\ninternal events logged\n",
        HEAD,
        "",
    ],
)
def test_no_header_costs_a_frame(tmp_path, head):
    assert len(only(tmp_path, head + frames(5)).ident) == 5


def test_other_spellings_of_times_are_read(tmp_path):
    text = HEAD + frames(2, since=-0.5).replace("-0.4", "-0,4") + "2 1 122 Rx d 1 FF\n"
    logged = only(tmp_path, text)
    assert logged.received_ns.tolist() == [0, 10_000_000, 2_500_000_000]


def test_kinds_of_frames_in_lines_of_canfd(tmp_path):
    data = " ".join(f"{k:02x}" for k in range(12))
    rows = (
        f"0.1 CANFD 1 Rx 29a AAA_01 1 0 9 12 {data} {TAIL.format(flags='303000')}",
        f"0.2 CANFD 1 Rx 29b 0 0 2 2 11 22 {TAIL.format(flags='1000')}",
        f"0.3 CANFD 1 Rx 29c 0 0 2 2 11 22 {TAIL.format(flags='0')}",
        f"0.4 CANFD 1 Tx 50005x 0 0 5 0 {TAIL.format(flags='200010')}",
        f"0.5 CANFD 1 Rx 29d 0 0 0 0 {TAIL.format(flags='1000')}",
    )
    logged = only(tmp_path, HEAD + "\n".join(rows) + "\n")
    assert logged.flags.tolist() == [FD | BIT_RATE_SWITCH, FD, 0, EXTENDED | REMOTE, FD]
    assert logged.length.tolist() == [12, 2, 2, 5, 0]


def test_length_codes_of_fd_frames_are_hexadecimal_whatever_the_base(tmp_path):
    data = " ".join(map(str, range(24)))
    row = f"0.1 CANFD 1 Rx 666 1 0 c 24 {data} {TAIL.format(flags='303000')}\n"
    logged = only(tmp_path, HEAD.replace("hex", "dec") + row)
    assert logged.ident.tolist() == [666]
    assert logged.payload[0, :24].tolist() == list(range(24))


def test_error_frames_are_counted_apart_on_their_channel(tmp_path):
    more = (
        "   0.020000 1  ErrorFrame\n   0.021000 CANFD   2 Rx   ErrorFrame Not Acknowledge error\n"
    )
    channels = read(tmp_path, HEAD + frames(5) + more)
    assert {name: len(x.errors_ns) for name, x in channels.items()} == {"0": 1, "1": 1}
    assert len(channels["0"].ident) == 5


@pytest.mark.parametrize(
    ("row", "remark"),
    [
        ("0.3 1 122 TxRq d 2 1 2", "line 7: a request to send (TxRq), no frame: left out"),
        ("0.3 1 8C8 Rx d 2 1 2", "line 7: identifier 8C8 of a frame with 11 bits: left out"),
        ("0.3 1 122 Rx d 9 1 2 3 4 5 6 7 8 9", "line 7: 9 bytes in a classic frame: left out"),
        ("0.3 1 122 Rx d 8 1 2 3", "line 7: 3 of 8 bytes: left out"),
    ],
)
def test_a_frame_that_was_on_no_bus_is_left_out_with_a_word(tmp_path, row, remark):
    logged = only(tmp_path, f"{HEAD}{frames(2)}{row}\n{frames(2, since=0.4)}")
    assert len(logged.ident) == 4
    assert logged.remarks == (remark,)


def test_a_line_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(
        CanrollError, match=r"line 7: not a frame of an \.asc: '0\.3 1 122 Rx d 2 1 Z'"
    ):
        read(tmp_path, f"{HEAD}{frames(2)}0.3 1 122 Rx d 2 1 Z\n")


def test_two_logs_in_one_file_have_one_base(tmp_path):
    assert len(only(tmp_path, HEAD + frames(3) + HEAD + frames(3, since=1.0)).ident) == 6
    with pytest.raises(CanrollError, match="line 9: the base of the numbers changes"):
        read(tmp_path, HEAD + frames(3) + HEAD.replace("hex", "dec") + frames(3))


def test_a_last_line_that_was_being_written_is_left_out(tmp_path):
    logged = only(tmp_path, f"{HEAD}{frames(2)}0.3 1 122 Rx d 8 1 2 3 4 5 6 7 Z")
    assert len(logged.ident) == 2
    assert logged.remarks == ("line 7: the file is cut off within it: left out",)


def test_overload_frames_are_named(tmp_path):
    overload = "   0.005000 1  OverloadFrame\n"
    logged = only(tmp_path, HEAD + frames(1) + overload + overload + frames(3, since=0.01))
    assert len(logged.ident) == 4
    assert logged.remarks == ("line 6 and 1 more: an overload frame: left out",)


def test_a_log_without_any_frame_names_the_first_line_that_is_none(tmp_path):
    line = "   0.000000 Timestamp: 1714055256.0    ID: 18ff3127    X Rx    DL:  1    12\n"
    with pytest.raises(CanrollError, match=r"line 6: not a frame of an \.asc, as no other line is"):
        only(tmp_path, HEAD + "   0.000000 Start of measurement\n" + 3 * line)
