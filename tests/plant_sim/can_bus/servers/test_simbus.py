"""The python-can interface: several nodes in one process, in virtual and in wall-clock time."""

import threading
from itertools import pairwise

import can
import cantools
import pytest

import dbc
from plant_sim.can_bus.servers.simbus import SimBus


@pytest.fixture
def buses():
    opened = []

    def open_bus(channel="test", **options):
        opened.append(can.Bus(channel, interface="simbus", **options))
        return opened[-1]

    yield open_bus
    for bus in opened:
        bus.shutdown()


def frame(ident, data=b"", **options):
    return can.Message(arbitration_id=ident, data=data, is_extended_id=False, **options)


def test_the_plugin_is_registered(buses):
    assert "simbus" in can.VALID_INTERFACES
    assert isinstance(buses(virtual_time=True), SimBus)


def test_virtual_time_takes_as_long_as_the_frames(buses):
    one, two = buses(bitrate=500_000, virtual_time=True), buses()
    for ident in (0x300, 0x100, 0x200):
        one.send(frame(ident, bytes(8)))
    received = [two.recv(1.0) for _ in range(3)]
    # all three are queued when the bus is free: the lowest identifier goes first
    assert [m.arbitration_id for m in received] == [0x100, 0x200, 0x300]
    gaps = [b.timestamp - a.timestamp for a, b in pairwise(received)]
    assert all(111 * 2e-6 <= gap <= 135 * 2e-6 for gap in gaps)
    assert two.recv(0.5) is None
    assert two.hub.now_ns() == pytest.approx((received[-1].timestamp + 0.5) * 1e9, abs=1e3)


def test_virtual_time_is_deterministic(buses):
    def record(channel):
        one = buses(channel, virtual_time=True, traffic=str(dbc.PATH), seed=4)
        messages = [one.recv(1.0) for _ in range(200)]
        return [(m.timestamp, m.arbitration_id, bytes(m.data)) for m in messages]

    assert record("first") == record("second")


def test_every_kind_of_frame_arrives_as_it_was_sent(buses):
    one = buses(bitrate=500_000, data_bitrate=2_000_000, fd=True, virtual_time=True)
    two = buses(fd=True)
    sent = [
        frame(0x10, b"\x01\x02"),
        can.Message(arbitration_id=0x1ABCDEF0, data=b"abc", is_extended_id=True),
        frame(0x11, is_remote_frame=True, dlc=5),
        frame(0x12, bytes(range(64)), is_fd=True, bitrate_switch=True),
    ]
    for message in sent:
        one.send(message)
    received = {m.arbitration_id: m for m in (two.recv(1.0) for _ in sent)}
    for message in sent:
        assert received[message.arbitration_id].equals(
            message, timestamp_delta=None, check_channel=False, check_direction=False
        )
        assert received[message.arbitration_id].is_rx


def test_own_frames_come_back_only_when_asked_for(buses):
    one, two = buses(virtual_time=True, receive_own_messages=True), buses()
    one.send(frame(0x1))
    assert not one.recv(0.1).is_rx
    assert two.recv(0.1).is_rx
    two.send(frame(0x2))
    assert one.recv(0.1).arbitration_id == 2
    assert two.recv(0.1) is None


def test_filters_and_cantools_work_on_it(buses):
    one, two = buses(virtual_time=True), buses()
    imu = dbc.load().get_message_by_name("Imu")
    two.set_filters([{"can_id": imu.frame_id, "can_mask": 0x7FF}])
    one.send(frame(0x10))
    one.send(frame(imu.frame_id, bytes(range(8))))
    message = two.recv(0.1)
    assert isinstance(imu, cantools.database.can.Message)
    assert imu.decode(message.data)["Counter"] == 1


def test_alone_a_node_becomes_passive_and_keeps_trying(buses):
    one = buses(virtual_time=True)
    one.send(frame(0x1))
    one.let_pass(0.5)
    assert one.state == can.BusState.PASSIVE
    two = buses()
    assert two.recv(0.1).arbitration_id == 1


def test_error_frames_are_reported(buses):
    one, two = buses(virtual_time=True, bit_error_rate=2e-3, seed=1), buses()
    for _ in range(20):
        one.send(frame(0x100, bytes(8)))
    seen = [two.recv(0.1) for _ in range(30)]
    assert any(m.is_error_frame for m in seen if m is not None)
    good = [m for m in seen if m is not None and not m.is_error_frame]
    assert all(bytes(m.data) == bytes(8) for m in good)


def test_full_queues_and_closed_buses_raise(buses):
    one, two = buses(virtual_time=True), buses()
    with pytest.raises(can.CanOperationError, match="full"):
        for _ in range(1000):
            one.send(frame(0x100, bytes(8)))
    one.send(frame(0x101), timeout=1.0)
    two.shutdown()
    with pytest.raises(can.CanOperationError, match="shut down"):
        two.send(frame(1))
    with pytest.raises(can.CanOperationError, match="shut down"):
        two.recv(0.0)
    with pytest.raises(can.CanOperationError, match="error frames"):
        one.send(can.Message(is_error_frame=True))


def test_impossible_frames_are_refused(buses):
    one = buses(virtual_time=True)
    for message in (
        can.Message(arbitration_id=0x800, is_extended_id=False, check=False),
        can.Message(arbitration_id=0x1, is_extended_id=False, data=bytes(8), dlc=200, check=False),
        can.Message(arbitration_id=0x1, is_extended_id=False, data=bytes(2), dlc=200, check=False),
    ):
        with pytest.raises(can.CanOperationError):
            one.send(message)


def test_settings_must_agree(buses):
    buses(bitrate=500_000)
    with pytest.raises(can.CanInitializationError, match="bitrate=500000"):
        SimBus("test", bitrate=250_000)
    with pytest.raises(can.CanInitializationError, match="no such file"):
        SimBus("other", traffic="nosuch.toml")
    with pytest.raises(can.CanInitializationError, match="bit rate"):
        SimBus("third", bitrate=0)


def test_wall_clock_time_wakes_a_waiting_reader(buses):
    one, two = buses(bitrate=500_000), buses()
    received = []
    reader = threading.Thread(target=lambda: received.extend(two.recv(10.0) for _ in range(50)))
    reader.start()
    for i in range(50):
        one.send(frame(0x100 + i, bytes([i])), timeout=1.0)
    reader.join(20.0)
    assert sorted(bytes(m.data)[0] for m in received) == list(range(50))
    stamps = [m.timestamp for m in received]
    assert stamps == sorted(stamps)


def test_a_notifier_serves_listeners(buses):
    one, two = buses(), buses()
    done = threading.Event()
    reader = can.BufferedReader()
    notifier = can.Notifier(two, [reader, lambda _: done.set()], timeout=0.1)
    one.send(frame(0x42))
    assert done.wait(10.0)
    notifier.stop()
    assert reader.get_message(1.0).arbitration_id == 0x42


def test_nodes_come_and_go(buses):
    one = buses(virtual_time=True)
    for _ in range(300):
        bus = can.Bus("test", interface="simbus")
        bus.shutdown()
    two = buses()
    one.send(frame(0x7))
    assert two.recv(0.1).arbitration_id == 7
