"""The XCP slave beside the loop: ``init``, ``receive``, ``tick``.

The caller owns its record and the working page. It calls ``receive`` for every frame of the tool,
which may be from an interrupt, and ``tick`` after each tick of the loop, which runs on the
reference, or on the working page where ``ecu_page`` is 1. Then it sends every slot whose
``tx_pending`` is 1 and clears it. A tick answers one command and samples the lists.
"""

from typing import Annotated

from canroll.extensions.services.modules.xcp_daq import (
    allocate_entries,
    allocate_lists,
    allocate_odts,
    event_info,
    free,
    get_mode,
    point,
    processor_info,
    resolution_info,
    running,
    sample_lists,
    set_mode,
    start_or_stop,
    start_or_stop_together,
    write,
)
from canroll.extensions.services.modules.xcp_memory import download, point_at, respond, upload
from canroll.extensions.services.modules.xcp_page import (
    copy,
    page,
    page_info,
    segment_info,
    switch,
    work,
)
from canroll.extensions.services.modules.xcp_state import (
    BUSY,
    FRAME,
    IDLE,
    N_ODT,
    NOWHERE,
    OUT_OF_RANGE,
    PAGE_NOT_VALID,
    RESPONSE,
    SYNTAX,
    TEXT,
    UNKNOWN,
    Xcp,
)
from canroll.firmware.calibration import Calibration
from canroll.firmware.limits import LAST_BYTE
from canroll.firmware.state import Ecu
from canroll.firmware.subset import (
    byte,
    clamp,
    clear,
    i32,
    octet,
    set_octet,
    to_i32,
    to_u32,
    u8,
    u32,
)

__all__ = ["init", "receive", "tick"]

CONNECT = 0xFF
DISCONNECT = 0xFE
GET_STATUS = 0xFD
SYNCH = 0xFC
GET_COMM_MODE_INFO = 0xFB
GET_ID = 0xFA
GET_SEED = 0xF8
SET_MTA = 0xF6
UPLOAD = 0xF5
SHORT_UPLOAD = 0xF4
DOWNLOAD = 0xF0
DOWNLOAD_MAX = 0xEE
SET_CAL_PAGE = 0xEB
GET_CAL_PAGE = 0xEA
GET_PAG_PROCESSOR_INFO = 0xE9
GET_SEGMENT_INFO = 0xE8
GET_PAGE_INFO = 0xE7
COPY_CAL_PAGE = 0xE4
SET_DAQ_PTR = 0xE2
WRITE_DAQ = 0xE1
SET_DAQ_LIST_MODE = 0xE0
GET_DAQ_LIST_MODE = 0xDF
START_STOP_DAQ_LIST = 0xDE
START_STOP_SYNCH = 0xDD
GET_DAQ_CLOCK = 0xDC
GET_DAQ_PROCESSOR_INFO = 0xDA
GET_DAQ_RESOLUTION_INFO = 0xD9
GET_DAQ_EVENT_INFO = 0xD7
FREE_DAQ = 0xD6
ALLOC_DAQ = 0xD5
ALLOC_ODT = 0xD4
ALLOC_ODT_ENTRY = 0xD3
FIRST_COMMAND = 0xC0
# of each command from FIRST_COMMAND on the bytes it has at least, 0: not known here
LENGTHS: tuple[u8, ...] = (
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 6, 5, 4, 1, 4, 0, 1, 1, 0, 1, 2, 4, 4,
    8, 8, 6, 0, 5, 0, 0, 4, 5, 1, 3, 4, 0, 0, 8, 0,
    3, 0, 0, 0, 8, 2, 8, 0, 3, 0, 2, 1, 1, 1, 1, 2,
)  # fmt: skip

POSITIVE = 0xFF
NEGATIVE = 0xFE
CAL_AND_DAQ = 0x05
MORE_INFO = 0x80
DAQ_RUNNING = 0x40
TEXT_NAME = 7
MASK = 0xFFFFFFFF


def init(
    xcp: Xcp,
    reference: Calibration,
    working: Calibration,
    state_address: i32,
    page_address: i32,
) -> None:
    """Start: no tool connected, the loop on the reference, the working page a copy of it.

    The two addresses are those by which the tool names the state and the calibration.
    """
    clear(xcp)
    xcp.state_address = state_address
    xcp.page_address = page_address
    xcp.write_odt = N_ODT
    for k in range(LAST_BYTE + 1):
        set_octet(working, k, octet(reference, k))


def receive(xcp: Xcp, payload: Annotated[list[u8], FRAME], length: i32) -> None:
    """Store a command; one that comes before the last is read is dropped, as no tool sends it."""
    if length < 1 or xcp.rx_fresh == 1:
        return
    count: i32 = clamp(length, 1, FRAME)
    for k in range(count):
        xcp.rx_payload[k] = payload[k]
    xcp.rx_length = byte(count)
    xcp.rx_fresh = 1


def connect(xcp: Xcp) -> i32:
    """Respond with what there is: calibration and measurements, frames of eight bytes."""
    xcp.connected = 1
    respond(xcp, 1, CAL_AND_DAQ | MORE_INFO << 8 | FRAME << 16 | FRAME << 24)
    respond(xcp, 4, FRAME | 1 << 16 | 1 << 24)
    return 8


def status(xcp: Xcp) -> i32:
    """Respond with the state of the session; nothing is locked."""
    respond(xcp, 1, 0)
    respond(xcp, 2, 0)
    if running(xcp) == 1:
        xcp.tx_payload[RESPONSE][1] = DAQ_RUNNING
    return 6


def identify(xcp: Xcp) -> i32:
    """Point at the name of the A2L file; return the length of the response."""
    respond(xcp, 1, 0)
    respond(xcp, 4, 0)
    if xcp.command[1] <= 1:
        xcp.pointer = TEXT
        xcp.pointer_offset = 0
        xcp.tx_payload[RESPONSE][4] = TEXT_NAME
    return 8


def about_session(xcp: Xcp, ecu: Ecu, code: i32) -> i32:
    """Execute a command of the session; return the length of the response, or the error."""
    if code == CONNECT:
        return connect(xcp)
    if code == DISCONNECT:
        xcp.connected = 0
        return free(xcp)
    if code == GET_STATUS:
        return status(xcp)
    if code == GET_COMM_MODE_INFO:
        respond(xcp, 1, 0)
        respond(xcp, 4, 1 << 24)
        return 8
    if code == GET_ID:
        return identify(xcp)
    if code == GET_SEED:
        # of length 0: the resource is not locked
        xcp.tx_payload[RESPONSE][1] = 0
        return 2
    return point_at(xcp, ecu)


def about_pages(xcp: Xcp, ecu: Ecu, reference: Calibration, code: i32) -> i32:
    """Execute a command of the pages; return the length of the response, 0: later, or the error."""
    if code == SET_CAL_PAGE:
        return switch(xcp, ecu, reference)
    if code == GET_CAL_PAGE:
        return page(xcp)
    if code == GET_SEGMENT_INFO:
        return segment_info(xcp)
    if code == GET_PAGE_INFO:
        return page_info(xcp)
    if code == COPY_CAL_PAGE:
        return copy(xcp)
    respond(xcp, 1, 1)
    return 3


def about_making(xcp: Xcp, ecu: Ecu, code: i32) -> i32:
    """Execute a command that makes a list; return the length of the response, or the error."""
    if code == FREE_DAQ:
        return free(xcp)
    if code == ALLOC_DAQ:
        return allocate_lists(xcp)
    if code == ALLOC_ODT:
        return allocate_odts(xcp)
    if code == ALLOC_ODT_ENTRY:
        return allocate_entries(xcp)
    if code == SET_DAQ_PTR:
        return point(xcp)
    return write(xcp, ecu)


def about_lists(xcp: Xcp, reference: Calibration, code: i32) -> i32:
    """Execute a command for a list; return the length of the response, or the error."""
    if code == SET_DAQ_LIST_MODE:
        return set_mode(xcp)
    if code == GET_DAQ_LIST_MODE:
        return get_mode(xcp)
    if code == START_STOP_DAQ_LIST:
        return start_or_stop(xcp)
    if code == START_STOP_SYNCH:
        return start_or_stop_together(xcp)
    if code == GET_DAQ_PROCESSOR_INFO:
        return processor_info(xcp)
    if code == GET_DAQ_RESOLUTION_INFO:
        return resolution_info(xcp)
    if code == GET_DAQ_EVENT_INFO:
        return event_info(xcp, reference.tick_us)
    respond(xcp, 1, 0)
    respond(xcp, 4, xcp.time)
    return 8


def execute(xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration, code: i32) -> i32:
    """Execute a command; return the length of the response, 0: later, or the error negated."""
    if code == SHORT_UPLOAD:
        length: i32 = point_at(xcp, ecu)
        if length < 0:
            return length
        return upload(xcp, ecu, reference, working)
    if code == UPLOAD:
        if xcp.pointer == NOWHERE:
            return -OUT_OF_RANGE
        return upload(xcp, ecu, reference, working)
    if code == DOWNLOAD:
        return download(xcp, working, 2, xcp.command[1])
    if code == DOWNLOAD_MAX:
        return download(xcp, working, 1, FRAME - 1)
    if code >= SET_MTA:
        return about_session(xcp, ecu, code)
    if code >= COPY_CAL_PAGE:
        return about_pages(xcp, ecu, reference, code)
    if code <= FREE_DAQ or code == SET_DAQ_PTR or code == WRITE_DAQ:
        return about_making(xcp, ecu, code)
    return about_lists(xcp, reference, code)


def answer(xcp: Xcp, outcome: i32) -> None:
    """Queue the response to a command: positive, or the error; none where it comes later."""
    if outcome == 0:
        return
    xcp.tx_payload[RESPONSE][0] = POSITIVE
    xcp.tx_length[RESPONSE] = byte(clamp(outcome, 0, FRAME))
    if outcome < 0:
        xcp.tx_payload[RESPONSE][0] = NEGATIVE
        xcp.tx_payload[RESPONSE][1] = byte(-outcome)
        xcp.tx_length[RESPONSE] = 2
        if outcome == -PAGE_NOT_VALID and xcp.refused != 0:
            xcp.tx_length[RESPONSE] = 4
    xcp.tx_pending[RESPONSE] = 1


def take(xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration) -> None:
    """Read a received command and execute it."""
    length: i32 = xcp.rx_length
    for k in range(FRAME):
        xcp.command[k] = 0
        if k < length:
            xcp.command[k] = xcp.rx_payload[k]
    xcp.rx_fresh = 0
    code: i32 = xcp.command[0]
    if code < FIRST_COMMAND or (xcp.connected == 0 and code != CONNECT):
        return
    least: i32 = LENGTHS[clamp(code - FIRST_COMMAND, 0, 63)]
    if code == SYNCH:
        # the standard answers it by an error of code 0
        xcp.tx_payload[RESPONSE][0] = NEGATIVE
        xcp.tx_payload[RESPONSE][1] = 0
        xcp.tx_length[RESPONSE] = 2
        xcp.tx_pending[RESPONSE] = 1
    elif xcp.job != IDLE:
        answer(xcp, -BUSY)
    elif least == 0:
        answer(xcp, -UNKNOWN)
    elif length < least:
        answer(xcp, -SYNTAX)
    else:
        outcome: i32 = execute(xcp, ecu, reference, working, code)
        answer(xcp, outcome)


def tick(
    xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration, elapsed_ticks: i32
) -> None:
    """Answer a command and sample the lists, after a tick of the loop that took so many periods."""
    passed: i32 = clamp(elapsed_ticks, 1, 1 << 16)
    time: u32 = (to_u32(xcp.time) + passed * reference.tick_us) & MASK
    xcp.time = to_i32(time)
    if xcp.job != IDLE:
        done: i32 = work(xcp, ecu, reference, working)
        answer(xcp, done)
    if xcp.rx_fresh == 1:
        take(xcp, ecu, reference, working)
    sample_lists(xcp, ecu, reference, working)
