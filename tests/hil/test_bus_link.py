"""Buses: python-can on both sides of the plant's own, and one line for each that cannot be."""

import argparse
import errno
import socket
import time

import can
import pytest

from canroll.cli.hil import bus_options
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.hil import bus_link, own_bus
from canroll.hil.bus_link import EXTENDED
from canroll.hil.hardware.bus_options import explain
from canroll.hil.lockstep import GRANT as NOTE


def options(**given):
    return argparse.Namespace(**given)


@pytest.fixture
def plant_bus():
    bus = own_bus.serve("127.0.0.1:0")
    yield bus
    bus.close()


def connect(bus):
    host, port = bus.options.split("host=")[1].split(" port=")
    arguments = options(
        interface="socketcand", channel="plant", bus_kwargs={"host": host, "port": int(port)}
    )
    return bus_link.open_link(arguments)


def wait_for(receive, count):
    """Frames of ``receive`` until there are ``count``, or it has taken far too long."""
    frames = []
    until = time.monotonic() + 20
    while len(frames) < count and time.monotonic() < until:
        frames += receive()
        time.sleep(0.001)
    return frames


def wait_until(holds):
    """Return when ``holds()``; fail where it has taken far too long."""
    until = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_python_can_talks_to_the_plants_own_bus(plant_bus):
    ecu, onlooker = connect(plant_bus), connect(plant_bus)
    sent = [(0xA0 + k, bytes([k] * (k % 9))) for k in range(100)]
    for frame in sent:
        plant_bus.send(*frame)
    assert wait_for(ecu.receive, 100) == sent
    answers = [(0x80, bytes(range(k, k + 8))) for k in range(50)]
    for frame in answers:
        ecu.send(*frame)
    assert wait_for(plant_bus.receive, 50) == answers
    assert wait_for(onlooker.receive, 150) == sent + answers
    assert ecu.receive() == []
    assert (ecu.sent, ecu.received, ecu.failed, plant_bus.failed) == (50, 100, 0, 0)
    ecu.close()
    onlooker.close()


def test_a_server_that_comes_back_is_found_again(monkeypatch):
    monkeypatch.setattr(bus_link, "RETRY", 0.05)
    first = own_bus.serve("127.0.0.1:0")
    ecu = connect(first)
    address = first.options.split("host=")[1].replace(" port=", ":")
    first.close()
    for _ in range(20):
        ecu.send(0x80, bytes(8))
        time.sleep(0.02)
    assert ecu.failed > 0
    again = own_bus.serve(address)
    until = time.monotonic() + 20
    heard = []
    while not heard and time.monotonic() < until:
        ecu.receive()
        ecu.send(0x80, b"\x01")
        heard = again.receive()
        time.sleep(0.02)
    assert (0x80, b"\x01") in heard
    ecu.close()
    again.close()


def test_who_only_listens_finds_a_server_that_comes_back(monkeypatch):
    monkeypatch.setattr(bus_link, "RETRY", 0.05)
    first = own_bus.serve("127.0.0.1:0")
    onlooker = connect(first)
    address = first.options.split("host=")[1].replace(" port=", ":")
    assert onlooker.receive() == []
    assert not onlooker.lost
    first.close()
    wait_until(lambda: onlooker.receive() == [] and onlooker.lost)
    again = own_bus.serve(address)
    wait_until(lambda: onlooker.receive() == [] and not onlooker.lost)

    def heard():
        again.send(0xA0, b"\x01")
        return (0xA0, b"\x01") in onlooker.receive()

    wait_until(heard)
    onlooker.close()
    again.close()


def test_only_data_frames_count_and_no_notes_of_lock_step():
    with can.Bus("realtime-test", interface="virtual") as far:
        near = bus_link.CanLink(can.Bus("realtime-test", interface="virtual"))
        for changes in (
            {"arbitration_id": NOTE & ~EXTENDED},
            {"is_remote_frame": True, "is_extended_id": False, "dlc": 8},
            {"is_error_frame": True, "is_extended_id": False},
        ):
            far.send(can.Message(**{"arbitration_id": 0xA0, **changes}))
        far.send(can.Message(arbitration_id=0xA0, data=b"\x01"))
        far.send(can.Message(arbitration_id=0xA0, is_extended_id=False, data=b"\x07"))
        assert near.receive() == [(0xA0 | EXTENDED, b"\x01"), (0xA0, b"\x07")]
        assert near.received == 2
        near.close()


def test_what_an_interface_gives_back_like_frames_of_others_is_dropped_as_often_as_sent():
    with can.Bus("given-back", interface="virtual") as far:
        bus = can.Bus("given-back", interface="virtual", receive_own_messages=True)
        near = bus_link.CanLink(bus, unmarked=True)
        near.send(0xA0, b"\x01")
        near.send(0xA0, b"\x01")
        near.send(0xA0 | EXTENDED, b"\x02")
        for payload in (b"\x01", b"\x03"):
            far.send(can.Message(arbitration_id=0xA0, is_extended_id=False, data=payload))
        assert near.receive() == [(0xA0, b"\x01"), (0xA0, b"\x03")]
        near.close()


@pytest.mark.parametrize(
    ("error", "mends"),
    [
        (OSError(errno.ENODEV, "No such device"), "ip link add dev vcan0 type vcan"),
        (OSError(errno.EAFNOSUPPORT, "not supported"), "modprobe -a can_raw vcan"),
        (OSError(errno.EPROTONOSUPPORT, "not supported"), "scripts/vcan-vm"),
        (OSError(errno.EPERM, "not permitted"), "root"),
        (can.CanInterfaceNotImplementedError("x"), "needs Linux, and the interface up"),
        (ValueError("no such thing\nat all"), "no such thing"),
    ],
)
def test_why_a_bus_does_not_open_is_one_line(error, mends):
    line = explain(error, options(interface="socketcan", channel="vcan0"))
    assert mends in line
    assert "\n" not in line


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["ecu", "-i", "socketcan", "-c", "nosuch0"], "--calibration FILE is required"),
        (["ecu", "--calibration", "nosuch.toml"], "cannot read calibration"),
        (["watch", "-i", "socketcand", "-c", "plant"], "host=127.0.0.1"),
        (["watch", "--duration", "-1"], "must be at least 0"),
        (["plant", "nosuch"], "unknown scenario"),
        (["plant", "double_lane_change", "--actuator", "bras"], "did you mean 'bars'?"),
        (["plant", "double_lane_change", "--serve", "here"], "HOST:PORT"),
        (["plant", "double_lane_change", "--wait", "0", "--signals", "a.txt"], ".csv, .mf4"),
        (["hil", "nosuch"], "unknown scenario"),
        (["hil", "double_lane_change", "-i", "virtual", "-c", "x"], "within one process"),
        (
            [
                "hil",
                "double_lane_change",
                "-i",
                "socketcan",
                "-c",
                "x",
                "--timing",
                "f_clock=8000000",
                "brp=1",
                "tseg1=13",
                "tseg2=2",
                "sjw=1",
                "nof_samples=1",
            ],
            "--timing applies to one program",
        ),
        (["hil", "double_lane_change", "--serve", "a:1", "-i", "socketcan"], "omit -i"),
        (["ecu", "--replay", "nosuch.npz"], "cannot read"),
        (["hil"], "required"),
    ],
)
def test_what_a_user_can_get_wrong_is_one_line(arguments, says, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_a_missing_can_interface_is_told_with_what_mends_it(capsys, calibration_file):
    """Whether the kernel lacks CAN or only the interface, a command is named."""
    command = ["ecu", "-i", "socketcan", "-c", "nosuch0", "--calibration", str(calibration_file)]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "ip link add dev nosuch0" in error or "modprobe" in error
    assert error.count("\n") == 1


def test_a_server_that_is_not_there(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    bus = ["-i", "socketcand", "-c", "plant", "--bus-kwargs", "host=127.0.0.1", f"port={port}"]
    assert main(["watch", *bus]) == 2
    error = capsys.readouterr().err
    assert "canroll plant" in error
    assert error.count("\n") == 1


def test_both_programs_get_the_bus_that_was_asked_for(monkeypatch):
    given = options(
        interface="socketcand", channel="c", bus_kwargs={"host": "h", "port": 7}, serve=None
    )
    expected = ["--interface", "socketcand", "--channel", "c", "--bus-kwargs", "host=h", "port=7"]
    assert bus_options(given) == expected
    assert bus_options(options(serve=None)) == []
    monkeypatch.setenv("CAN_INTERFACE", "socketcan")
    monkeypatch.setenv("CAN_CHANNEL", "vcan3")
    assert bus_options(options(serve=None)) == ["--interface", "socketcan", "--channel", "vcan3"]


def test_a_taken_address_is_refused():
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(CanrollError, match="choose another"),
    ):
        own_bus.serve(f"127.0.0.1:{taken.getsockname()[1]}")
