"""The python-can interface: several nodes in one process, in virtual and in wall-clock time."""

import errno
import threading
from itertools import pairwise

import can
import cantools
import pytest

from canroll import dbc
from canroll.plant_sim.can_bus.servers.hub import TRANSMIT_QUEUE
from canroll.plant_sim.can_bus.servers.simbus import SimBus


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


def good(bus):
    """Return the next frame that is not an error frame."""
    while (message := bus.recv(1.0)).is_error_frame:
        pass
    return message


def test_the_plugin_is_registered(buses):
    assert "simbus" in can.VALID_INTERFACES
    assert isinstance(buses(virtual_time=True), SimBus)


def test_virtual_time_takes_as_long_as_the_frames(buses):
    one, two = buses(bitrate=500_000, virtual_time=True, queue="priority"), buses()
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
    assert good(two).arbitration_id == 1


def test_error_frames_are_reported(buses):
    one, two = buses(virtual_time=True, bit_error_rate=2e-3, seed=1), buses()
    for _ in range(20):
        one.send(frame(0x100, bytes(8)))
    seen = [two.recv(0.1) for _ in range(30)]
    assert any(m.is_error_frame for m in seen if m is not None)
    good = [m for m in seen if m is not None and not m.is_error_frame]
    assert all(bytes(m.data) == bytes(8) for m in good)


def test_frames_of_a_node_keep_their_order_unless_told_otherwise(buses):
    one, two = buses(virtual_time=True), buses()
    for ident in (0x300, 0x100, 0x200):
        one.send(frame(ident))
    assert [two.recv(1.0).arbitration_id for _ in range(3)] == [0x300, 0x100, 0x200]
    with pytest.raises(can.CanInitializationError, match="did you mean 'priority'"):
        SimBus("test", queue="priorty")


@pytest.mark.parametrize("virtual_time", [True, False])
def test_send_waits_for_room_in_its_queue(buses, virtual_time):
    """A timeout of None waits as long as it takes; once frame 257 raised."""
    one, two = buses(virtual_time=virtual_time, bitrate=1_000_000), buses()
    for number in range(600):
        one.send(frame(0x100, number.to_bytes(2, "big")))
    received = [two.recv(5.0) for _ in range(600)]
    assert [int.from_bytes(m.data, "big") for m in received] == list(range(600))


def test_send_waits_no_longer_than_its_timeout(buses):
    one = buses(virtual_time=True, bitrate=125_000)
    two = buses()
    for _ in range(TRANSMIT_QUEUE):
        one.send(frame(0x100, bytes(8)), timeout=0)
    for timeout in (0, 1e-4):
        with pytest.raises(can.CanOperationError, match="transmit queue full"):
            one.send(frame(0x100), timeout=timeout)
    assert two.hub.now_ns() == 100_000
    one.send(frame(0x101), timeout=0.01)


def test_a_full_queue_can_be_an_error_as_on_socketcan(buses):
    one, _ = buses(virtual_time=True, enobufs=True), buses()
    with pytest.raises(can.CanOperationError, match="transmit queue full") as caught:
        for _ in range(1000):
            one.send(frame(0x100, bytes(8)))
    assert caught.value.error_code == errno.ENOBUFS


def test_who_waits_for_room_is_woken_by_the_end_of_the_bus(buses):
    one = buses(bitrate=125_000)
    failed = []

    def flood():
        with pytest.raises(can.CanOperationError, match="shut down") as caught:
            while True:
                one.send(frame(0x100, bytes(8)))
        failed.append(caught.value)

    sender = threading.Thread(target=flood)
    sender.start()
    while one.port.outstanding < TRANSMIT_QUEUE:
        one.let_pass(0.001)
    one.shutdown()
    sender.join(20.0)
    assert failed


def test_a_lone_sender_does_not_hold_up_who_would_acknowledge(buses):
    """Virtual time went on for ever inside ``recv``, and no other node could join."""
    one = buses(virtual_time=True)
    one.send(frame(0x1))
    assert one.recv(None) is None
    with pytest.raises(can.CanOperationError, match="no node acknowledges"):
        for _ in range(TRANSMIT_QUEUE + 1):
            one.send(frame(0x1))
    waiting = threading.Thread(target=one.recv, args=(1e6,))
    waiting.start()
    two = buses()
    assert good(two).arbitration_id == 1
    two.shutdown()
    one.shutdown()
    waiting.join(20.0)
    assert not waiting.is_alive()


def test_two_threads_flood_a_bus_that_both_read(buses):
    def flood(bus, mine):
        for number in range(700):
            bus.send(frame(mine, number.to_bytes(2, "big")))

    for options in ({"virtual_time": True}, {}):
        pair = [buses(str(options), bitrate=1_000_000, **options), buses(str(options))]
        threads = [threading.Thread(target=flood, args=(b, i)) for i, b in enumerate(pair)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60.0)
            assert not thread.is_alive()
        for place, bus in enumerate(pair):
            numbers = [bus.recv(5.0) for _ in range(700)]
            assert {m.arbitration_id for m in numbers} == {1 - place}
            assert [int.from_bytes(m.data, "big") for m in numbers] == list(range(700))


def test_nobody_acknowledging_is_said_once_and_can_be_avoided(buses, caplog):
    # the commands quieten python-can's loggers for the whole process
    caplog.set_level("WARNING", "can")
    one = buses("alone", virtual_time=True)
    one.send(frame(0x1))
    one.let_pass(0.1)
    assert [r.getMessage() for r in caplog.records] == [
        "simbus alone: no acknowledgement, because the node is alone on the bus; it retransmits"
        " without end (acknowledge=True adds a silent node that acknowledges)"
    ]
    caplog.clear()
    two = buses("heard", virtual_time=True, acknowledge=True, receive_own_messages=True)
    two.send(frame(0x1))
    assert two.recv(0.1).arbitration_id == 1
    assert two.state == can.BusState.ACTIVE
    assert not caplog.records


def test_what_is_queued_when_a_node_leaves_is_still_sent(buses):
    one, two = buses(virtual_time=True), buses()
    for number in range(100):
        one.send(frame(number))
    one.shutdown()
    three = buses()
    three.send(frame(0x200))
    assert [two.recv(1.0).arbitration_id for _ in range(101)] == [*range(100), 0x200]
    assert three.port.outstanding == 0


def test_closed_buses_raise(buses):
    one, two = buses(virtual_time=True), buses()
    two.shutdown()
    with pytest.raises(can.CanOperationError, match="shut down"):
        two.send(frame(1))
    with pytest.raises(can.CanOperationError, match="shut down"):
        two.recv(0.0)
    assert one.recv(0.0) is None


def test_an_error_frame_is_an_error_flag_on_the_bus(buses):
    one, two = buses(virtual_time=True, bitrate=500_000), buses()
    one.send(can.Message(is_error_frame=True))
    one.send(frame(0x100))
    broken, good = two.recv(0.1), two.recv(0.1)
    assert broken.is_error_frame and not good.is_error_frame
    # flags of 12 bits, delimiter and interframe space, seen 4 bits before their end
    assert broken.timestamp == pytest.approx(19 * 2e-6, abs=1e-9)
    assert two.hub.node_state(two.port)[2] == 0
    for _ in range(130):
        one.send(can.Message(is_error_frame=True))
    one.let_pass(0.1)
    assert two.state == one.state == can.BusState.PASSIVE


def test_the_error_state_of_a_sender_is_in_its_fd_frames(buses):
    one, two = buses(virtual_time=True, fd=True, data_bitrate=2_000_000), buses(fd=True)
    for told in (False, True):
        one.send(frame(0x10, bytes(8), is_fd=True, error_state_indicator=told))
        assert two.recv(0.1).error_state_indicator is told
    for _ in range(130):
        one.send(can.Message(is_error_frame=True))
    one.send(frame(0x10, is_fd=True))
    seen = [two.recv(0.1) for _ in range(131)]
    assert seen[-1].error_state_indicator


def test_a_bus_without_fd_neither_sends_nor_sees_fd_frames(buses):
    one, two, three = buses(virtual_time=True, fd=True), buses(), buses(fd="true")
    assert two.protocol == can.CanProtocol.CAN_20
    assert three.protocol == can.CanProtocol.CAN_FD
    with pytest.raises(can.CanOperationError, match="fd=True"):
        two.send(frame(0x10, bytes(12), is_fd=True))
    one.send(frame(0x10, bytes(12), is_fd=True))
    one.send(frame(0x11))
    assert two.recv(0.1).arbitration_id == 0x11
    assert [three.recv(0.1).arbitration_id for _ in range(2)] == [0x10, 0x11]


def test_time_stamps_can_be_the_senders(buses):
    one, two = buses(virtual_time=True, preserve_timestamps=True), buses()
    for stamp in (5.5, 3.25):
        one.send(frame(0x10, timestamp=stamp))
    two.send(frame(0x11, timestamp=9.0))
    assert [two.recv(0.1).timestamp for _ in range(2)] == [5.5, 3.25]
    assert one.recv(0.1).timestamp < 1.0


def test_the_channel_is_named_as_it_was_opened(buses):
    for channel in (0, "chassis"):
        one, two = buses(channel, virtual_time=True), buses(channel)
        one.send(frame(0x1))
        assert two.recv(0.1).channel == two.channel == channel


def test_open_channels_are_detected_and_one_more(buses):
    buses("chassis", virtual_time=True)
    found = can.detect_available_configs("simbus")
    channels = [config["channel"] for config in found]
    assert "chassis" in channels
    assert len(channels) == len(set(channels)) >= 2
    assert all(config["interface"] == "simbus" for config in found)
    buses(channels[-1], virtual_time=True)


@pytest.mark.parametrize(
    "options", [{"bitrate": "fast"}, {"seed": "x"}, {"bit_error_rate": "much"}, {"data_bitrate": 1}]
)
def test_whatever_cannot_be_opened_is_a_can_error(options):
    with pytest.raises(can.CanError):
        can.Bus("broken", interface="simbus", **options)
    assert "broken" not in {c["channel"] for c in can.detect_available_configs("simbus")}


def test_no_room_for_another_node_is_a_can_error(buses):
    buses("crowd", virtual_time=True)
    with pytest.raises(can.CanInitializationError, match="at most 128 nodes"):
        for _ in range(200):
            buses("crowd")


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
    reader = threading.Thread(target=lambda: received.extend(two.recv(600.0) for _ in range(50)))
    reader.start()
    for i in range(50):
        one.send(frame(0x100 + i, bytes([i])), timeout=600.0)
    reader.join(20.0)
    assert sorted(bytes(m.data)[0] for m in received) == list(range(50))
    stamps = [m.timestamp for m in received]
    assert stamps == sorted(stamps)


def test_nodes_come_and_go(buses):
    one = buses(virtual_time=True)
    for _ in range(300):
        bus = can.Bus("test", interface="simbus")
        bus.shutdown()
    two = buses()
    one.send(frame(0x7))
    assert two.recv(0.1).arbitration_id == 7
