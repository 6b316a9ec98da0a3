"""The diagnostic server against udsoncan: sessions, fault codes, data, negative responses."""

import random

import pytest
import udsoncan
from support.uds_tester import TickConnection, UdsTester
from udsoncan.client import Client
from udsoncan.exceptions import NegativeResponseException

from canroll.codegen.run import ecu_traffic, native
from canroll.codegen.run.backends import NativeEcu, PythonEcu
from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.codegen.run.services import ServedEcu
from canroll.extensions.services.modules import uds
from canroll.extensions.services.modules.fault_memory import AVAILABLE
from canroll.firmware.state import N_FAULT_CODES

SERVED = with_services(built_in(), ("xcp", "uds"))
needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs cc (package gcc)")


class Number(udsoncan.DidCodec):
    """A whole number, the highest byte first."""

    def __init__(self, size):
        self.size = size

    def decode(self, payload):
        return int.from_bytes(payload, "big", signed=self.size > 1)

    def __len__(self):
        return self.size


WORDS = (0x0101, 0x0102, 0x0103, 0x0104, 0x0105, 0x0106, 0x0110, 0x0111)
NUMBERS = {did: Number(4) for did in WORDS} | {0x0100: Number(1), 0xF186: Number(1)}


@pytest.fixture(params=["python", pytest.param("native", marks=needs_cc)])
def tester(request):
    record = ecu_traffic.random_calibration(3)
    kind = PythonEcu if request.param == "python" else NativeEcu
    return UdsTester(ServedEcu(kind(record, SERVED)))


@pytest.fixture
def client(tester):
    config = dict(udsoncan.configs.default_client_config)
    config |= {
        "data_identifiers": NUMBERS,
        "use_server_timing": False,
        "request_timeout": 60,
        "p2_timeout": 60,
        "p2_star_timeout": 60,
        "dtc_snapshot_did_size": 2,
    }
    with Client(TickConnection(tester), config=config) as opened:
        yield opened


def refusal(call, *arguments):
    with pytest.raises(NegativeResponseException) as refused:
        call(*arguments)
    return refused.value.response.code_name


def test_sessions_begin_and_end(client, tester):
    assert client.read_data_by_identifier_first(0xF186) == 1
    response = client.change_session(3)
    assert response.service_data.p2_server_max == 0.05
    assert response.service_data.p2_star_server_max == 5.0
    assert client.read_data_by_identifier_first(0xF186) == 3
    client.tester_present()
    with client.suppress_positive_response:
        client.tester_present()
    for _ in range(490):
        tester.tick()
    assert client.read_data_by_identifier_first(0xF186) == 3
    for _ in range(510):
        tester.tick()
    assert client.read_data_by_identifier_first(0xF186) == 1
    client.change_session(3)
    client.change_session(1)
    assert client.read_data_by_identifier_first(0xF186) == 1


def test_data_are_those_of_the_state(client, tester):
    record = ecu_traffic.random_calibration(3)
    values = client.read_data_by_identifier([0x0110, 0x0111, 0x0100]).service_data.values
    assert dict(values) == {0x0110: record.id, 0x0111: record.crc, 0x0100: tester.ecu.state.mode}
    before = client.read_data_by_identifier_first(0x0101)
    assert before <= tester.ecu.state.time
    answer = tester.ask(bytes([uds.READ_DATA, 0xF1, 0x90]))
    assert answer == bytes([0x7F, uds.READ_DATA, 0x31])
    # what is not there is left out beside what is
    both = tester.ask(bytes([uds.READ_DATA, 0xF1, 0x90, 0xF1, 0x86]))
    assert both == bytes([0x62, 0xF1, 0x86, 1])


def latched(tester):
    return [code for code in range(N_FAULT_CODES) if tester.ecu.state.fault_latched >> code & 1]


def test_fault_codes_have_status_and_snapshot(client, tester):
    # a bus without sensors: every needed input is late
    for _ in range(400):
        tester.tick()
    codes = latched(tester)
    assert codes
    found = client.get_number_of_dtc_by_status_mask(0x08).service_data
    assert found.dtc_count == len(codes)
    assert found.status_availability.get_byte_as_int() == AVAILABLE
    listed = client.get_dtc_by_status_mask(0xFF).service_data.dtcs
    assert [dtc.id for dtc in listed] == [0x5A0000 | code << 8 for code in codes]
    assert all(dtc.status.confirmed and dtc.status.test_failed for dtc in listed)
    every = client.get_supported_dtc().service_data.dtcs
    assert [dtc.id for dtc in every] == [0x5A0000 | code << 8 for code in range(N_FAULT_CODES)]
    snapshot = client.get_dtc_snapshot_by_dtc_number(listed[0].id, 1).service_data.dtcs[0]
    data = {each.did: each.data for each in snapshot.snapshots}
    assert set(data) == {0x0100, 0x0101, 0x0102, 0x0103, 0x0104}
    assert 0 < data[0x0101] < tester.ecu.state.time
    quiet = next(code for code in range(N_FAULT_CODES) if code not in codes)
    without = client.get_dtc_snapshot_by_dtc_number(0x5A0000 | quiet << 8, 0xFF).service_data
    assert without.dtcs[0].snapshots == []


def test_cleared_codes_that_are_active_come_back(client, tester):
    for _ in range(400):
        tester.tick()
    (first, *_) = client.get_dtc_by_status_mask(0x08).service_data.dtcs
    assert refusal(client.clear_dtc) == "ServiceNotSupportedInActiveSession"
    client.change_session(3)
    assert refusal(client.clear_dtc, first.id) == "RequestOutOfRange"
    before = tester.ecu.state.time
    client.clear_dtc()
    again = client.get_dtc_snapshot_by_dtc_number(first.id, 1).service_data.dtcs[0]
    data = {each.did: each.data for each in again.snapshots}
    assert data[0x0101] >= before
    assert sum(tester.ecu.state.fault_count) == 0


def test_every_request_has_its_negative_responses(client, tester):
    assert refusal(client.change_session, 2) == "SubFunctionNotSupported"
    assert refusal(client.ecu_reset, 1) == "ServiceNotSupported"
    assert refusal(client.get_dtc_snapshot_by_dtc_number, 0x123400, 1) == "RequestOutOfRange"
    assert refusal(client.get_dtc_snapshot_by_dtc_number, 0x5A0000, 2) == "RequestOutOfRange"
    assert refusal(client.get_dtc_snapshot_by_dtc_number, 0x5AFF00, 1) == "RequestOutOfRange"
    wrong = {
        bytes([uds.SESSION_CONTROL]): uds.WRONG_LENGTH,
        bytes([uds.SESSION_CONTROL, 1, 1]): uds.WRONG_LENGTH,
        bytes([uds.TESTER_PRESENT]): uds.WRONG_LENGTH,
        bytes([uds.TESTER_PRESENT, 1]): uds.NO_SUBFUNCTION,
        # a negative response is not suppressed
        bytes([uds.TESTER_PRESENT, 0x81]): uds.NO_SUBFUNCTION,
        bytes([uds.READ_FAULTS]): uds.WRONG_LENGTH,
        bytes([uds.READ_FAULTS, 1]): uds.WRONG_LENGTH,
        bytes([uds.READ_FAULTS, 4, 0x5A]): uds.WRONG_LENGTH,
        bytes([uds.READ_FAULTS, 0x0A, 0]): uds.WRONG_LENGTH,
        bytes([uds.READ_FAULTS, 0x55]): uds.NO_SUBFUNCTION,
        bytes([uds.READ_DATA]): uds.WRONG_LENGTH,
        bytes([uds.READ_DATA, 1]): uds.WRONG_LENGTH,
        bytes([uds.READ_DATA, 1, 0, 1]): uds.WRONG_LENGTH,
        bytes([uds.READ_DATA, *([1, 0] * 17)]): uds.TOO_LONG,
        bytes([uds.CLEAR_FAULTS, 0xFF, 0xFF, 0xFF]): uds.NOT_IN_SESSION,
        bytes([0x2E, 1, 0, 5]): uds.NO_SERVICE,
        bytes([0x27, 1]): uds.NO_SERVICE,
    }
    for request, code in wrong.items():
        assert tester.ask(request) == bytes([0x7F, request[0], code]), request.hex()
    assert tester.ask(bytes([uds.CLEAR_FAULTS])) == bytes([0x7F, uds.CLEAR_FAULTS, 0x7F])


@needs_cc
def test_both_backends_give_the_same_bytes_for_any_frames():
    record = ecu_traffic.random_calibration(5)
    ecus = [ServedEcu(kind(record, SERVED)) for kind in (PythonEcu, NativeEcu)]
    draw = random.Random(3)
    known = [uds.SESSION_CONTROL, uds.CLEAR_FAULTS, uds.READ_FAULTS, uds.READ_DATA, 0x3E, 0x27]
    for _ in range(3000):
        kind = draw.choice([0, 0, 0, 1, 2, 3])
        body = [draw.choice([0, 1, 2, 3, 4, 10, 90, 255, draw.randrange(256)]) for _ in range(6)]
        frame = bytes([kind << 4 | draw.randrange(8), draw.choice(known), *body])
        if kind == 3:
            frame = bytes([0x30, draw.choice([0, 1]), draw.choice([0, 10, 0xF5])])
        sent = []
        for ecu in ecus:
            ecu.services["uds"].receive(frame)
            ecu.run()
            ecu.run()
            sent.append(ecu.services["uds"].take())
        assert sent[0] == sent[1], frame.hex()
    assert ecus[0].image() == ecus[1].image()
    records = [ecu.services["uds"].record.image() for ecu in ecus]
    assert records[0] == records[1]
