"""The diagnostic server beside the loop: ``init``, ``receive``, ``tick``.

UDS by physical addressing: sessions, fault codes with status and snapshot, data by identifier,
tester present. The caller owns its record, calls ``receive`` for every frame of the tester, which
may be from an interrupt, and ``tick`` after each tick of the loop; then it sends ``tx_payload``
where ``tx_pending`` is 1 and clears it.
"""

from typing import Annotated

from canroll.extensions.services.modules.fault_memory import (
    ALL,
    AVAILABLE,
    FAMILY,
    RECORD,
    count,
    forget,
    keep_snapshots,
    put_codes,
    put_number,
    put_snapshot,
)
from canroll.extensions.services.modules.isotp import (
    continue_response,
    pass_time,
    put,
    read,
    respond,
)
from canroll.extensions.services.modules.uds_state import (
    DEFAULT,
    EXTENDED,
    FRAME,
    RESTING,
    TIMER_MAX,
    Uds,
)
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import N_FAULT_CODES, Ecu
from canroll.firmware.subset import byte, clamp, clear, i32, u8

__all__ = ["init", "receive", "tick"]

SESSION_CONTROL = 0x10
CLEAR_FAULTS = 0x14
READ_FAULTS = 0x19
READ_DATA = 0x22
TESTER_PRESENT = 0x3E
POSITIVE = 0x40
NEGATIVE = 0x7F
SUPPRESSED = 0x80

# negative responses
NO_SERVICE = 0x11
NO_SUBFUNCTION = 0x12
WRONG_LENGTH = 0x13
TOO_LONG = 0x14
OUT_OF_RANGE = 0x31
NOT_IN_SESSION = 0x7F

# subfunctions of READ_FAULTS
NUMBER_BY_STATUS = 1
BY_STATUS = 2
SNAPSHOT = 4
SUPPORTED = 0x0A

# data by identifier, four bytes but where the comment says one
DID_MODE = 0x0100  # one
DID_TIME = 0x0101
DID_SPEED = 0x0102
DID_ROLL_RATE = 0x0103
DID_ACCELERATION = 0x0104
DID_MOMENT = 0x0105
DID_COMMANDS = 0x0106
DID_CALIBRATION = 0x0110
DID_CRC = 0x0111
DID_SESSION = 0xF186  # one
DATA_MAX = 16

# S3: the extended session ends without requests for so long
SESSION_US = 5_000_000
# P2 and P2*, in the units of the response
P2_MS = 50
P2_STAR_10MS = 500


def init(uds: Uds, ecu: Ecu) -> None:
    """Start in the default session; fault codes that are latched already get a snapshot of now."""
    clear(uds)
    uds.session = DEFAULT
    keep_snapshots(uds, ecu)


def receive(uds: Uds, payload: Annotated[list[u8], FRAME], length: i32) -> None:
    """Store a frame; one that comes before the last is read is dropped."""
    if length < 1 or uds.rx_fresh != 0:
        return
    size: i32 = clamp(length, 1, FRAME)
    for k in range(size):
        uds.rx_payload[k] = payload[k]
    uds.rx_fresh = byte(size)


def change_session(uds: Uds) -> i32:
    """Change the session; return 0, or the negative response."""
    if uds.request_size != 2:
        return WRONG_LENGTH
    wanted: i32 = uds.request[1] & 127
    if wanted != DEFAULT and wanted != EXTENDED:
        return NO_SUBFUNCTION
    uds.session = byte(wanted)
    put(uds, wanted)
    put(uds, P2_MS >> 8)
    put(uds, P2_MS & 255)
    put(uds, P2_STAR_10MS >> 8)
    put(uds, P2_STAR_10MS & 255)
    return 0


def clear_faults(uds: Uds, ecu: Ecu) -> i32:
    """Clear all fault codes, in the extended session; return 0, or the negative response."""
    if uds.session != EXTENDED:
        return NOT_IN_SESSION
    if uds.request_size != 4:
        return WRONG_LENGTH
    if uds.request[1] != ALL or uds.request[2] != ALL or uds.request[3] != ALL:
        return OUT_OF_RANGE
    forget(uds, ecu)
    return 0


def read_snapshot(uds: Uds, ecu: Ecu) -> i32:
    """Respond with the snapshot of a fault code; return 0, or the negative response."""
    if uds.request_size != 6:
        return WRONG_LENGTH
    code: i32 = uds.request[3]
    number: i32 = uds.request[5]
    if uds.request[2] != FAMILY or code >= N_FAULT_CODES or uds.request[4] != 0:
        return OUT_OF_RANGE
    if number != RECORD and number != ALL:
        return OUT_OF_RANGE
    put(uds, SNAPSHOT)
    put_snapshot(uds, ecu, code)
    return 0


def read_faults(uds: Uds, ecu: Ecu) -> i32:
    """Respond with fault codes; return 0, or the negative response."""
    if uds.request_size < 2:
        return WRONG_LENGTH
    kind: i32 = uds.request[1] & 127
    mask: i32 = uds.request[2] & AVAILABLE
    if kind == SNAPSHOT:
        return read_snapshot(uds, ecu)
    if kind == SUPPORTED:
        if uds.request_size != 2:
            return WRONG_LENGTH
        put(uds, kind)
        put(uds, AVAILABLE)
        put_codes(uds, ecu, 0)
        return 0
    if kind != NUMBER_BY_STATUS and kind != BY_STATUS:
        return NO_SUBFUNCTION
    if uds.request_size != 3:
        return WRONG_LENGTH
    put(uds, kind)
    put(uds, AVAILABLE)
    if kind == NUMBER_BY_STATUS:
        number: i32 = count(uds, ecu, mask)
        # numbers are as ISO 14229-1 has them
        put(uds, 1)
        put(uds, 0)
        put(uds, number)
    elif mask != 0:
        put_codes(uds, ecu, mask)
    return 0


def put_data(uds: Uds, ecu: Ecu, cal: Calibration, identifier: i32) -> i32:
    """Append a value with its identifier; return 1, or 0 where there is none."""
    value: i32 = 0
    if identifier == DID_MODE or identifier == DID_SESSION:
        put(uds, identifier >> 8)
        put(uds, identifier & 255)
        if identifier == DID_MODE:
            put(uds, ecu.mode)
        else:
            put(uds, uds.session)
        return 1
    if identifier == DID_TIME:
        value = ecu.time
    elif identifier == DID_SPEED:
        value = ecu.speed
    elif identifier == DID_ROLL_RATE:
        value = ecu.roll_rate
    elif identifier == DID_ACCELERATION:
        value = ecu.lateral_acceleration
    elif identifier == DID_MOMENT:
        value = ecu.moment
    elif identifier == DID_COMMANDS:
        value = ecu.commands_sent
    elif identifier == DID_CALIBRATION:
        value = cal.id
    elif identifier == DID_CRC:
        value = cal.crc
    else:
        return 0
    put(uds, identifier >> 8)
    put(uds, identifier & 255)
    put_number(uds, value)
    return 1


def read_data(uds: Uds, ecu: Ecu, cal: Calibration) -> i32:
    """Respond with the data that there are; return 0, or the negative response."""
    size: i32 = uds.request_size - 1
    if size < 2 or (size & 1) != 0:
        return WRONG_LENGTH
    if size > 2 * DATA_MAX:
        return TOO_LONG
    known: i32 = 0
    for k in range(DATA_MAX):
        if 2 * k < size:
            identifier: i32 = uds.request[2 * k + 1] << 8 | uds.request[2 * k + 2]
            known += put_data(uds, ecu, cal, identifier)
    if known == 0:
        return OUT_OF_RANGE
    return 0


def present(uds: Uds) -> i32:
    """Keep the session; return 0, or the negative response."""
    if uds.request_size != 2:
        return WRONG_LENGTH
    if uds.request[1] & 127 != 0:
        return NO_SUBFUNCTION
    put(uds, 0)
    return 0


def execute(uds: Uds, ecu: Ecu, cal: Calibration, service: i32) -> i32:
    """Execute a request; return 0, or the negative response."""
    if service == SESSION_CONTROL:
        return change_session(uds)
    if service == TESTER_PRESENT:
        return present(uds)
    if service == READ_FAULTS:
        return read_faults(uds, ecu)
    if service == READ_DATA:
        return read_data(uds, ecu, cal)
    if service == CLEAR_FAULTS:
        return clear_faults(uds, ecu)
    return NO_SERVICE


def serve(uds: Uds, ecu: Ecu, cal: Calibration) -> None:
    """Answer a request; a positive response may be suppressed, a negative one not."""
    service: i32 = uds.request[0]
    quiet: i32 = uds.request[1] & SUPPRESSED
    uds.tester_at = 0
    uds.response_size = 0
    put(uds, service + POSITIVE)
    error: i32 = execute(uds, ecu, cal, service)
    if error != 0:
        uds.response_size = 0
        put(uds, NEGATIVE)
        put(uds, service)
        put(uds, error)
    elif service != CLEAR_FAULTS and service != READ_DATA and quiet != 0:
        return
    respond(uds)


def tick(uds: Uds, ecu: Ecu, cal: Calibration, elapsed_ticks: i32) -> None:
    """Keep snapshots, read a frame and send one, after a tick of the loop."""
    passed: i32 = clamp(elapsed_ticks, 1, 1 << 10) * cal.tick_us
    keep_snapshots(uds, ecu)
    pass_time(uds, passed)
    uds.tester_at = clamp(uds.tester_at + passed, 0, TIMER_MAX)
    if uds.tester_at > SESSION_US and uds.response_state == RESTING:
        uds.session = DEFAULT
    if uds.rx_fresh != 0:
        complete: i32 = read(uds, cal.tick_us)
        if complete == 1:
            serve(uds, ecu, cal)
    continue_response(uds)
