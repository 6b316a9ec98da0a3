"""Binary logs of Vector: every object is counted, and the end of a file that was cut off."""

import struct

import can
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.traffic.log_reader import read_log

MS = 1_000_000
FRAME, ERROR, FD_ERROR, STATISTIC = 1, 2, 104, 4


def item(kind, body, time_ns):
    size = 32 + len(body)
    head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, size, kind, 2, 0, 0, time_ns)
    return (head + body).ljust(size + size % 4, b"\0")


def frame(time_ns, *, ident=0x123):
    return item(FRAME, struct.pack("<HBBL8s", 1, 0, 8, ident, bytes(8)), time_ns)


def blf(path, *items, count=None, start=144):
    data = b"".join(items)
    box = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(data), 10, 0, len(data)) + data
    box += bytes(len(box) % 4)
    stated = len(items) if count is None else count
    sizes = 144 + len(box), 144 + len(data), stated, 0
    head = struct.pack("<4sL8BQQLL16H", b"LOGG", start, 5, 0, 0, 0, 2, 6, 8, 1, *sizes, *[0] * 16)
    path.write_bytes(head.ljust(144, b"\0") + box)
    return path


def test_error_frames_that_python_can_does_not_read_are_counted(tmp_path):
    errors = [
        item(ERROR, struct.pack("<HHL", 1, 0, 0), 1000 * MS),
        item(FD_ERROR, b"\x01".ljust(56, b"\0"), 1010 * MS),
    ]
    other = item(STATISTIC, bytes(24), 1020 * MS)
    frames = [frame(10 * MS * k) for k in range(100)]
    logged = read_log(blf(tmp_path / "log.blf", *frames, *errors, other))["0"]
    assert len(logged.ident) == 100
    assert logged.errors_ns.tolist() == [1000 * MS, 1010 * MS]
    assert logged.remarks == ()


def test_objects_that_the_header_counts_and_are_not_there_are_remarked(tmp_path):
    path = blf(tmp_path / "log.blf", *(frame(MS * k) for k in range(10)), count=12)
    assert read_log(path)["0"].remarks == ("the header counts 12 objects, 10 are there",)


def test_a_log_whose_header_was_never_completed_is_no_wonder(tmp_path):
    path = blf(tmp_path / "log.blf", frame(0), count=0)
    assert read_log(path)["0"].remarks == ()


def test_an_impossible_frame_is_left_out(tmp_path):
    path = blf(tmp_path / "log.blf", frame(0), frame(MS, ident=0x800))
    logged = read_log(path)["0"]
    assert logged.remarks == ("frame 2: identifier 800 of a frame with 11 bits: left out",)


@pytest.mark.parametrize("size", [300, 20_000, 60_000])
def test_a_file_that_is_cut_off_is_read_to_its_end_with_a_word(tmp_path, size):
    path = tmp_path / "log.blf"
    with can.Logger(str(path)) as logger:
        for k in range(20_000):
            data = (k * 2654435761 % 2**64).to_bytes(8, "little")
            logger(can.Message(1e-3 * k, 0x80 + k % 97, is_extended_id=False, data=data, channel=0))
    content = path.read_bytes()
    assert len(read_log(path)["0"].ident) == 20_000
    assert len(content) > 70_000
    path.write_bytes(content[:size])
    (logged,) = read_log(path).values()
    assert 0 < len(logged.ident) < 20_000
    assert logged.remarks == ("the file is cut off: its last frames are missing",)


def test_damage_within_a_file_is_refused(tmp_path):
    path = blf(tmp_path / "log.blf", *(frame(MS * k) for k in range(10)))
    content = bytearray(path.read_bytes())
    content[144 + 32 + 48 * 4 : 144 + 32 + 48 * 4 + 12] = bytes(12)
    path.write_bytes(content)
    with pytest.raises(CanrollError, match="damaged, or not a BLF: what is behind its object 4"):
        read_log(path)


def test_objects_outside_of_containers_are_read(tmp_path):
    within, loose = [frame(MS * k) for k in range(5)], [frame(MS * k) for k in range(5, 8)]
    path = blf(tmp_path / "log.blf", *within, count=8)
    path.write_bytes(path.read_bytes() + b"".join(loose))
    logged = read_log(path)["0"]
    assert logged.received_ns.tolist() == [MS * k for k in range(8)]
    assert logged.remarks == ()


def test_an_object_of_another_version_is_counted_without_the_words_of_python_can(tmp_path, capfd):
    foreign = bytearray(frame(MS))
    foreign[6:8] = bytes(2)
    path = blf(tmp_path / "log.blf", frame(0), foreign, frame(2 * MS))
    logged = read_log(path)["0"]
    assert logged.received_ns.tolist() == [0, 2 * MS]
    assert logged.remarks == ("3 frames are there, 2 can be read",)
    assert capfd.readouterr().err == ""
