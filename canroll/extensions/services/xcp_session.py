"""The session of XCP that a bundle with the service tests itself by, answered by the reference."""

import struct
from collections.abc import Iterator, Sequence
from typing import Any

from canroll.codegen.export.contents import Code, Export
from canroll.codegen.export.sessions.session import REST, Session
from canroll.codegen.run import memory_image, native
from canroll.codegen.run.ecu import EcuBackend
from canroll.extensions.services.modules import xcp
from canroll.extensions.services.running import PAGE_ADDRESS, STATE_ADDRESS, Slave, xcp_idents
from canroll.firmware.limits import LAST_BYTE

WAIT = 100
"""Ticks after a command that starts a job."""
NOTE = """
## XCP

The service is beside the loop and costs it nothing.
Own two more records, which need not be initialised: `static canroll_xcp xcp;` and the working page,
`static canroll_calibration working;`. `canroll_xcp_init` once, with the addresses by which the tool
names `ecu` and `calibration`: those of `canroll.a2l`, {state} and {page} until
`canroll export-c DIR --elf` puts in those of your image. `canroll_xcp_receive` for each frame of
the tool, also in an interrupt. After each `canroll_tick`, which runs on `&working` where
`xcp.ecu_page` is 1, call `canroll_xcp_tick`, then send each slot with `xcp.tx_pending[slot]` and
clear it:

    canroll_tick(&ecu, (xcp.ecu_page == 1) ? &working : &calibration, elapsed);
    canroll_xcp_tick(&xcp, &ecu, &calibration, &working, elapsed);

Identifiers: {master} to the ECU, {slave} from it.

The loop changes to the working page only when `check` accepts it; the tool gets error 0x26 with the
rule otherwise. While the loop runs on it the page is not written (0x23).
"""


def commands(mode: int) -> list[bytes]:
    """What the tool sends: every service, errors among them; ``mode`` is the byte of ecu.mode."""
    at = struct.Struct("<I").pack
    return [
        bytes([xcp.CONNECT, 0]),
        bytes([xcp.GET_STATUS]),
        bytes([xcp.GET_COMM_MODE_INFO]),
        bytes([xcp.GET_ID, 1]),
        bytes([xcp.UPLOAD, 7]),
        bytes([xcp.GET_SEED, 0, 1]),
        bytes([xcp.GET_PAG_PROCESSOR_INFO]),
        bytes([xcp.GET_SEGMENT_INFO, 1, 0, 0, 0]),
        bytes([xcp.GET_PAGE_INFO, 0, 0, 1]),
        bytes([xcp.SHORT_UPLOAD, 4, 0, 0, *at(PAGE_ADDRESS + LAST_BYTE - 3)]),
        bytes([xcp.SHORT_UPLOAD, 4, 0, 0, *at(PAGE_ADDRESS + LAST_BYTE)]),
        bytes([xcp.SET_MTA, 0, 0, 0, *at(PAGE_ADDRESS)]),
        bytes([xcp.DOWNLOAD, 1, 2]),
        bytes([xcp.SET_CAL_PAGE, 2, 0, 1]),
        bytes([xcp.DOWNLOAD, 1, 2]),
        bytes([xcp.SET_CAL_PAGE, 1, 0, 1]),
        bytes([xcp.COPY_CAL_PAGE, 0, 0, 0, 1]),
        bytes([xcp.SET_CAL_PAGE, 1, 0, 1]),
        bytes([xcp.GET_CAL_PAGE, 1, 0]),
        bytes([xcp.SET_CAL_PAGE, 1, 0, 0]),
        bytes([xcp.GET_DAQ_PROCESSOR_INFO]),
        bytes([xcp.GET_DAQ_RESOLUTION_INFO]),
        bytes([xcp.GET_DAQ_EVENT_INFO, 0, 0, 0]),
        bytes([xcp.FREE_DAQ]),
        bytes([xcp.ALLOC_DAQ, 0, 1, 0]),
        bytes([xcp.ALLOC_ODT, 0, 0, 0, 2]),
        bytes([xcp.ALLOC_ODT_ENTRY, 0, 0, 0, 0, 1]),
        bytes([xcp.ALLOC_ODT_ENTRY, 0, 0, 0, 1, 2]),
        bytes([xcp.SET_DAQ_PTR, 0, 0, 0, 0, 0]),
        bytes([xcp.WRITE_DAQ, 255, 2, 0, *at(PAGE_ADDRESS)]),
        bytes([xcp.SET_DAQ_PTR, 0, 0, 0, 1, 0]),
        bytes([xcp.WRITE_DAQ, 255, 4, 0, *at(STATE_ADDRESS)]),
        bytes([xcp.WRITE_DAQ, 255, 1, 0, *at(STATE_ADDRESS + mode)]),
        bytes([xcp.SET_DAQ_LIST_MODE, 2, 0, 0, 0, 0, 1, 0]),
        bytes([xcp.SET_DAQ_LIST_MODE, 16, 0, 0, 0, 0, 2, 0]),
        bytes([xcp.START_STOP_DAQ_LIST, 2, 0, 0]),
        bytes([xcp.START_STOP_SYNCH, 1]),
        bytes([xcp.GET_DAQ_LIST_MODE, 0, 0, 0]),
        bytes([xcp.START_STOP_SYNCH, 0]),
        bytes([xcp.GET_DAQ_CLOCK]),
        bytes([0xC9]),
        bytes([xcp.SYNCH]),
        bytes([xcp.DISCONNECT]),
    ]


def note(_: Export, code: Code) -> str:
    """Return the section of the README."""
    xcp_frames = xcp_idents(code.loop)
    return NOTE.format(
        state=f"0x{STATE_ADDRESS:08X}",
        page=f"0x{PAGE_ADDRESS:08X}",
        master=f"0x{xcp_frames.master:X}",
        slave=f"0x{xcp_frames.slave:X}",
    )


def source(export: Export, code: Code) -> str:
    """The session in C, with the reference's answers."""
    firmware, record = code.served, export.record
    state: Any = memory_image.dtype(firmware.record).fields
    asked = dict(_timed(commands(int(state["mode"][1]))))
    session = Session(native.NativeMachine(firmware), firmware)
    session.begin("XCP")
    ecu = EcuBackend(session, record, firmware)
    slave = Slave(ecu)
    answers = 0
    # words as the memory has them: the CRC, and that in the second frame of a sample
    sealed = bytes([xcp.POSITIVE]) + memory_image.image(record)[LAST_BYTE - 3 :]
    for tick in range(max(asked) + REST):
        if tick in asked:
            slave.receive(asked[tick])
        ecu.tick()
        slave.tick(1)
        session.read(session.records["xcp"], "tx_pending")
        for slot, mark in enumerate(slave.record["tx_pending"]):
            if mark:
                _read_answer(session, slot, sealed)
        if any(slave.record["tx_pending"]):
            answers += len(slave.take())
    return session.source(
        "Commands of a tool, and the answers.",
        f"XCP, {len(asked)} commands and {answers} answers, byte for byte",
    )


def _read_answer(session: Session, slot: int, sealed: bytes) -> None:
    """Compare the frame in a slot."""
    record = session.records["xcp"]
    session.read(record, "tx_length", slot)
    length = int(record["tx_length"][slot])
    answer = bytes(record["tx_payload"][slot][:length])
    if answer == sealed or answer[0] == 1:
        session.read(record, "tx_payload", slot, part=slice(1))
        session.read(record, "tx_payload", slot, part=slice(1, 5), memory=True)
        session.read(record, "tx_payload", slot, part=slice(5, length))
    else:
        session.read(record, "tx_payload", slot, part=slice(length))


def _timed(asked: Sequence[bytes]) -> Iterator[tuple[int, bytes]]:
    """Each command in a tick, the next one later where the answer takes a job."""
    tick = 1
    for payload in asked:
        yield tick, payload
        tick += WAIT if payload[0] in (xcp.SET_CAL_PAGE, xcp.COPY_CAL_PAGE) else 1
