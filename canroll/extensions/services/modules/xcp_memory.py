"""Memory of the XCP slave: the two records by their addresses, transfers of a few bytes."""

from canroll.extensions.services.modules.xcp_state import (
    ACCESS_DENIED,
    CALIBRATION,
    FRAME,
    OUT_OF_RANGE,
    REFERENCE,
    RESPONSE,
    STATE,
    TEXT,
    WORKING,
    WORKING_PAGE,
    WRITE_PROTECTED,
    Xcp,
)
from canroll.firmware.calibration import Calibration
from canroll.firmware.limits import LAST_BYTE
from canroll.firmware.state import Ecu
from canroll.firmware.subset import (
    byte,
    bytes_of,
    clamp,
    i32,
    i64,
    octet,
    set_octet,
    to_i32,
    to_u32,
    u8,
    u32,
)

# "canroll", "tick", "command"
TEXTS: tuple[u8, ...] = (
    99, 97, 110, 114, 111, 108, 108, 116, 105, 99, 107, 99, 111, 109, 109, 97, 110, 100,
)  # fmt: skip
TEXT_BYTES = 18
MASK = 0xFFFFFFFF
REACH = 0xFFFF


def argument(xcp: Xcp, at: i32) -> i32:
    """Return the 32 bits at byte ``at`` of the command, 0 to 4."""
    k: i32 = clamp(at, 0, FRAME - 4)
    low: u32 = xcp.command[k] | xcp.command[k + 1] << 8
    high: u32 = xcp.command[k + 2] | xcp.command[k + 3] << 8
    return to_i32(low | high << 16)


def short_argument(xcp: Xcp, at: i32) -> i32:
    """Return the 16 bits at byte ``at`` of the command, 0 to 6."""
    k: i32 = clamp(at, 0, FRAME - 2)
    return xcp.command[k] | xcp.command[k + 1] << 8


def respond(xcp: Xcp, at: i32, value: i32) -> None:
    """Put 32 bits at byte ``at`` of the response, 0 to 4."""
    k: i32 = clamp(at, 0, FRAME - 4)
    xcp.tx_payload[RESPONSE][k] = byte(value)
    xcp.tx_payload[RESPONSE][k + 1] = byte(value >> 8)
    xcp.tx_payload[RESPONSE][k + 2] = byte(value >> 16)
    xcp.tx_payload[RESPONSE][k + 3] = byte(value >> 24)


def room(ecu: Ecu, region: i32) -> i32:
    """Return the bytes of what a pointer points into."""
    if region == STATE:
        return bytes_of(ecu)
    if region == CALIBRATION:
        return LAST_BYTE + 1
    if region == TEXT:
        return TEXT_BYTES
    return 0


def place_of(xcp: Xcp, ecu: Ecu, extension: i32, address: i32) -> i32:
    """Return what an address is in << 16 with the byte there, or the error negated."""
    if extension != 0:
        return -OUT_OF_RANGE
    offset: i64 = (to_u32(address) - to_u32(xcp.state_address)) & MASK
    if offset < bytes_of(ecu):
        return STATE << 16 | clamp(offset, 0, REACH)
    offset = (to_u32(address) - to_u32(xcp.page_address)) & MASK
    if offset <= LAST_BYTE:
        return CALIBRATION << 16 | clamp(offset, 0, REACH)
    return -ACCESS_DENIED


def point_at(xcp: Xcp, ecu: Ecu) -> i32:
    """Point at the address in the command; return the length of the response, or the error."""
    place: i32 = place_of(xcp, ecu, xcp.command[3], argument(xcp, 4))
    if place < 0:
        return place
    xcp.pointer = byte(place >> 16)
    xcp.pointer_offset = place & REACH
    return 1


def on_page(region: i32, page: i32) -> i32:
    """Return ``region``, or the working page where that is the calibration's."""
    if region == CALIBRATION and page == WORKING:
        return WORKING_PAGE
    return region


def fetch(ecu: Ecu, reference: Calibration, working: Calibration, region: i32, at: i32) -> u8:
    """Return a byte of the state, of a page of the calibration or of the texts."""
    if region == STATE:
        return octet(ecu, clamp(at, 0, bytes_of(ecu) - 1))
    if region == TEXT:
        return TEXTS[clamp(at, 0, TEXT_BYTES - 1)]
    if region == WORKING_PAGE:
        return octet(working, clamp(at, 0, LAST_BYTE))
    return octet(reference, clamp(at, 0, LAST_BYTE))


def upload(xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration) -> i32:
    """Respond with so many bytes as the command asks for; return the length, or the error."""
    count: i32 = xcp.command[1]
    if count < 1 or count >= FRAME:
        return -OUT_OF_RANGE
    if xcp.pointer_offset + count > room(ecu, xcp.pointer):
        return -ACCESS_DENIED
    region: i32 = on_page(xcp.pointer, xcp.tool_page)
    for k in range(count):
        xcp.tx_payload[RESPONSE][k + 1] = fetch(
            ecu, reference, working, region, xcp.pointer_offset + k
        )
    xcp.pointer_offset = clamp(xcp.pointer_offset + count, 0, REACH)
    return count + 1


def download(xcp: Xcp, working: Calibration, first: i32, count: i32) -> i32:
    """Write ``count`` bytes of the command to the working page; return the length, or the error.

    The page on which the loop runs is not written.
    """
    if count < 1 or first + count > FRAME:
        return -OUT_OF_RANGE
    if xcp.pointer != CALIBRATION:
        return -WRITE_PROTECTED
    if xcp.tool_page == REFERENCE or xcp.ecu_page == WORKING:
        return -WRITE_PROTECTED
    if xcp.pointer_offset + count > LAST_BYTE + 1:
        return -ACCESS_DENIED
    for k in range(count):
        at: i32 = clamp(xcp.pointer_offset + k, 0, LAST_BYTE)
        set_octet(working, at, xcp.command[clamp(first + k, 0, FRAME - 1)])
    xcp.pointer_offset = clamp(xcp.pointer_offset + count, 0, REACH)
    return 1
