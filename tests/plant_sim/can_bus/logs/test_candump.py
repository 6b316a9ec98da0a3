"""What candump writes and prints, with and without its options."""

import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.traffic.log_reader import read_log
from canroll.plant_sim.can_bus.wire.frame import BIT_RATE_SWITCH, ERROR_STATE, EXTENDED, FD, REMOTE

LOGGED = "(10.0) can0 0A0#1122334455667788"
PRINTED = " (10.0)  can0  0A0   [8]  11 22 33 44 55 66 77 88"


def read(tmp_path, *lines, encoding="utf-8"):
    path = tmp_path / "log.log"
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return read_log(path)


@pytest.mark.parametrize(
    "line",
    [
        LOGGED,
        f"{LOGGED} R",
        f"{LOGGED}_F",
        "(10.0) can0 0A0#11.22.33.44.55.66.77.88",
        PRINTED,
        PRINTED.replace("[8]", "{F}"),
        PRINTED.replace("(10.0)", "(1970-01-01 00:00:10.000000)"),
        PRINTED.replace("can0 ", "can0  RX - - "),
        f"{PRINTED}   '.\"3DUfw.'",
    ],
)
def test_all_forms_of_a_frame(tmp_path, line):
    logged = read(tmp_path, line, "(11.5) can0 0A0#")["can0"]
    assert logged.ident.tolist() == [0xA0, 0xA0]
    assert logged.received_ns.tolist() == [0, 1_500_000_000]
    assert logged.length.tolist() == [8, 0]
    assert logged.payload[0, :8].tolist() == [0x11 * k for k in range(1, 9)]
    assert logged.flags.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("line", "flags", "length"),
    [
        ("(1.0) can0 0A0#R", REMOTE, 0),
        ("(1.0) can0 0A0#R5", REMOTE, 5),
        (" (1.0)  can0  0A0   [4]  remote request", REMOTE, 4),
        ("(1.0) can0 000000A0#11", EXTENDED, 1),
        (" (1.0)  can0  000000A0   [1]  11", EXTENDED, 1),
        ("(1.0) can0 0A0##01122", FD, 2),
        ("(1.0) can0 0A0##31122", FD | BIT_RATE_SWITCH, 2),
        ("(1.0) can0 0A0##71122", FD | BIT_RATE_SWITCH, 2),
        (" (1.0)  can0  0A0  [02]  11 22", FD, 2),
    ],
)
def test_kinds_of_frames(tmp_path, line, flags, length):
    logged = read(tmp_path, line)["can0"]
    assert logged.flags.tolist() == [flags]
    assert logged.length.tolist() == [length]
    assert ERROR_STATE & flags == 0


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_comments_and_marks_of_an_encoding_are_passed_over(tmp_path, encoding):
    lines = (
        "# my car",
        LOGGED,
        "",
        "\tprotocol-violation{{error-on-tx}{acknowledge-slot}}",
        LOGGED,
    )
    logged = read(tmp_path, *lines, encoding=encoding)["can0"]
    assert len(logged.ident) == 2
    assert logged.remarks == ()


def test_error_frames_are_counted_on_their_channel(tmp_path):
    errors = ("(10.1) can0 20000088#0000000000000000", "(10.2) can0 20000004#0004000000000000")
    shown = " (10.3)  can0  20000088   [8]  00 00 80 19 00 00 00 00   ERRORFRAME"
    channels = read(tmp_path, LOGGED, *errors, shown)
    assert list(channels) == ["can0"]
    assert len(channels["can0"].ident) == 1
    assert len(channels["can0"].errors_ns) == 3


@pytest.mark.parametrize(
    ("line", "remark"),
    [
        ("(10.1) can0 0A0#112233445566778899", "line 2: 9 bytes in a classic frame: left out"),
        ("(10.1) can0 FFF#00", "line 2: identifier FFF of a frame with 11 bits: left out"),
        ("(10.1) can0 0A0##1112233445566778899", "line 2: 9 bytes in an FD frame: left out"),
        ("(10.1) can0 00045123#81:00:12345678#11223344", "line 2: CAN XL: left out"),
    ],
)
def test_a_frame_that_was_on_no_bus_is_left_out_with_a_word(tmp_path, line, remark):
    logged = read(tmp_path, LOGGED, line, "(10.2) can0 0A0#11")["can0"]
    assert logged.length.tolist() == [8, 1]
    assert logged.remarks == (remark,)


def test_many_such_frames_are_one_remark(tmp_path):
    (remark,) = read(tmp_path, LOGGED, *["(10.1) can0 FFF#00"] * 3)["can0"].remarks
    assert remark == "line 2 and 2 more: identifier FFF of a frame with 11 bits: left out"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("(x) can0 0A0#11", r"line 2: not a time: '\(x\) can0 0A0#11'"),
        ("(1.0) can0 0A0#1", "line 2: not a line of candump"),
        ("(1.0) can0 0A0#zz", "line 2: not a line of candump"),
        (" (1.0)  can0  0A0   [8]  11 22", "line 2: 2 of 8 bytes"),
        ("  can0  0A0   [2]  11 22", "no times: record with 'candump -L'"),
        ("nonsense", "line 2: not a line of candump"),
    ],
)
def test_what_cannot_be_read_is_named_by_its_line(tmp_path, line, words):
    with pytest.raises(CanrollError, match=rf"log\.log: not a readable bus log: {words}"):
        read(tmp_path, LOGGED, line)


def test_what_candump_says_of_its_own_console_is_no_frame(tmp_path):
    logged = read(tmp_path, "", f"Warning: console output active while logging!{LOGGED}", LOGGED)
    assert logged["can0"].ident.tolist() == [0xA0, 0xA0]
