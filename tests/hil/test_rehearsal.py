"""Hardware rehearsed: a serial adapter on a pseudo-terminal, and a socketcand peer.

The far side of the adapter is python-can's own socketcand client on the plant's server.
"""

import argparse
import re
import signal
import time

import can
import numpy as np
import pytest
from support.slcan_adapter import SlcanAdapter, line_of

from canroll.firmware.com.signals import TX_IDS
from canroll.hil import bus_link, tick_trace
from canroll.hil.bus_link import EXTENDED
from canroll.hil.hardware import bus_record

pytest.importorskip("serial", reason="needs pyserial")

PATIENCE = 1800.0
OPENING = 5
"""Commands of python-can to set the bit rate and open the channel."""


@pytest.fixture
def far():
    with can.Bus("rehearsal", interface="virtual") as bus:
        yield bus


@pytest.fixture
def adapter():
    with can.Bus("rehearsal", interface="virtual") as behind:
        plugged = SlcanAdapter(behind)
        yield plugged
        plugged.close()


@pytest.fixture
def link(adapter):
    opened = bus_link.open_link(
        argparse.Namespace(
            interface="slcan",
            channel=adapter.port,
            bitrate=500_000,
            bus_kwargs={"sleep_after_open": 0},
        )
    )
    wait_until(lambda: adapter.answered == OPENING)
    yield opened
    opened.close()


def wait_until(true):
    until = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < until
        time.sleep(0.001)


def test_the_adapter_is_set_up_as_its_options_say(adapter, link):
    assert adapter.bitrate == 500_000
    assert adapter.refused == []


def test_frames_go_both_ways(far, link):
    frames = [(0x80 + k, bytes(range(k % 9))) for k in range(40)]
    for frame in frames:
        link.send(*frame)
    heard = []
    for _ in frames:
        message = far.recv(PATIENCE)
        heard.append((message.arbitration_id, bytes(message.data)))
    assert heard == frames
    for ident, payload in frames:
        far.send(can.Message(arbitration_id=ident, data=payload, is_extended_id=False))
    far.send(can.Message(arbitration_id=0x1ABCDEF0, data=b"\x01"))
    far.send(can.Message(arbitration_id=0x100, is_remote_frame=True, is_extended_id=False, dlc=4))
    far.send(can.Message(arbitration_id=0x7FF, is_extended_id=False))
    heard = []
    wait_until(lambda: heard.extend(link.receive()) or (0x7FF, b"") in heard)
    assert heard == [*frames, (0x1ABCDEF0 | EXTENDED, b"\x01"), (0x7FF, b"")]
    assert (link.sent, link.received, link.failed) == (40, 42, 0)


def test_an_acknowledgement_hides_no_frame_behind_it(adapter, link):
    """The adapter answers each frame that is sent; python-can reads the answer as silence."""
    link.receive()
    serial = link.bus.serialPortOrig
    wait_until(lambda: not serial.in_waiting or link.receive())
    frames = [can.Message(arbitration_id=k, data=[k], is_extended_id=False) for k in (1, 2)]
    lines = b"z\r" + line_of(frames[0]) + b"z\rZ\r\a" + line_of(frames[1])
    adapter.write(lines)
    wait_until(lambda: serial.in_waiting >= len(lines))
    assert link.receive() == [(1, b"\x01"), (2, b"\x02")]


def test_half_a_line_waits_for_its_end(adapter, link):
    adapter.write(b"t0A02")
    wait_until(lambda: link.bus.serialPortOrig.in_waiting or link.receive() == [])
    assert link.receive() == []
    adapter.write(b"0102\r")
    assert link.next(PATIENCE) == (0xA0, b"\x01\x02")


def test_what_the_adapter_cannot_do_is_one_line(adapter):
    options = argparse.Namespace(interface="slcan", channel=adapter.port, bitrate=123)
    with pytest.raises(bus_link.CanrollError, match=r"Invalid bitrate.*500000") as raised:
        bus_link.open_link(options)
    assert "\n" not in str(raised.value)


def driven(programs, calibration, folder, name, bus_of):
    """Drive in lock step with the ECU on the bus that ``bus_of`` makes of the plant's."""
    plant = programs(
        "plant", "plant", "double_lane_change", "--serve", "127.0.0.1:0",
        "--pace", "lockstep", "--duration", 1.5,
    )  # fmt: skip
    plant.wait_for("plant waits")
    host, port = re.search(r"serving .* host=(\S+) port=(\d+)", plant.said).groups()
    trace = folder / f"{name}.npz"
    ecu = programs(
        "ecu", "ecu", "--calibration", calibration, "--pace", "lockstep",
        "--trace", trace, *bus_of(host, int(port)),
    )  # fmt: skip
    assert plant.end() == 0, plant.said
    assert ecu.end() == 0, ecu.said
    return tick_trace.load(trace)


@pytest.mark.slow
def test_an_ecu_behind_an_adapter_sends_what_it_sends_on_the_bus(
    programs, calibration_file, tmp_path
):
    plugged = []

    def direct(host, port):
        server = ["--bus-kwargs", f"host={host}", f"port={port}"]
        return ["-i", "socketcand", "-c", "plant", *server]

    def behind(host, port):
        bus = can.Bus("plant", interface="socketcand", host=host, port=port)
        plugged.append((SlcanAdapter(bus), bus))
        options = ["--bus-kwargs", "sleep_after_open=0"]
        return ["-i", "slcan", "-c", plugged[0][0].port, "-b", "500000", *options]

    try:
        serial = driven(programs, calibration_file, tmp_path, "serial", behind)
    finally:
        for adapter, bus in plugged:
            adapter.close()
            bus.shutdown()
    network = driven(programs, calibration_file, tmp_path, "network", direct)
    assert len(network.ticks) == 150
    assert np.array_equal(serial.ticks["number"], network.ticks["number"])
    assert serial.frames.tobytes() == network.frames.tobytes()
    for trace, clock in ((serial, "this machine's"), (network, "CLOCK_REALTIME of the server")):
        figures = bus_record.summary(trace.bus, trace.about["bus"])
        assert figures["clock"].startswith(clock)
        assert figures["error_frames"] == 0
        sent = trace.bus[trace.bus["flags"] == bus_record.SENT]
        # after the last tick comes the command of nothing
        ours = trace.frames[trace.frames["sent"] == 1]
        assert sent["ident"].tolist()[: len(ours)] == ours["ident"].tolist()


@pytest.mark.long
def test_an_ecu_behind_an_adapter_and_a_plant_beyond_it(programs, calibration_file, tmp_path):
    """Whatever the machine's pace: what one side sends, a witness sees and the other side gets."""
    plant = programs("plant", "plant", "double_lane_change", "--serve", "127.0.0.1:0",
                     "--duration", 2, "--peer-timeout", 0)  # fmt: skip
    plant.wait_for("plant waits")
    host, port = re.search(r"serving .* host=(\S+) port=(\d+)", plant.said).groups()
    server = {"interface": "socketcand", "host": host, "port": int(port)}
    trace, seen = tmp_path / "ticks.npz", []
    with can.Bus("plant", **server) as behind, can.Bus("plant", **server) as witness:
        adapter = SlcanAdapter(behind)
        try:
            ecu = programs(
                "ecu", "ecu", "--calibration", calibration_file, "--trace", trace,
                "-i", "slcan", "-c", adapter.port, "-b", "500000", "--peer-timeout", "0",
                "--bus-kwargs", "sleep_after_open=0",
            )  # fmt: skip
            while plant.process.poll() is None:
                seen += all_of(witness)
            assert plant.end() == 0, plant.said
            ecu.process.send_signal(signal.SIGTERM)
            assert ecu.end() == 0, ecu.said
        finally:
            adapter.close()
    recorded = tick_trace.load(trace)
    assert tick_trace.replay(recorded, "python").difference is None
    ours = recorded.frames[recorded.frames["sent"] == 1]
    sent = list(zip(ours["ident"].tolist(), map(bytes, ours["payload"]), strict=True))
    theirs = [f for f in seen if f[0] in TX_IDS]
    assert len(theirs) > 10
    assert theirs == [(ident, data[: len(theirs[k][1])]) for k, (ident, data) in
                      enumerate(sent[: len(theirs)])]  # fmt: skip
    got = recorded.frames[recorded.frames["sent"] == 0]
    assert len(got) > 10
    plants = {f for f in seen if f[0] not in TX_IDS}
    assert {(int(f["ident"]), bytes(f["payload"][: f["length"]])) for f in got} <= plants
    figures = bus_record.summary(recorded.bus, recorded.about["bus"])
    assert figures["clock"].startswith("this machine's")
    assert figures["error_frames"] == 0
    assert figures["load"] > 0


def all_of(bus):
    """What waits on a bus, and what comes within a moment."""
    found = []
    while (message := bus.recv(0.05)) is not None:
        found.append((message.arbitration_id, bytes(message.data)))
    return found
