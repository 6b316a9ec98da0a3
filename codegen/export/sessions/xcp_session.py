"""The session of XCP that a bundle with the service tests itself by, answered by the reference."""

import struct
from collections.abc import Iterator, Sequence
from typing import Any

from codegen.export.sessions.service_session import session_test
from codegen.run import memory_image
from codegen.run.bus_firmware import BusFirmware
from codegen.run.xcp_slave import PAGE_ADDRESS, STATE_ADDRESS
from firmware.calibration import Calibration
from firmware.limits import LAST_BYTE
from firmware.services import xcp

WAIT = 100
"""Ticks after a command that starts a job."""
NOTE = """
## XCP

The service is beside the loop and costs it nothing: `test/test_xcp.c` is how a board runs it.
Own two more records, which need not be initialised: `static canroll_xcp xcp;` and the working page,
`static canroll_calibration working;`. `canroll_xcp_init` once, with the addresses by which the tool
names `ecu` and `calibration`: those of `canroll.a2l`, {state} and {page} until
`canroll export-c DIR --elf` puts in those of your image. `canroll_xcp_receive` for each frame of
the tool, also in an interrupt. After each `canroll_tick`, which runs on `&working` where
`xcp.ecu_page` is 1, call `canroll_xcp_tick`, then send each slot with `xcp.tx_pending[slot]` and
clear it.
Identifiers: {master} to the ECU, {slave} from it.

The loop changes to the working page only when `check` accepts it; the tool gets error 0x26 with the
rule otherwise. While the loop runs on it the page is not written (0x23).
"""
FILES = (
    "| `test/test_xcp.c` | the service as a board runs it, and a session that it is tested by |\n"
)


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


def sources(firmware: BusFirmware, record: Calibration) -> dict[str, str]:
    """The test of the service: its program, and the session with the reference's answers."""
    state: Any = memory_image.dtype(firmware.record).fields
    asked = list(_timed(commands(int(state["mode"][1]))))
    sealed = bytes([xcp.POSITIVE]) + memory_image.image(record)[LAST_BYTE - 3 :]

    def word_in(answer: bytes) -> int:
        # the words that the tool reads: the CRC, and the one in the second frame of a sample
        return 1 if answer == sealed or answer[0] == 1 else 0

    heading = [
        f"#define XCP_STATE_ADDRESS 0x{STATE_ADDRESS:08X}",
        f"#define XCP_PAGE_ADDRESS 0x{PAGE_ADDRESS:08X}",
    ]
    return session_test("xcp", firmware, record, asked, heading, word_in=word_in)


def _timed(asked: Sequence[bytes]) -> Iterator[tuple[int, bytes]]:
    """Each command in a tick, the next one later where the answer takes a job."""
    tick = 1
    for payload in asked:
        yield tick, payload
        tick += WAIT if payload[0] in (xcp.SET_CAL_PAGE, xcp.COPY_CAL_PAGE) else 1
