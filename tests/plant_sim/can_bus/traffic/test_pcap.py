"""Captures for Wireshark: their bytes, as the formats have them, and captures of others."""

import struct

import can
import pytest

from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.traffic.log_playback import load_recording
from canroll.plant_sim.can_bus.traffic.pcap import CaptureReader, PcapngWriter, PcapWriter

MESSAGE = can.Message(
    timestamp=1.000000002,
    arbitration_id=0x18FF00F1,
    data=b"\x01\x02\x03",
    channel=0,
    is_rx=False,
)
PACKET = bytes.fromhex("98FF00F1 03 00 0000 0102030000000000")
FD_MESSAGE = can.Message(
    arbitration_id=0x123,
    is_extended_id=False,
    data=bytes(range(12)),
    is_fd=True,
    bitrate_switch=True,
    error_state_indicator=True,
    channel="vcan7",
)
FD_PACKET = bytes.fromhex("00000123 0C 07 0000") + bytes(range(12)) + bytes(52)


def written(writer, path, *messages):
    with writer(path) as file:
        for message in messages:
            file.on_message_received(message)
    return path.read_bytes()


def test_a_pcap_is_a_header_and_packets(tmp_path):
    data = written(PcapWriter, tmp_path / "x.pcap", MESSAGE)
    header = struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 0x40000, 227)
    assert data == header + struct.pack("<IIII", 1, 2, 16, 16) + PACKET


def test_a_pcapng_is_blocks_with_an_interface_a_channel(tmp_path):
    data = written(PcapngWriter, tmp_path / "x.pcapng", MESSAGE, FD_MESSAGE)
    kinds, bodies = [], []
    while data:
        kind, size = struct.unpack_from("<II", data)
        assert size % 4 == 0 and struct.unpack_from("<I", data, size - 4) == (size,)
        kinds.append(kind)
        bodies.append(data[8 : size - 4])
        data = data[size:]
    assert kinds == [0x0A0D0D0A, 1, 6, 1, 6]
    assert bodies[0] == struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)
    assert bodies[1][:8] == struct.pack("<HHI", 227, 0, 0x40000)
    assert b"can0" in bodies[1] and b"can7" in bodies[3]
    assert bodies[2][:20] == struct.pack("<IIIII", 0, 0, 1_000_000_002, 16, 16)
    assert bodies[2][20:36] == PACKET
    assert bodies[4][20:92] == FD_PACKET


@pytest.mark.parametrize("suffix", [".pcap", ".pcapng"])
def test_python_can_knows_them_by_their_suffix(tmp_path, suffix):
    path = tmp_path / f"x{suffix}"
    with can.Logger(path) as logger:
        logger(MESSAGE)
    with can.LogReader(path) as reader:
        (message,) = reader
    assert message.equals(MESSAGE, check_channel=False, check_direction=suffix == ".pcapng")
    assert load_recording(path, bitrate=500_000).channel == "can0"


@pytest.mark.parametrize("sign", ["<", ">"])
def test_captures_of_others_are_read(tmp_path, sign):
    """Either byte order, microseconds, FD frames without their flag, a block nobody knows."""
    path = tmp_path / "other.pcap"
    old = bytes.fromhex("00000123 0C 00 0000") + bytes(range(12)) + bytes(52)
    header = struct.pack(f"{sign}IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 0x40000, 227)
    path.write_bytes(header + struct.pack(f"{sign}IIII", 5, 250_000, 72, 72) + old)
    (message,) = CaptureReader(path)
    assert (message.timestamp, message.is_fd, message.dlc) == (5.25, True, 12)

    def block(kind, body):
        size = struct.pack(f"{sign}I", len(body) + 12)
        return struct.pack(f"{sign}I", kind) + size + body + size

    path.write_bytes(
        block(0x0A0D0D0A, struct.pack(f"{sign}IHHq", 0x1A2B3C4D, 1, 0, -1))
        + block(1, struct.pack(f"{sign}HHI", 227, 0, 0))
        + block(5, bytes(12))
        + block(6, struct.pack(f"{sign}IIIII", 0, 0, 5_250_000, 16, 16) + PACKET)
    )
    (message,) = CaptureReader(path)
    assert (message.timestamp, message.channel, message.is_rx) == (5.25, "can0", True)
    assert bytes(message.data) == b"\x01\x02\x03"


def test_what_is_no_capture_of_can_is_refused(tmp_path):
    whole = written(PcapWriter, tmp_path / "x.pcap", MESSAGE)
    ethernet = whole[:20] + struct.pack("<I", 1) + whole[24:]
    for data, word in (
        (whole[:-3], "truncated"),
        (whole[:30], "truncated"),
        (ethernet, "link type 1"),
        (b"nonsense", "neither"),
        (written(PcapngWriter, tmp_path / "x.pcapng", MESSAGE)[:-9], "truncated"),
    ):
        path = tmp_path / "bad.pcap"
        path.write_bytes(data)
        with pytest.raises(CanrollError, match=word) as caught:
            load_recording(path, bitrate=500_000)
        assert "bad.pcap" in str(caught.value)
