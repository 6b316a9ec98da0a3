"""Interfaces to real buses: what each needs, whose clock it has, its errors and its load."""

import argparse
import re
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canroll.cli.main import main
from canroll.hil import bus_link, timing, timing_rows
from canroll.hil.hardware import bus_options, bus_record, error_frames, interfaces
from canroll.hil.hardware.bus_record import ENTRY, ERROR, SENT, BusRecord, RecordOrigin
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, FD, REMOTE, length_of

MS = 1_000_000
KERNEL = RecordOrigin("socketcan can0", interfaces.KERNEL, True, 500_000, True)
PAGE = (Path(__file__).parents[2] / "docs" / "realtime.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", interfaces.INTERFACES)
def test_the_page_has_every_interface_as_the_program_says_it(name):
    known = interfaces.INTERFACES[name]
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| {name} |"))
    assert f"`{known.options}`" in row
    assert known.clock in row


@pytest.mark.parametrize("name", interfaces.INTERFACES)
def test_the_options_of_the_page_are_those_of_python_can(name):
    parser = argparse.ArgumentParser()
    bus_options.add_bus_arguments(parser)
    given = parser.parse_args(interfaces.INTERFACES[name].options.split())
    found, channel, _, kwargs = bus_options.options_of(given)
    assert found == name
    assert channel
    interfaces.arguments_for(*bus_options.options_of(given))
    assert set(kwargs) <= {"app_name", "host", "port"}


@pytest.mark.parametrize(
    ("bus", "says"),
    [
        (["-i", "pcan", "-c", "PCAN_USBBUS1", "-b", "500000"], "needs PEAK's driver"),
        (["-i", "kvaser", "-c", "0", "-b", "500000"], "needs Kvaser's driver with CANlib"),
        (["-i", "vector", "-c", "0", "--bus-kwargs", "app_name=x"], "needs Windows"),
        (["-i", "gs_usb", "-c", "0", "-b", "500000"], "python-can[gs-usb]"),
        (["-i", "gs_usb", "-c", "canable", "-b", "500000"], "counts its adapters from 0"),
        (["-i", "pcan", "-c", "PCAN_USBBUS1", "-b", "400000"], "-b 400000: pcan supports 5000, "),
        (["-i", "slcan", "-c", "/dev/nosuch", "-b", "500000"], "is it plugged in?"),
        (["-i", "ixxat", "-c", "0"], "its own package or driver"),
    ],
)
def test_an_adapter_that_is_not_there_is_one_line(bus, says, capsys):
    """None of these drivers is installed where the tests run; where one is, the adapter isn't."""
    assert main(["watch", "--duration", "1", *bus]) == 2
    error = capsys.readouterr().err
    assert says in error or "is it plugged in?" in error
    assert error.count("\n") == 1


def test_a_serial_adapter_without_pyserial_says_what_to_install():
    error = can.CanInterfaceNotImplementedError("The serial module is not installed")
    line = bus_options.explain(error, argparse.Namespace(interface="slcan", channel="/dev/ttyACM0"))
    assert "pip install 'python-can[serial]'" in line


@pytest.mark.parametrize("name", ["slcan", "pcan", "gs_usb"])
def test_two_programs_do_not_share_an_adapter(name, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["hil", "double_lane_change", "-i", name, "-c", "0"]) == 2
    error = capsys.readouterr().err
    assert "an adapter each" in error
    assert error.count("\n") == 1


def test_gs_usb_is_given_a_number_for_its_index():
    assert interfaces.arguments_for("gs_usb", "1", 500_000, {}) == {"index": 1}
    assert interfaces.arguments_for("gs_usb", "can", None, {"bus": 1, "address": 2}) == {}


@pytest.mark.parametrize(
    ("ident", "data", "names"),
    [
        (0x001, "", {"transmit timeout"}),
        (0x002, "05", {"lost arbitration"}),
        (0x040, "", {"bus off"}),
        (0x100, "", {"controller restarted"}),
        (0x004, "0001", {"receive overflow"}),
        (0x004, "0030", {"error passive"}),
        (0x004, "000C", {"error warning"}),
        (0x004, "0040", {"error active again"}),
        (0x004, "0000", {"controller"}),
        (0x008, "00000480", {"stuff error"}),
        (0x008, "00008000", {"protocol violation"}),
        (0x0A8, "00000110", {"no acknowledgement", "bus error", "bit error"}),
        (0x200, "0000000000008080", {"error counters"}),
        (0x204, "0010000000008080", {"error passive"}),
        (0x000, "", {"unclassified"}),
    ],
)
def test_an_error_frame_in_words(ident, data, names):
    assert error_frames.names(ident, bytes.fromhex(data)) == names


@given(st.lists(st.tuples(st.integers(0, 0x3FF), st.binary(max_size=8))))
def test_every_error_frame_counts(frames):
    counted = error_frames.count(frames, classified=True)
    assert sum(counted.values()) >= len(frames)
    unknown = error_frames.count(frames, classified=False)
    assert unknown == ({error_frames.UNCLASSIFIED: len(frames)} if frames else {})


def entries(rows):
    found = np.zeros(len(rows), ENTRY)
    for entry, row in zip(found, rows, strict=True):
        for name, value in row.items():
            if name == "payload":
                entry["length"] = len(value)
                entry["payload"][: len(value)] = list(value)
            else:
                entry[name] = value
    return found


def about(**changes):
    return {
        "interface": "socketcan can0",
        "clock": interfaces.KERNEL,
        "comparable": True,
        "bitrate": 500_000,
        "classified": True,
        "offsets_ns": [1000 * MS, 1000 * MS],
        "real_time": True,
        "full": False,
        **changes,
    }


def test_what_a_record_is_given_it_gives_back():
    record = BusRecord(KERNEL, room=4)
    data = {"arbitration_id": 0xA0, "data": b"\x01\x02", "timestamp": 1.5}
    record.heard(can.Message(**data, is_extended_id=False))
    record.heard(can.Message(**data, is_error_frame=True))
    record.heard(can.Message(arbitration_id=1, is_remote_frame=True, dlc=3))
    record.sent(0x80, bytes(8), extended=False)
    found = record.entries()
    assert found["flags"].tolist() == [0, EXTENDED | ERROR, EXTENDED | REMOTE, SENT]
    assert found["ident"].tolist() == [0xA0, 0xA0, 1, 0x80]
    assert found["length"].tolist() == [2, 2, 3, 8]
    assert found["stamp_ns"].tolist() == [1_500_000_000, 1_500_000_000, 0, 0]
    assert np.all(np.diff(found["read_ns"]) >= 0)
    assert not record.full
    record.sent(0x80, bytes(8), extended=False)
    assert record.full
    assert record.entries().tobytes() == found.tobytes()


def test_only_this_machine_reaches_loopback():
    assert all(map(interfaces.is_loopback, ("127.0.0.1", "127.8.8.8", "::1", "localhost")))
    assert not any(map(interfaces.is_loopback, ("0.0.0.0", "::", "192.168.1.7", "bench7", "")))


def test_the_load_is_that_of_the_bits_seen():
    rows = [
        {"read_ns": 0, "ident": 0xA0, "payload": bytes(8)},
        {"read_ns": MS, "ident": 0x80, "payload": b"\x55" * 8, "flags": SENT},
        {"read_ns": 2 * MS, "ident": 0x123, "payload": b"\x55" * 8, "flags": ERROR},
        {"read_ns": 4 * MS, "ident": 0x1234567, "payload": b"", "flags": EXTENDED},
    ]
    found = entries(rows)
    total = (
        length_of(0xA0, bytes(8))[0]
        + length_of(0x80, b"\x55" * 8)[0]
        + length_of(0x1234567, b"", EXTENDED)[0]
    )
    assert bus_record.bits(found) == total
    assert bus_record.load(found, about()) == (pytest.approx(total / 2000), None)
    assert bus_record.load(found, about(bitrate=None)) == (None, "without -b")
    assert bus_record.load(found, about(real_time=False)) == (None, "in lock step")
    assert bus_record.load(found[:1], about()) == (None, "of so few frames")
    found["flags"][0] = FD
    assert bus_record.bits(found) is None
    assert bus_record.load(found, about()) == (None, "with FD frames")


WAITED = [
    {"read_ns": 10 * MS, "stamp_ns": 1009 * MS, "ident": 1},
    {"read_ns": 20 * MS, "stamp_ns": 1017 * MS, "ident": 1},
    {"read_ns": 30 * MS, "stamp_ns": 0, "ident": 1},
    {"read_ns": 40 * MS, "stamp_ns": 1000 * MS, "ident": 1, "flags": ERROR},
    {"read_ns": 50 * MS, "ident": 1, "flags": SENT},
]


def test_how_long_frames_wait_is_measured_by_a_clock_that_can_be_compared():
    waits, missing = bus_record.waits_ns(entries(WAITED), about())
    assert waits.tolist() == [MS, 3 * MS]
    assert missing is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"comparable": False, "clock": "the adapter's own"}, "the clock is the adapter's own"),
        ({"real_time": False}, "in lock step"),
        ({"offsets_ns": [0, 2 * MS]}, "the wall clock was set during the run"),
    ],
)
def test_stamps_of_a_clock_that_cannot_be_compared_are_not_used(changes, why):
    waits, missing = bus_record.waits_ns(entries(WAITED), about(**changes))
    assert len(waits) == 0
    assert missing == why


def test_what_was_seen_of_the_bus_is_said_in_a_line():
    found = entries([*WAITED, {"read_ns": 60 * MS, "ident": 0x40, "flags": ERROR}])
    figures = timing.bus_figures(found, about())
    assert (figures["frames"], figures["error_frames"]) == (4, 2)
    assert figures["errors"] == {"bus off": 1, "transmit timeout": 1}
    [line] = timing_rows.bus_lines({"bus": {"ecu": figures, "plant": None}})
    assert "2 error frames (bus off 1, transmit timeout 1)" in line
    assert re.search(r"load \d+\.\d % of 500 kbit/s", line)
    assert interfaces.KERNEL in line
    unknown = timing.bus_figures(found, about(bitrate=None, comparable=False))
    [line] = timing_rows.bus_lines({"bus": {"ecu": unknown, "plant": None}})
    assert "load unknown without -b" in line
    assert "no wait at the interface" in line


class Adapter:
    """A bus of python-can's that gives back what is sent."""

    def __init__(self):
        self.waiting = []

    def recv(self, timeout):
        return self.waiting.pop(0) if self.waiting else None

    def send(self, message):
        self.waiting.append(can.Message(arbitration_id=message.arbitration_id, is_rx=False))

    def shutdown(self):
        pass


def test_what_an_adapter_gives_back_is_not_heard():
    record = BusRecord(KERNEL, room=9)
    link = bus_link.CanLink(Adapter(), record=record, echoes=True)
    link.send(0x80, b"")
    link.bus.waiting.append(can.Message(arbitration_id=0xA0, is_extended_id=False))
    assert link.receive() == [(0xA0, b"")]
    assert link.received == 1
    assert record.entries()["flags"].tolist() == [SENT, 0]
