"""The record of the XCP slave: session, mailboxes, lists of measurements, calibration page.

XCP on CAN (ASAM MCD-1 XCP 1.3) with frames of 8 bytes. The slave reads the ECU's two records and
nothing else; it writes nothing but the working page, a second calibration record.
"""

from typing import Annotated

from canroll.firmware.limits import FIELDS, LAST_BYTE, LAST_WORD
from canroll.firmware.subset import I32_MAX, I32_MIN, F, i32, record, u8

# errors, as the standard numbers them
BUSY = 0x10
DAQ_ACTIVE = 0x11
UNKNOWN = 0x20
SYNTAX = 0x21
OUT_OF_RANGE = 0x22
WRITE_PROTECTED = 0x23
ACCESS_DENIED = 0x24
PAGE_NOT_VALID = 0x26
MODE_NOT_VALID = 0x27
SEGMENT_NOT_VALID = 0x28
SEQUENCE = 0x29
DAQ_CONFIG = 0x2A
MEMORY_OVERFLOW = 0x30

# what the pointer of a transfer points into
NOWHERE = 0
STATE = 1
CALIBRATION = 2
TEXT = 3
WORKING_PAGE = 4

# jobs over several ticks
IDLE = 0
CHECK_RANGES = 1
CHECK_SUM = 2
COPY = 3

# pages of the calibration
REFERENCE = 0
WORKING = 1

# memory of lists: lists, frames of measurements, measurements
N_DAQ = 4
N_ODT = 32
N_ENTRIES = 96
N_EVENTS = 2
EVERY_TICK = 0
COMMAND_SENT = 1

# frames to send: the response, an event, one for each frame of measurements
RESPONSE = 0
EVENT = 1
FIRST_ODT = 2
N_SLOTS = FIRST_ODT + N_ODT
FRAME = 8
# the longest measurement; longer ones are several
ENTRY_BYTES = 4


@record
class Xcp:
    """The XCP slave; the caller owns it, ``init`` fills it."""

    # addresses by which the tool names the records
    state_address: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "of the state, 32 bits")]
    page_address: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "of the calibration, 32 bits")]

    # session
    time: Annotated[i32, F(I32_MIN, I32_MAX, 0, "us", "time stamp, 32 bits, wraps")]
    pointer_offset: Annotated[i32, F(0, 0xFFFF, 0, "", "byte of the next transfer")]

    # job on the working page
    page_at: Annotated[i32, F(0, LAST_BYTE + 1, 0, "", "byte of the next element")]
    page_word: Annotated[i32, F(0, LAST_WORD + 1, 0, "", "next word")]
    page_crc: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "CRC of its words so far, inverted")]
    refused: Annotated[i32, F(0, 1000, 0, "", "rule by which a page was last refused, 0: none")]

    # measurements: size << 20, what it points into << 16, byte
    entry: Annotated[list[i32], N_ENTRIES, F(0, (1 << 24) - 1, 0, "", "0: not written")]

    # mailboxes: receive() writes the first three, tick() reads them
    rx_payload: Annotated[list[u8], FRAME, F(0, 255, 0, "", "command", True)]
    rx_length: Annotated[u8, F(0, FRAME, 0, "", "bytes of it", True)]
    rx_fresh: Annotated[u8, F(0, 1, 0, "", "1: not read yet", True)]
    tx_payload: Annotated[list[list[u8]], N_SLOTS, FRAME, F(0, 255, 0, "", "bytes to send")]
    tx_length: Annotated[list[u8], N_SLOTS, F(0, FRAME, 0, "", "number of them")]
    tx_pending: Annotated[list[u8], N_SLOTS, F(0, 1, 0, "", "1: to be sent; the sender clears it")]

    # session
    connected: Annotated[u8, F(0, 1, 0, "", "1: a tool is connected")]
    command: Annotated[list[u8], FRAME, F(0, 255, 0, "", "the command being executed")]
    pointer: Annotated[u8, F(0, 15, 0, "", "0 nowhere 1 state 2 calibration 3 text")]

    # pages
    ecu_page: Annotated[u8, F(0, 1, 0, "", "the loop runs on 0 reference 1 working page")]
    tool_page: Annotated[u8, F(0, 1, 0, "", "the tool reads 0 reference 1 working page")]
    job: Annotated[u8, F(0, COPY, 0, "", "0 none 1 ranges 2 CRC of the working page 3 copy to it")]
    job_mode: Annotated[u8, F(0, 255, 0, "", "mode of the page switch that the job is for")]
    page_field: Annotated[u8, F(0, FIELDS, 0, "", "field of the next element")]
    page_element: Annotated[u8, F(0, 255, 0, "", "number of it in the field")]

    # lists of measurements
    phase: Annotated[u8, F(0, 4, 0, "", "1 free 2 has lists 3 frames 4 measurements")]
    lists: Annotated[u8, F(0, N_DAQ, 0, "", "allocated")]
    odts: Annotated[u8, F(0, N_ODT, 0, "", "allocated")]
    entries: Annotated[u8, F(0, N_ENTRIES, 0, "", "allocated")]
    daq_first: Annotated[list[u8], N_DAQ, F(0, N_ODT, 0, "", "its first frame")]
    daq_odts: Annotated[list[u8], N_DAQ, F(0, N_ODT, 0, "", "number of its frames")]
    daq_mode: Annotated[list[u8], N_DAQ, F(0, 255, 0, "", "16: with a time stamp")]
    daq_event: Annotated[list[u8], N_DAQ, F(0, N_EVENTS - 1, 0, "", "sampled at this event")]
    daq_prescaler: Annotated[list[u8], N_DAQ, F(0, 255, 0, "", "of so many events one counts")]
    daq_priority: Annotated[list[u8], N_DAQ, F(0, 255, 0, "", "as told; all are sampled alike")]
    daq_counter: Annotated[list[u8], N_DAQ, F(0, 255, 0, "", "events since the last sample")]
    daq_runs: Annotated[list[u8], N_DAQ, F(0, 1, 0, "", "1: sampled")]
    daq_selected: Annotated[list[u8], N_DAQ, F(0, 1, 0, "", "1: to be started or stopped")]
    odt_first: Annotated[list[u8], N_ODT, F(0, N_ENTRIES, 0, "", "its first measurement")]
    odt_entries: Annotated[list[u8], N_ODT, F(0, N_ENTRIES, 0, "", "number of them")]
    odt_bytes: Annotated[list[u8], N_ODT, F(0, FRAME - 1, 0, "", "bytes of all of them")]
    write_odt: Annotated[u8, F(0, N_ODT, 0, "", "frame of the next one written, 32: none")]
    write_entry: Annotated[u8, F(0, N_ENTRIES, 0, "", "number of it")]
