"""ISO-TP of the ECU against can-isotp: requests and responses of any length."""

import pytest
from support.uds_tester import UdsTester

from canroll.codegen.run import ecu_traffic, native
from canroll.codegen.run.backends import NativeEcu, PythonEcu
from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.codegen.run.services import ServedEcu
from canroll.extensions.services.modules import uds
from canroll.firmware.state import N_FAULT_CODES

SERVED = with_services(built_in(), ("uds",))
needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs cc (package gcc)")


@pytest.fixture(params=["python", pytest.param("native", marks=needs_cc)])
def ecu(request):
    record = ecu_traffic.random_calibration(3)
    kind = PythonEcu if request.param == "python" else NativeEcu
    return ServedEcu(kind(record, SERVED))


def request_of(identifiers):
    return bytes([uds.READ_DATA]) + b"".join(i.to_bytes(2, "big") for i in identifiers)


@pytest.mark.parametrize("number", [1, 2, 3, 4, 9, 16])
def test_requests_and_responses_of_any_length(ecu, number):
    tester = UdsTester(ecu)
    identifiers = [0x0110, 0x0111][: number % 2 + 1] * 8
    answer = tester.ask(request_of(identifiers[:number]))
    record = ecu_traffic.random_calibration(3)
    values = {0x0110: record.id, 0x0111: record.crc}
    expected = bytes([0x62])
    for identifier in identifiers[:number]:
        expected += identifier.to_bytes(2, "big") + values[identifier].to_bytes(
            4, "big", signed=True
        )
    assert answer == expected
    assert tester.errors == []


def test_a_tester_may_slow_the_response_down(ecu):
    tester = UdsTester(ecu, stmin=25, blocksize=2)
    answer = tester.ask(bytes([uds.READ_FAULTS, uds.SUPPORTED]))
    assert len(answer) == 3 + 4 * N_FAULT_CODES
    assert tester.errors == []
    # frames at least 25 ms apart are three ticks of 10 ms apart
    gaps, last = [], None
    tester.server.receive(bytes([2, uds.READ_FAULTS, uds.SUPPORTED]))
    for tick in range(60):
        ecu.run()
        if tick == 2:
            tester.server.receive(bytes([0x30, 0, 25]))
        for frame in tester.server.take():
            if frame[0] >> 4 == 2:
                gaps.append(0 if last is None else tick - last)
                last = tick
    assert set(gaps[1:]) == {3}


def test_what_the_transport_refuses(ecu):
    tester = UdsTester(ecu)
    # longer than the ECU takes: its flow control says so
    tester.server.receive(bytes([0x10 | 0x0, 65, *range(6)]))
    ecu.run()
    (frame,) = tester.server.take()
    assert frame[:1] == b"\x32"
    # a wrong number ends a request, a flow control for nothing and short frames do nothing
    for frames in (
        [bytes([0x10, 9, 0x22, 1, 0x10, 1, 0x11, 1]), bytes([0x22, 0x10, 1, 0x10])],
        [bytes([0x30, 0, 0])],
        [bytes([0x10, 9, 0x22])],
        [bytes([0x00])],
        [bytes([0x05, 0x3E, 0])],
        [bytes([0x21, 1, 2])],
        [bytes([0x40, 1, 2])],
    ):
        for frame in frames:
            tester.server.receive(frame)
            ecu.run()
            assert all(sent[0] >> 4 == 3 for sent in tester.server.take()), frame.hex()
    # whatever came before, the next request is answered
    assert tester.ask(bytes([uds.TESTER_PRESENT, 0])) == b"\x7e\0"


def test_a_request_that_stops_is_forgotten_after_a_second(ecu):
    tester = UdsTester(ecu)
    tester.server.receive(bytes([0x10, 9, 0x22, 1, 0x10, 1, 0x11, 1]))
    for _ in range(103):
        ecu.run()
    tester.server.take()
    tester.server.receive(bytes([0x21, 0x10, 1, 0x10]))
    ecu.run()
    assert tester.server.take() == []
    # so is a response that no flow control asks for
    tester.server.receive(bytes([2, uds.READ_FAULTS, uds.SUPPORTED]))
    for _ in range(105):
        ecu.run()
    assert len(tester.server.take()) == 1
    tester.server.receive(bytes([0x30, 0, 0]))
    ecu.run()
    assert tester.server.take() == []
