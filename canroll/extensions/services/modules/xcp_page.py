"""Pages of the calibration: the reference, which stays, and the working page, which a tool writes.

The loop changes to the working page only when ``check`` accepts it. Its check, its CRC and the copy
of the reference take a bounded part of each tick; the response comes when they are done.
"""

from canroll.extensions.services.modules.xcp_memory import respond
from canroll.extensions.services.modules.xcp_state import (
    CHECK_RANGES,
    CHECK_SUM,
    COPY,
    IDLE,
    MODE_NOT_VALID,
    OUT_OF_RANGE,
    PAGE_NOT_VALID,
    REFERENCE,
    RESPONSE,
    SEGMENT_NOT_VALID,
    WORKING,
    WRITE_PROTECTED,
    Xcp,
)
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import check_rules, checked_word, fits, folded
from canroll.firmware.limits import BYTES, FIELDS, LAST_BYTE, LAST_WORD, RANGE, SIZE
from canroll.firmware.state import CORRUPT, Ecu
from canroll.firmware.subset import byte, clamp, i32, octet, set_octet, set_word, to_i32, to_u32

# part of a job in a tick
ELEMENTS = 16
WORDS = 8
COPIED = 64

# modes of a page switch, as the standard has them
ECU = 1
TOOL = 2
ALL_SEGMENTS = 128
OTHER_MODES = 255 - ECU - TOOL - ALL_SEGMENTS


def run_on(xcp: Xcp, ecu: Ecu, cal: Calibration, page: i32) -> None:
    """Change the page on which the loop runs; its watch of the CRC begins anew."""
    xcp.ecu_page = byte(page)
    if ecu.calibration_word != CORRUPT:
        ecu.calibration_word = 0
        ecu.calibration_crc = 0
    ecu.law = cal.law


def switch(xcp: Xcp, ecu: Ecu, reference: Calibration) -> i32:
    """Change pages; return the length of the response, 0 where it comes later, or the error."""
    mode: i32 = xcp.command[1]
    page: i32 = xcp.command[3]
    xcp.refused = 0
    if mode & (ECU | TOOL) == 0 or mode & OTHER_MODES != 0:
        return -MODE_NOT_VALID
    if xcp.command[2] != 0 and mode & ALL_SEGMENTS == 0:
        return -SEGMENT_NOT_VALID
    if page > WORKING:
        return -PAGE_NOT_VALID
    if mode & ECU != 0 and page == WORKING and xcp.ecu_page == REFERENCE:
        xcp.job = CHECK_RANGES
        xcp.job_mode = byte(mode)
        xcp.page_at = 0
        xcp.page_field = 0
        xcp.page_element = 0
        xcp.page_word = 0
        xcp.page_crc = 0
        return 0
    if mode & ECU != 0 and page == REFERENCE and xcp.ecu_page == WORKING:
        run_on(xcp, ecu, reference, REFERENCE)
    if mode & TOOL != 0:
        xcp.tool_page = byte(page)
    return 1


def copy(xcp: Xcp) -> i32:
    """Begin to copy the reference to the working page; return 0, or the error."""
    if xcp.command[1] != 0 or xcp.command[3] != 0:
        return -SEGMENT_NOT_VALID
    if xcp.command[2] != REFERENCE or xcp.command[4] != WORKING:
        return -PAGE_NOT_VALID
    if xcp.ecu_page == WORKING:
        return -WRITE_PROTECTED
    xcp.job = COPY
    xcp.page_at = 0
    return 0


def refuse(xcp: Xcp, rule: i32) -> i32:
    """End the job as ``check`` refuses the page; its rule is in the response."""
    xcp.job = IDLE
    xcp.refused = rule
    respond(xcp, 2, rule)
    return -PAGE_NOT_VALID


def check_elements(xcp: Xcp, working: Calibration) -> i32:
    """Check the next elements of the working page; return 0, or the error."""
    for _ in range(ELEMENTS):
        if xcp.page_field < FIELDS:
            field: i32 = clamp(xcp.page_field, 0, FIELDS - 1)
            bounds: i32 = RANGE[field]
            if fits(working, bounds, xcp.page_at) == 0:
                return refuse(xcp, field + 1)
            step: i32 = 4
            if bounds >= BYTES:
                step = 1
            xcp.page_at = clamp(xcp.page_at + step, 0, LAST_BYTE + 1)
            xcp.page_element = byte(xcp.page_element + 1)
            if xcp.page_element >= SIZE[field]:
                xcp.page_element = 0
                xcp.page_field = byte(clamp(field + 1, 0, FIELDS))
    if xcp.page_field == FIELDS:
        rule: i32 = check_rules(working)
        if rule != 0:
            return refuse(xcp, rule)
        xcp.job = CHECK_SUM
    return 0


def sum_words(xcp: Xcp, ecu: Ecu, working: Calibration) -> i32:
    """Take the next words into the CRC; after the last seal the page and change to it."""
    for _ in range(WORDS):
        if xcp.page_word < LAST_WORD:
            at: i32 = clamp(xcp.page_word, 0, LAST_WORD - 1)
            xcp.page_crc = to_i32(folded(to_u32(xcp.page_crc), checked_word(working, at)))
            xcp.page_word = at + 1
    if xcp.page_word < LAST_WORD:
        return 0
    set_word(working, LAST_WORD, xcp.page_crc)
    xcp.job = IDLE
    run_on(xcp, ecu, working, WORKING)
    if xcp.job_mode & TOOL != 0:
        xcp.tool_page = WORKING
    return 1


def copy_bytes(xcp: Xcp, reference: Calibration, working: Calibration) -> i32:
    """Copy the next bytes of the reference; return 1 after the last, else 0."""
    for _ in range(COPIED):
        if xcp.page_at <= LAST_BYTE:
            at: i32 = clamp(xcp.page_at, 0, LAST_BYTE)
            set_octet(working, at, octet(reference, at))
            xcp.page_at = at + 1
    if xcp.page_at <= LAST_BYTE:
        return 0
    xcp.job = IDLE
    return 1


def work(xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration) -> i32:
    """Do this tick's part of a job; return the length of the response, 0: later, or the error."""
    if xcp.job == CHECK_RANGES:
        return check_elements(xcp, working)
    if xcp.job == CHECK_SUM:
        return sum_words(xcp, ecu, working)
    if xcp.job == COPY:
        return copy_bytes(xcp, reference, working)
    return 0


def page(xcp: Xcp) -> i32:
    """Respond with the page that the loop, or the tool, uses."""
    mode: i32 = xcp.command[1]
    if xcp.command[2] != 0:
        return -SEGMENT_NOT_VALID
    if mode != ECU and mode != TOOL:
        return -MODE_NOT_VALID
    respond(xcp, 1, 0)
    xcp.tx_payload[RESPONSE][3] = xcp.ecu_page
    if mode == TOOL:
        xcp.tx_payload[RESPONSE][3] = xcp.tool_page
    return 4


def segment_info(xcp: Xcp) -> i32:
    """Respond with address and length of the calibration, or with the number of its pages."""
    mode: i32 = xcp.command[1]
    if xcp.command[2] != 0:
        return -SEGMENT_NOT_VALID
    if mode == 0 and xcp.command[3] <= 1:
        respond(xcp, 1, 0)
        respond(xcp, 4, xcp.page_address)
        if xcp.command[3] == 1:
            respond(xcp, 4, LAST_BYTE + 1)
        return 8
    if mode == 1:
        respond(xcp, 1, 2)
        respond(xcp, 2, 0)
        return 6
    return -OUT_OF_RANGE


def page_info(xcp: Xcp) -> i32:
    """Respond with what may be done with a page, and what it starts from."""
    if xcp.command[2] != 0:
        return -SEGMENT_NOT_VALID
    if xcp.command[3] > WORKING:
        return -PAGE_NOT_VALID
    # read by the loop and the tool at any time; the working page is written while the loop does
    # not run on it
    xcp.tx_payload[RESPONSE][1] = 0x0F
    if xcp.command[3] == WORKING:
        xcp.tx_payload[RESPONSE][1] = 0x1F
    xcp.tx_payload[RESPONSE][2] = 0
    return 3
