"""The XCP slave: transfers, pages, lists of measurements, and all that it refuses."""

import random
import struct
from itertools import pairwise

import pytest
from support.xcp_tool import Tool, address_of, word

from canroll.codegen.generated.bus_map import MOST_LISTED
from canroll.codegen.run import ecu_traffic, memory_image, native
from canroll.codegen.run.backends import NativeEcu, PythonEcu
from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.codegen.run.services import ServedEcu
from canroll.extensions.services.modules import xcp, xcp_state
from canroll.extensions.services.modules.xcp_state import (
    ACCESS_DENIED,
    BUSY,
    DAQ_ACTIVE,
    DAQ_CONFIG,
    MEMORY_OVERFLOW,
    MODE_NOT_VALID,
    OUT_OF_RANGE,
    PAGE_NOT_VALID,
    SEGMENT_NOT_VALID,
    SEQUENCE,
    SYNTAX,
    UNKNOWN,
    WRITE_PROTECTED,
)
from canroll.extensions.services.running import PAGE_ADDRESS, STATE_ADDRESS
from canroll.firmware.calibration import Calibration
from canroll.firmware.check import RULE_FADE
from canroll.firmware.limits import LAST_BYTE
from canroll.firmware.state import SAFE, Ecu
from canroll.firmware.subset import bytes_of, fields

SERVED = with_services(built_in(), ("xcp",))
OK = b"\xff"
needs_cc = pytest.mark.skipif(native.compiler() is None, reason="needs cc (package gcc)")


@pytest.fixture(params=["python", pytest.param("native", marks=needs_cc)])
def tool(request):
    record = ecu_traffic.random_calibration(3)
    kind = PythonEcu if request.param == "python" else NativeEcu
    found = Tool(ServedEcu(kind(record, SERVED)))
    assert found.ask(xcp.CONNECT, 0)[0] == 0xFF
    return found


def commanding(tool):
    """Leave INIT, in which no command is sent."""
    record = tool.ecu.ecu.record
    if isinstance(record, native.NativeRecord):
        record.array["mode"] = SAFE
    else:
        record.value.mode = SAFE


def refused(code, *rest):
    return bytes([0xFE, code, *rest])


def change(tool, name, *values):
    """Write bytes of a field of the working page."""
    assert tool.ask(xcp.SET_CAL_PAGE, 2, 0, 1) == OK
    assert tool.ask(xcp.SET_MTA, 0, 0, 0, *word(address_of(name, Calibration))) == OK
    assert tool.ask(xcp.DOWNLOAD, len(values), *values) == OK


def test_a_tool_reads_both_records_and_nothing_else(tool):
    record = ecu_traffic.random_calibration(3)
    image = memory_image.image(record)
    assert tool.ask(xcp.SET_MTA, 0, 0, 0, *word(PAGE_ADDRESS)) == OK
    read = b"".join(tool.ask(xcp.UPLOAD, 4)[1:] for _ in range(len(image) // 4))
    assert read == image
    assert tool.ask(xcp.UPLOAD, 1) == refused(ACCESS_DENIED)
    size = bytes_of(Ecu())
    last = tool.ask(xcp.SHORT_UPLOAD, 1, 0, 0, *word(STATE_ADDRESS + size - 1))
    assert last == OK + tool.ecu.image()[size - 1 : size]
    time = tool.ask(xcp.SHORT_UPLOAD, 4, 0, 0, *word(address_of("time", Ecu)))
    assert struct.unpack("<xi", time)[0] == tool.ticks
    for address, count in (
        (STATE_ADDRESS - 1, 1),
        (STATE_ADDRESS + size, 1),
        (STATE_ADDRESS + size - 1, 2),
        (PAGE_ADDRESS - 1, 1),
        (PAGE_ADDRESS + len(image) - 2, 4),
        (0, 1),
    ):
        asked = tool.ask(xcp.SHORT_UPLOAD, count, 0, 0, *word(address))
        assert asked == refused(ACCESS_DENIED), hex(address)
    assert tool.ask(xcp.SHORT_UPLOAD, 1, 0, 1, *word(PAGE_ADDRESS)) == refused(OUT_OF_RANGE)
    assert tool.ask(xcp.SHORT_UPLOAD, 8, 0, 0, *word(PAGE_ADDRESS)) == refused(OUT_OF_RANGE)


def test_only_the_working_page_is_written(tool):
    at = word(address_of("heartbeat_ticks", Calibration))
    assert tool.ask(xcp.SET_MTA, 0, 0, 0, *at) == OK
    assert tool.ask(xcp.DOWNLOAD, 1, 7) == refused(WRITE_PROTECTED)
    change(tool, "heartbeat_ticks", 7, 0, 0, 0)
    assert tool.ask(xcp.SHORT_UPLOAD, 4, 0, 0, *at) == OK + word(7)
    assert tool.ask(xcp.SET_CAL_PAGE, 2, 0, 0) == OK
    before = ecu_traffic.random_calibration(3).heartbeat_ticks
    assert tool.ask(xcp.SHORT_UPLOAD, 4, 0, 0, *at) == OK + word(before)
    assert tool.ask(xcp.SET_CAL_PAGE, 2, 0, 1) == OK
    assert tool.ask(xcp.SET_MTA, 0, 0, 0, *word(STATE_ADDRESS)) == OK
    assert tool.ask(xcp.DOWNLOAD, 1, 7) == refused(WRITE_PROTECTED)
    assert tool.ask(xcp.SET_MTA, 0, 0, 0, *word(PAGE_ADDRESS + LAST_BYTE - 1)) == OK
    assert tool.ask(xcp.DOWNLOAD_MAX, *range(7)) == refused(ACCESS_DENIED)
    assert tool.ask(xcp.COPY_CAL_PAGE, 0, 0, 0, 1) == OK
    assert tool.ask(xcp.SHORT_UPLOAD, 4, 0, 0, *at) == OK + word(before)


def test_the_loop_changes_to_a_page_that_check_accepts(tool):
    change(tool, "heartbeat_ticks", 3, 0, 0, 0)
    assert tool.ask(xcp.GET_CAL_PAGE, 1, 0) == OK + b"\0\0\0"
    began = tool.ticks
    assert tool.ask(xcp.SET_CAL_PAGE, 3, 0, 1) == OK
    assert 50 < tool.ticks - began < 120
    assert tool.ask(xcp.GET_CAL_PAGE, 1, 0) == OK + b"\0\0\1"
    record = ecu_traffic.random_calibration(3)
    record.heartbeat_ticks = 3
    crc = memory_image.sealed(record).crc & 0xFFFFFFFF
    at = word(address_of("crc", Calibration))
    assert tool.ask(xcp.SHORT_UPLOAD, 4, 0, 0, *at) == OK + word(crc)
    # it is the page that the loop runs on and watches
    for _ in range(900):
        tool.tick()
    state = tool.ecu.state
    assert state.calibration_word != 1 << 12 and state.refused == 0
    assert tool.ask(xcp.SET_MTA, 0, 0, 0, *word(PAGE_ADDRESS)) == OK
    assert tool.ask(xcp.DOWNLOAD, 1, 1) == refused(WRITE_PROTECTED)
    assert tool.ask(xcp.COPY_CAL_PAGE, 0, 0, 0, 1) == refused(WRITE_PROTECTED)
    assert tool.ask(xcp.SET_CAL_PAGE, 1, 0, 0) == OK
    for _ in range(900):
        tool.tick()
    assert tool.ecu.state.calibration_word != 1 << 12


def test_the_page_that_runs_is_what_the_loop_obeys(tool):
    commanding(tool)
    change(tool, "heartbeat_ticks", 2, 0, 0, 0)
    assert tool.ask(xcp.SET_CAL_PAGE, 3, 0, 1) == OK
    assert any([len(tool.ecu.run(1)) > 0 for _ in range(8)])
    assert tool.ecu.state.since_sent <= 2


def outside(field):
    """A value of the field's type outside its range, None where the range is all of the type."""
    lowest, highest = (-(2**31), 2**31 - 1) if field.kind == "i32" else (0, 255)
    if field.f.hi < highest:
        return field.f.hi + 1
    return field.f.lo - 1 if field.f.lo > lowest else None


BOUNDED = [i for i, its in enumerate(fields(Calibration)) if outside(its) is not None]


@pytest.mark.parametrize("field", BOUNDED[::13])
def test_a_page_that_check_refuses_never_runs(field):
    record = ecu_traffic.random_calibration(3)
    tool = Tool(ServedEcu(PythonEcu(record, SERVED)))
    tool.ask(xcp.CONNECT, 0)
    its = fields(Calibration)[field]
    wrong = outside(its)
    width = 4 if its.kind == "i32" else 1
    change(tool, its.name, *(wrong & 0xFFFFFFFF).to_bytes(4, "little")[:width])
    answer = tool.ask(xcp.SET_CAL_PAGE, 3, 0, 1)
    assert answer == refused(PAGE_NOT_VALID, field + 1, 0)
    assert tool.ask(xcp.GET_CAL_PAGE, 1, 0) == OK + b"\0\0\0"


def test_a_page_whose_fields_disagree_is_refused_by_the_rule(tool):
    change(tool, "fade_high", 1, 0, 0, 0)
    change(tool, "fade_low", 2, 0, 0, 0)
    assert tool.ask(xcp.SET_CAL_PAGE, 1, 0, 1) == refused(
        PAGE_NOT_VALID, *RULE_FADE.to_bytes(2, "little")
    )
    assert tool.ask(xcp.SET_CAL_PAGE, 1, 0, 2) == refused(PAGE_NOT_VALID)


def test_a_list_holds_the_state_of_its_tick(tool):
    places = [(address_of("time", Ecu), 4), (address_of("mode", Ecu), 1)]
    places += [(address_of("heartbeat_ticks", Calibration), 4)]
    # a time stamp leaves three bytes in the first frame
    tool.measure(places[1], places[0], places[2], mode=16, every=3)
    tool.sampled.clear()
    for _ in range(9):
        tool.tick()
    assert [frame[0] for frame in tool.sampled] == [0, 1, 2] * 3
    times = [struct.unpack("<I", frame[1:5])[0] for frame in tool.sampled[::3]]
    assert [b - a for a, b in pairwise(times)] == [30_000, 30_000]
    seen = [struct.unpack("<i", frame[1:5])[0] for frame in tool.sampled[1::3]]
    assert [b - a for a, b in pairwise(seen)] == [3, 3]
    assert tool.sampled[0][5:] == bytes([tool.ecu.state.mode])
    heartbeat = ecu_traffic.random_calibration(3).heartbeat_ticks
    assert tool.sampled[2][1:] == word(heartbeat)


def test_a_list_of_commands_is_sampled_when_one_is_sent(tool):
    tool.measure((address_of("commands_sent", Ecu), 4), event=xcp_state.COMMAND_SENT)
    tool.sampled.clear()
    commanding(tool)
    expected = []
    for _ in range(60):
        tool.tick()
        if tool.ecu.state.triggered:
            expected.append(tool.ecu.state.commands_sent)
    assert len(expected) > 5
    assert [struct.unpack("<xi", frame)[0] for frame in tool.sampled] == expected


def test_an_unsent_list_is_not_sampled_and_an_event_tells(tool):
    tool.measure((address_of("time", Ecu), 4), (address_of("mode", Ecu), 1))
    first = tool.tick()
    tool.ecu.run(1)
    tool.ecu.run(1)
    late = tool.slave.take()
    assert late[0] == b"\xfd\x06"
    before = struct.unpack("<xi", first[0])[0]
    assert struct.unpack("<xi", late[1])[0] == before + 1


def test_writing_lists_are_refused(tool):
    tool.ask(xcp.FREE_DAQ)
    tool.ask(xcp.ALLOC_DAQ, 0, 1, 0)
    stim = tool.ask(xcp.SET_DAQ_LIST_MODE, 2, 0, 0, 0, 0, 1, 0)
    assert stim == refused(MODE_NOT_VALID)
    # nor does a frame of data do anything
    before = tool.ecu.image()
    tool.slave.receive(bytes(range(8)))
    assert tool.tick() == []
    assert memory_image.differences(Ecu, before, tool.ecu.image())[0] != "mode"


def test_every_command_has_its_errors(tool):
    ask = tool.ask
    assert ask(xcp.SYNCH) == refused(0)
    for code in (0xC0, 0xCC, 0xEC, 0xF1, 0xF2, 0xF3, 0xF7, 0xF9):
        assert ask(code, 0, 0, 0, 0, 0, 0, 0) == refused(UNKNOWN), hex(code)
    for code in (xcp.SET_MTA, xcp.SHORT_UPLOAD, xcp.DOWNLOAD_MAX, xcp.WRITE_DAQ, xcp.UPLOAD):
        assert ask(code) == refused(SYNTAX)
    assert ask(xcp.UPLOAD, 1) == refused(OUT_OF_RANGE)
    assert ask(xcp.GET_CAL_PAGE, 1, 1) == refused(SEGMENT_NOT_VALID)
    assert ask(xcp.GET_CAL_PAGE, 3, 0) == refused(MODE_NOT_VALID)
    assert ask(xcp.SET_CAL_PAGE, 0, 0, 0) == refused(MODE_NOT_VALID)
    assert ask(xcp.SET_CAL_PAGE, 4, 0, 0) == refused(MODE_NOT_VALID)
    assert ask(xcp.SET_CAL_PAGE, 1, 1, 0) == refused(SEGMENT_NOT_VALID)
    assert ask(xcp.COPY_CAL_PAGE, 0, 1, 0, 0) == refused(PAGE_NOT_VALID)
    assert ask(xcp.GET_PAGE_INFO, 0, 0, 2) == refused(PAGE_NOT_VALID)
    assert ask(xcp.GET_SEGMENT_INFO, 2, 0, 0, 0) == refused(OUT_OF_RANGE)
    assert ask(xcp.GET_DAQ_EVENT_INFO, 0, 2, 0) == refused(OUT_OF_RANGE)
    assert ask(xcp.ALLOC_DAQ, 0, 1, 0) == refused(SEQUENCE)
    assert ask(xcp.FREE_DAQ) == OK
    assert ask(xcp.ALLOC_ODT, 0, 0, 0, 1) == refused(SEQUENCE)
    assert ask(xcp.ALLOC_DAQ, 0, 5, 0) == refused(MEMORY_OVERFLOW)
    assert ask(xcp.ALLOC_DAQ, 0, 2, 0) == OK
    assert ask(xcp.ALLOC_ODT_ENTRY, 0, 0, 0, 0, 1) == refused(SEQUENCE)
    assert ask(xcp.ALLOC_ODT, 0, 2, 0, 1) == refused(OUT_OF_RANGE)
    assert ask(xcp.ALLOC_ODT, 0, 0, 0, 33) == refused(MEMORY_OVERFLOW)
    assert ask(xcp.ALLOC_ODT, 0, 0, 0, 2) == OK
    assert ask(xcp.ALLOC_ODT, 0, 0, 0, 2) == refused(SEQUENCE)
    assert ask(xcp.START_STOP_DAQ_LIST, 1, 1, 0) == refused(DAQ_CONFIG)
    assert ask(xcp.ALLOC_ODT_ENTRY, 0, 0, 0, 2, 1) == refused(OUT_OF_RANGE)
    assert ask(xcp.ALLOC_ODT_ENTRY, 0, 0, 0, 0, 97) == refused(MEMORY_OVERFLOW)
    assert ask(xcp.ALLOC_ODT_ENTRY, 0, 0, 0, 0, 3) == OK
    assert ask(xcp.WRITE_DAQ, 255, 1, 0, *word(STATE_ADDRESS)) == refused(DAQ_CONFIG)
    assert ask(xcp.SET_DAQ_PTR, 0, 0, 0, 0, 3) == refused(OUT_OF_RANGE)
    assert ask(xcp.SET_DAQ_PTR, 0, 0, 0, 0, 0) == OK
    assert ask(xcp.WRITE_DAQ, 3, 1, 0, *word(STATE_ADDRESS)) == refused(OUT_OF_RANGE)
    assert ask(xcp.WRITE_DAQ, 255, 5, 0, *word(STATE_ADDRESS)) == refused(OUT_OF_RANGE)
    assert ask(xcp.WRITE_DAQ, 255, 4, 0, *word(4)) == refused(ACCESS_DENIED)
    assert ask(xcp.WRITE_DAQ, 255, 4, 0, *word(STATE_ADDRESS)) == OK
    assert ask(xcp.WRITE_DAQ, 255, 4, 0, *word(STATE_ADDRESS)) == refused(DAQ_CONFIG)
    assert ask(xcp.SET_DAQ_LIST_MODE, 16, 0, 0, 0, 0, 0, 0) == refused(OUT_OF_RANGE)
    assert ask(xcp.SET_DAQ_LIST_MODE, 16, 0, 0, 0, 0, 1, 0) == OK
    assert ask(xcp.START_STOP_DAQ_LIST, 1, 0, 0) == refused(DAQ_CONFIG)
    assert ask(xcp.SET_DAQ_LIST_MODE, 0, 0, 0, 0, 0, 1, 0) == OK
    assert ask(xcp.START_STOP_DAQ_LIST, 3, 0, 0) == refused(MODE_NOT_VALID)
    assert ask(xcp.START_STOP_DAQ_LIST, 1, 0, 0) == OK + b"\0"
    assert ask(xcp.SET_DAQ_PTR, 0, 0, 0, 0, 0) == refused(DAQ_ACTIVE)
    assert ask(xcp.GET_STATUS)[1] == 0x40
    assert ask(xcp.GET_DAQ_LIST_MODE, 0, 0, 0) == OK + bytes([0x40, 0, 0, 0, 0, 1, 0])
    assert ask(xcp.START_STOP_SYNCH, 9) == refused(MODE_NOT_VALID)
    tool.slave.receive(bytes([xcp.SET_CAL_PAGE, 1, 0, 1]))
    tool.tick()
    assert ask(xcp.GET_STATUS) == refused(BUSY)
    assert ask(xcp.DISCONNECT) in (OK, refused(BUSY))


def test_a_restart_begins_on_the_reference(tool):
    change(tool, "heartbeat_ticks", 3, 0, 0, 0)
    assert tool.ask(xcp.SET_CAL_PAGE, 3, 0, 1) == OK
    tool.ecu.restart()
    again = Tool(tool.ecu)
    assert again.ask(xcp.CONNECT, 0)[0] == 0xFF
    assert again.ask(xcp.GET_CAL_PAGE, 1, 0) == OK + b"\0\0\0"
    for _ in range(2 * LAST_BYTE // 4):
        again.tick()
    # its watch of the CRC is of the page that it runs on
    assert again.ecu.state.calibration_word != 1 << 12


def test_nothing_is_answered_before_a_tool_connects():
    record = ecu_traffic.random_calibration(3)
    tool = Tool(ServedEcu(PythonEcu(record, SERVED)))
    assert tool.ask(xcp.GET_STATUS) == b""
    assert tool.ask(xcp.CONNECT, 0) == bytes([0xFF, 5, 0x80, 8, 8, 0, 1, 1])


@needs_cc
def test_both_backends_give_the_same_bytes_for_any_commands():
    record = ecu_traffic.random_calibration(5)
    tools = [Tool(ServedEcu(kind(record, SERVED))) for kind in (PythonEcu, NativeEcu)]
    draw = random.Random(4)
    known = [0xC0 + k for k, length in enumerate(xcp.LENGTHS) if length and k != 0x3E]
    for _ in range(3000):
        code = draw.choice(known)
        rest = [draw.choice([0, 0, 1, 2, 3, 255, draw.randrange(256)]) for _ in range(7)]
        if code in (xcp.SET_MTA, xcp.SHORT_UPLOAD, xcp.WRITE_DAQ) and draw.random() < 0.8:
            rest[2:] = [0, *word(draw.choice([STATE_ADDRESS, PAGE_ADDRESS]) + draw.randrange(1700))]
        command = bytes([code, *rest])[: draw.randrange(5, 9)]
        frames = []
        for tool in tools:
            tool.slave.receive(command)
            frames.append([tool.tick(), tool.tick()])
        assert frames[0] == frames[1], command.hex()
    assert tools[0].ecu.image() == tools[1].ecu.image()
    slaves = [tool.slave.record.image() for tool in tools]
    assert slaves[0] == slaves[1]
    assert tools[0].slave.working.image() == tools[1].slave.working.image()


def test_the_bus_reckons_with_as_many_frames_as_the_slave_can_send():
    assert xcp_state.N_ODT == MOST_LISTED
