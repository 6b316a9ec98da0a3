"""Lists of measurements that the XCP slave samples after a tick and sends by itself.

A list has frames, a frame measurements of up to four bytes. Lists are made by the tool, in memory
that is here once. A list of which frames are still unsent is not sampled: an event tells.
"""

from canroll.extensions.services.modules.xcp_memory import (
    REACH,
    argument,
    fetch,
    on_page,
    place_of,
    respond,
    room,
    short_argument,
)
from canroll.extensions.services.modules.xcp_state import (
    ACCESS_DENIED,
    COMMAND_SENT,
    DAQ_ACTIVE,
    DAQ_CONFIG,
    ENTRY_BYTES,
    EVENT,
    EVERY_TICK,
    FIRST_ODT,
    FRAME,
    MEMORY_OVERFLOW,
    MODE_NOT_VALID,
    N_DAQ,
    N_ENTRIES,
    N_EVENTS,
    N_ODT,
    OUT_OF_RANGE,
    RESPONSE,
    SEQUENCE,
    STATE,
    TEXT,
    Xcp,
)
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import byte, bytes_of, clamp, i32, octet, tdiv

# phases of making lists
FREE = 1
HAS_LISTS = 2
HAS_ODTS = 3
HAS_ENTRIES = 4

TIMESTAMP = 16
TIMESTAMP_BYTES = 4
NO_BIT = 255
TICK_NAME = 7
TICK_LETTERS = 4
COMMAND_LETTERS = 7


def running(xcp: Xcp) -> i32:
    """Return 1 where a list is sampled."""
    for daq in range(N_DAQ):
        if xcp.daq_runs[daq] == 1:
            return 1
    return 0


def free(xcp: Xcp) -> i32:
    """Stop and forget all lists."""
    for daq in range(N_DAQ):
        xcp.daq_runs[daq] = 0
        xcp.daq_selected[daq] = 0
        xcp.daq_odts[daq] = 0
    for odt in range(N_ODT):
        xcp.odt_entries[odt] = 0
    xcp.lists = 0
    xcp.odts = 0
    xcp.entries = 0
    xcp.write_odt = N_ODT
    xcp.phase = FREE
    return 1


def allocate_lists(xcp: Xcp) -> i32:
    """Make lists; return the length of the response, or the error."""
    count: i32 = short_argument(xcp, 2)
    if xcp.phase != FREE:
        return -SEQUENCE
    if count > N_DAQ:
        return -MEMORY_OVERFLOW
    for daq in range(N_DAQ):
        xcp.daq_mode[daq] = 0
        xcp.daq_event[daq] = 0
        xcp.daq_prescaler[daq] = 1
        xcp.daq_priority[daq] = 0
        xcp.daq_counter[daq] = 0
    xcp.lists = byte(count)
    xcp.phase = HAS_LISTS
    return 1


def allocate_odts(xcp: Xcp) -> i32:
    """Make frames for a list; return the length of the response, or the error."""
    daq: i32 = short_argument(xcp, 2)
    count: i32 = xcp.command[4]
    if xcp.phase != HAS_LISTS and xcp.phase != HAS_ODTS:
        return -SEQUENCE
    if daq >= xcp.lists or daq >= N_DAQ:
        return -OUT_OF_RANGE
    if xcp.daq_odts[daq] != 0:
        return -SEQUENCE
    total: i32 = xcp.odts + count
    if total > N_ODT:
        return -MEMORY_OVERFLOW
    xcp.daq_first[daq] = xcp.odts
    xcp.daq_odts[daq] = byte(clamp(count, 0, N_ODT))
    xcp.odts = byte(total)
    xcp.phase = HAS_ODTS
    return 1


def odt_of(xcp: Xcp, daq: i32, odt: i32) -> i32:
    """Return the number of a list's frame among all, or -1 where there is none."""
    if daq >= xcp.lists or daq >= N_DAQ:
        return -1
    if odt >= xcp.daq_odts[daq]:
        return -1
    return clamp(xcp.daq_first[daq] + odt, 0, N_ODT - 1)


def allocate_entries(xcp: Xcp) -> i32:
    """Make measurements for a frame; return the length of the response, or the error."""
    count: i32 = xcp.command[5]
    odt: i32 = odt_of(xcp, short_argument(xcp, 2), xcp.command[4])
    if xcp.phase != HAS_ODTS and xcp.phase != HAS_ENTRIES:
        return -SEQUENCE
    if odt < 0:
        return -OUT_OF_RANGE
    if xcp.odt_entries[odt] != 0:
        return -SEQUENCE
    total: i32 = xcp.entries + count
    if total > N_ENTRIES:
        return -MEMORY_OVERFLOW
    for k in range(count):
        xcp.entry[clamp(xcp.entries + k, 0, N_ENTRIES - 1)] = 0
    xcp.odt_first[odt] = xcp.entries
    xcp.odt_entries[odt] = byte(clamp(count, 0, N_ENTRIES))
    xcp.odt_bytes[odt] = 0
    xcp.entries = byte(total)
    xcp.phase = HAS_ENTRIES
    return 1


def point(xcp: Xcp) -> i32:
    """Point at the measurement that is written next; return the length, or the error."""
    daq: i32 = short_argument(xcp, 2)
    odt: i32 = odt_of(xcp, daq, xcp.command[4])
    xcp.write_odt = N_ODT
    if odt < 0:
        return -OUT_OF_RANGE
    if xcp.daq_runs[clamp(daq, 0, N_DAQ - 1)] == 1:
        return -DAQ_ACTIVE
    if xcp.command[5] >= xcp.odt_entries[odt]:
        return -OUT_OF_RANGE
    xcp.write_odt = byte(odt)
    xcp.write_entry = byte(clamp(xcp.odt_first[odt] + xcp.command[5], 0, N_ENTRIES))
    return 1


def write(xcp: Xcp, ecu: Ecu) -> i32:
    """Write a measurement and point at the next; return the length, or the error."""
    count: i32 = xcp.command[2]
    if running(xcp) == 1:
        return -DAQ_ACTIVE
    if xcp.write_odt >= N_ODT or xcp.write_entry >= N_ENTRIES:
        return -DAQ_CONFIG
    odt: i32 = clamp(xcp.write_odt, 0, N_ODT - 1)
    at: i32 = clamp(xcp.write_entry, 0, N_ENTRIES - 1)
    if at >= xcp.odt_first[odt] + xcp.odt_entries[odt]:
        return -DAQ_CONFIG
    if xcp.command[1] != NO_BIT or count < 1 or count > ENTRY_BYTES:
        return -OUT_OF_RANGE
    place: i32 = place_of(xcp, ecu, xcp.command[3], argument(xcp, 4))
    if place < 0:
        return place
    if (place & REACH) + count > room(ecu, place >> 16):
        return -ACCESS_DENIED
    total: i32 = xcp.odt_bytes[odt] - (xcp.entry[at] >> 20) + count
    if total >= FRAME:
        return -DAQ_CONFIG
    xcp.odt_bytes[odt] = byte(clamp(total, 0, FRAME - 1))
    xcp.entry[at] = count << 20 | place & 0xFFFFF
    xcp.write_entry = byte(at + 1)
    return 1


def set_mode(xcp: Xcp) -> i32:
    """Set event, prescaler and time stamp of a list; return the length, or the error.

    Measurements only: a list that would write to the ECU (STIM) is refused.
    """
    mode: i32 = xcp.command[1]
    daq: i32 = short_argument(xcp, 2)
    event: i32 = short_argument(xcp, 4)
    if mode != 0 and mode != TIMESTAMP:
        return -MODE_NOT_VALID
    if daq >= xcp.lists or daq >= N_DAQ or event >= N_EVENTS or xcp.command[6] == 0:
        return -OUT_OF_RANGE
    if xcp.daq_runs[daq] == 1:
        return -DAQ_ACTIVE
    xcp.daq_mode[daq] = byte(mode)
    xcp.daq_event[daq] = byte(event)
    xcp.daq_prescaler[daq] = xcp.command[6]
    xcp.daq_priority[daq] = xcp.command[7]
    return 1


def get_mode(xcp: Xcp) -> i32:
    """Respond with mode, event and prescaler of a list; return the length, or the error."""
    daq: i32 = short_argument(xcp, 2)
    if daq >= xcp.lists or daq >= N_DAQ:
        return -OUT_OF_RANGE
    respond(xcp, 1, xcp.daq_mode[daq] | xcp.daq_selected[daq] | xcp.daq_runs[daq] << 6)
    respond(xcp, 4, xcp.daq_event[daq] | xcp.daq_prescaler[daq] << 16)
    xcp.tx_payload[RESPONSE][7] = xcp.daq_priority[daq]
    return 8


def ready(xcp: Xcp, daq: i32) -> i32:
    """Return 0 where a list can be sampled, or the error."""
    if xcp.daq_odts[daq] == 0:
        return -DAQ_CONFIG
    head: i32 = xcp.odt_bytes[clamp(xcp.daq_first[daq], 0, N_ODT - 1)]
    if xcp.daq_mode[daq] == TIMESTAMP and head + TIMESTAMP_BYTES >= FRAME:
        return -DAQ_CONFIG
    return 0


def begin(xcp: Xcp, daq: i32) -> None:
    """Sample a list from the next event on."""
    xcp.daq_runs[daq] = 1
    xcp.daq_counter[daq] = xcp.daq_prescaler[daq]


def start_or_stop(xcp: Xcp) -> i32:
    """Start, stop or select a list; respond with its first frame; return the length, or error."""
    mode: i32 = xcp.command[1]
    daq: i32 = short_argument(xcp, 2)
    if daq >= xcp.lists or daq >= N_DAQ:
        return -OUT_OF_RANGE
    if mode > 2:
        return -MODE_NOT_VALID
    if mode == 0:
        xcp.daq_runs[daq] = 0
        xcp.daq_selected[daq] = 0
    else:
        error: i32 = ready(xcp, daq)
        if error != 0:
            return error
        if mode == 1:
            begin(xcp, daq)
        else:
            xcp.daq_selected[daq] = 1
    xcp.tx_payload[RESPONSE][1] = xcp.daq_first[daq]
    return 2


def start_or_stop_together(xcp: Xcp) -> i32:
    """Stop all lists, or start or stop the selected ones; return the length, or the error."""
    mode: i32 = xcp.command[1]
    if mode > 2:
        return -MODE_NOT_VALID
    for daq in range(N_DAQ):
        if mode == 0:
            xcp.daq_runs[daq] = 0
        elif xcp.daq_selected[daq] == 1:
            if mode == 1:
                begin(xcp, daq)
            else:
                xcp.daq_runs[daq] = 0
        xcp.daq_selected[daq] = 0
    return 1


def processor_info(xcp: Xcp) -> i32:
    """Respond with what lists can do: made by the tool, prescaler, time stamp, overload event."""
    respond(xcp, 1, 0x93 | xcp.lists << 8)
    respond(xcp, 4, N_EVENTS)
    return 8


def resolution_info(xcp: Xcp) -> i32:
    """Respond with sizes of measurements and time stamps: four bytes in microseconds."""
    respond(xcp, 1, 1 | ENTRY_BYTES << 8 | 1 << 16)
    respond(xcp, 4, 0x34 << 8 | 1 << 16)
    return 8


def event_info(xcp: Xcp, tick_us: i32) -> i32:
    """Respond with an event's period and point at its name; return the length, or the error."""
    event: i32 = short_argument(xcp, 2)
    if event >= N_EVENTS:
        return -OUT_OF_RANGE
    xcp.pointer = TEXT
    xcp.pointer_offset = TICK_NAME
    letters: i32 = TICK_LETTERS
    # in units of 1 ms, else of 100 us
    period: i32 = tdiv(tick_us, 1000)
    unit: i32 = 6
    if 1000 * period != tick_us:
        period = tdiv(tick_us, 100)
        unit = 5
    if event == COMMAND_SENT:
        xcp.pointer_offset = TICK_NAME + TICK_LETTERS
        letters = COMMAND_LETTERS
        period = 0
    respond(xcp, 1, 0x04 | N_DAQ << 8 | letters << 16)
    respond(xcp, 4, period | unit << 8)
    return 7


def unsent(xcp: Xcp, first: i32, last: i32) -> i32:
    """Return 1 where one of the frames from ``first`` to before ``last`` waits to be sent."""
    for odt in range(first, last):
        if xcp.tx_pending[FIRST_ODT + clamp(odt, 0, N_ODT - 1)] == 1:
            return 1
    return 0


def fill(xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration, odt: i32) -> None:
    """Put the measurements of a frame behind what it has and mark it for sending."""
    slot: i32 = FIRST_ODT + odt
    place: i32 = xcp.tx_length[slot]
    last: i32 = bytes_of(ecu) - 4
    first: i32 = xcp.odt_first[odt]
    end: i32 = first + xcp.odt_entries[odt]
    for k in range(first, end):
        entry: i32 = xcp.entry[clamp(k, 0, N_ENTRIES - 1)]
        offset: i32 = entry & REACH
        kind: i32 = entry >> 16
        # four bytes of the state, which most measurements are, as memory has them
        if kind == (ENTRY_BYTES << 4 | STATE) and place <= FRAME - 4:
            at: i32 = clamp(offset, 0, last)
            p: i32 = clamp(place, 0, FRAME - 4)
            xcp.tx_payload[slot][p] = octet(ecu, at)
            xcp.tx_payload[slot][p + 1] = octet(ecu, at + 1)
            xcp.tx_payload[slot][p + 2] = octet(ecu, at + 2)
            xcp.tx_payload[slot][p + 3] = octet(ecu, at + 3)
            place += 4
        else:
            region: i32 = on_page(kind & 15, xcp.ecu_page)
            count: i32 = kind >> 4
            for b in range(count):
                xcp.tx_payload[slot][clamp(place, 0, FRAME - 1)] = fetch(
                    ecu, reference, working, region, offset + b
                )
                place = clamp(place + 1, 0, FRAME)
    xcp.tx_length[slot] = byte(clamp(place, 0, FRAME))
    xcp.tx_pending[slot] = 1


def sample(xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration, daq: i32) -> None:
    """Fill all frames of a list; an event where earlier ones are not sent yet."""
    first: i32 = xcp.daq_first[daq]
    last: i32 = clamp(first + xcp.daq_odts[daq], 0, N_ODT)
    if unsent(xcp, first, last) == 1:
        xcp.tx_payload[EVENT][0] = 0xFD
        xcp.tx_payload[EVENT][1] = 0x06
        xcp.tx_length[EVENT] = 2
        xcp.tx_pending[EVENT] = 1
        return
    for odt in range(first, last):
        slot: i32 = clamp(odt, 0, N_ODT - 1)
        xcp.tx_payload[FIRST_ODT + slot][0] = byte(odt)
        xcp.tx_length[FIRST_ODT + slot] = 1
        if odt == first and xcp.daq_mode[daq] == TIMESTAMP:
            xcp.tx_payload[FIRST_ODT + slot][1] = byte(xcp.time)
            xcp.tx_payload[FIRST_ODT + slot][2] = byte(xcp.time >> 8)
            xcp.tx_payload[FIRST_ODT + slot][3] = byte(xcp.time >> 16)
            xcp.tx_payload[FIRST_ODT + slot][4] = byte(xcp.time >> 24)
            xcp.tx_length[FIRST_ODT + slot] = 1 + TIMESTAMP_BYTES
        fill(xcp, ecu, reference, working, slot)


def sample_lists(xcp: Xcp, ecu: Ecu, reference: Calibration, working: Calibration) -> None:
    """Sample the lists whose event has come often enough."""
    for daq in range(N_DAQ):
        if xcp.daq_runs[daq] == 1:
            if xcp.daq_event[daq] == EVERY_TICK or ecu.triggered != 0:
                if xcp.daq_counter[daq] >= xcp.daq_prescaler[daq]:
                    xcp.daq_counter[daq] = 0
                    sample(xcp, ecu, reference, working, daq)
                xcp.daq_counter[daq] = byte(clamp(xcp.daq_counter[daq] + 1, 0, 255))
