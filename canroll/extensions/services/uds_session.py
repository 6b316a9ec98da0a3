"""The session of UDS that a bundle with the service tests itself by."""

from canroll.codegen.export.contents import Code, Export
from canroll.codegen.export.sessions.session import REST, Session
from canroll.codegen.run import native
from canroll.codegen.run.ecu import EcuBackend
from canroll.extensions.services.modules import fault_memory, uds, uds_state
from canroll.extensions.services.running import Server, uds_idents

NOTE = """
## Diagnostics

UDS over ISO-TP by physical addressing, beside the loop.
Own one more record, `static canroll_uds uds;`. After `canroll_init` call
`canroll_uds_init(&uds, &ecu)`; `canroll_uds_receive` for each frame of the tester, also in an
interrupt; `canroll_uds_tick` after each `canroll_tick`, with the calibration that it ran on; then
send `uds.tx_payload`, eight bytes, where `uds.tx_pending` is 1, and clear it:

    canroll_tick(&ecu, &calibration, elapsed);
    canroll_uds_tick(&uds, &ecu, &calibration, elapsed);

Identifiers:
{request} to the ECU, {response} from it.

| service | |
| --- | --- |
| 10 | session: 01 default, 03 extended, which ends after 5 s without a request |
| 14 | clear all fault codes (FFFFFF), in the extended session |
| 19 | fault codes: 01 their number, 02 by status, 04 snapshot, 0A all; code i is C1Aii-00 |
| 22 | data, each as the A2L has its format: {data} |
| 3E | tester present |
"""
DATA = (
    "0100 mode, 0101 time, 0102 speed, 0103 roll rate, 0104 lateral acceleration, 0105 moment, "
    "0106 commands sent, 0110 id and 0111 CRC of the calibration, F186 session"
)
CLEAR_TO_SEND = b"\x30\0\0"


def frames() -> list[bytes]:
    """What the tester sends: every service, errors among them."""
    requests = [
        bytes([uds.SESSION_CONTROL, uds_state.DEFAULT]),
        bytes([uds.CLEAR_FAULTS, 0xFF, 0xFF, 0xFF]),
        bytes([uds.SESSION_CONTROL, uds_state.EXTENDED]),
        bytes([uds.SESSION_CONTROL, 2]),
        bytes([uds.TESTER_PRESENT, 0]),
        bytes([uds.TESTER_PRESENT, uds.SUPPRESSED]),
        bytes([uds.READ_FAULTS, uds.NUMBER_BY_STATUS, 0xFF]),
        bytes([uds.READ_FAULTS, uds.BY_STATUS, 0xFF]),
        bytes([uds.READ_FAULTS, uds.SNAPSHOT, fault_memory.FAMILY, 0, 0, fault_memory.RECORD]),
        bytes([uds.READ_FAULTS, uds.SUPPORTED]),
        bytes([uds.READ_FAULTS, 0x55]),
        bytes([uds.READ_DATA, 0xF1, 0x86, 1, 0x10]),
        bytes([uds.READ_DATA, 0xF1, 0x90]),
        bytes([uds.CLEAR_FAULTS, 0xFF, 0xFF, 0xFF]),
        bytes([uds.READ_FAULTS, uds.NUMBER_BY_STATUS, 8]),
        bytes([0x2E, 1, 0, 0]),
    ]
    return [bytes([len(request), *request]) for request in requests]


def note(_: Export, code: Code) -> str:
    """Return the section of the README."""
    idents = uds_idents(code.loop)
    return NOTE.format(
        request=f"0x{idents.request:X}", response=f"0x{idents.response:X}", data=DATA
    )


def source(export: Export, code: Code) -> str:
    """The session in C, with the reference's answers."""
    firmware, record = code.served, export.record
    asked: dict[int, bytes] = {}
    for k, frame in enumerate(frames()):
        # an answer of several frames goes on when the tester is ready
        asked |= {50 * k + 1: frame, 50 * k + 3: CLEAR_TO_SEND}
    session = Session(native.NativeMachine(firmware), firmware)
    session.begin("UDS")
    ecu = EcuBackend(session, record, firmware)
    server = Server(ecu)
    answers = 0
    for tick in range(max(asked) + REST):
        if tick in asked:
            server.receive(asked[tick])
        ecu.tick()
        server.tick(1)
        session.read(session.records["uds"], "tx_pending")
        if server.record["tx_pending"]:
            session.read(session.records["uds"], "tx_payload")
            server.take()
            answers += 1
    return session.source(
        "Frames of a tester, and the answers.",
        f"UDS, {len(asked)} frames and {answers} answers, byte for byte",
    )
