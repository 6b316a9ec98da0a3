"""Authenticated frames between two programs: resets, keys, formats, and what is refused."""

import json

import can
import pytest

from canroll.cli.main import main
from canroll.codegen.run.backends import Recorder, open_backend
from canroll.codegen.run.secured import SecuredEcu
from canroll.errors import CanrollError
from canroll.hil import ecu_loop, tick_trace
from canroll.hil.bus_link import CanLink
from canroll.hil.hardware import lasting
from canroll.plant_sim.world.world import World
from canroll.runs.experiment import build_world, plan, world_options

MS = 1_000_000


@pytest.fixture(scope="module")
def planned():
    return plan("double_lane_change", bus="secured_fd", law="lqr", plant="roll1", backend="python")


def started(planned, path):
    """An ECU as the program starts it with its memory in a file."""
    settings, controller = planned
    memory = lasting.of_ecu(lasting.read(path), settings.firmware)
    ecu = open_backend("python", controller.record, settings.firmware, lasting=memory)
    lasting.write(path, lasting.by_name(ecu.lasting, settings.firmware))
    return ecu


def drive(world, ecu, ticks):
    """Drive on for a number of ticks; commands applied meanwhile."""
    before = len(world.commands)
    for _ in range(ticks):
        for frame in world.advance(world.now_ns + 10 * MS):
            length = int(frame["length"])
            ecu.receive(int(frame["ident"]), frame["payload"][:length], length)
        for ident, payload in ecu.tick(1):
            world.submit(world.now_ns, ident, payload)
    return len(world.commands) - before


def test_an_ecu_that_starts_again_is_heard_by_its_memory_only(planned, tmp_path):
    settings, _ = planned
    memory = tmp_path / "ecu.json"
    world = build_world(settings, enabled=True)
    first = started(planned, memory)
    assert drive(world, first, 60) > 5
    lasting.write(memory, lasting.by_name(first.lasting, settings.firmware))
    assert json.loads(memory.read_text())["senders"]["Imu"] == 1
    world.advance(world.now_ns + 10 * MS)  # until the frames under way have come
    # one that has forgotten counts from its first start again, old until it is beyond the last
    refused = world.refused
    assert drive(world, started(planned, None), 50) == 0
    assert world.refused > refused + 2
    assert drive(world, started(planned, memory), 60) > 5
    assert json.loads(memory.read_text())["starts"] == 2
    assert world.ecu_starts == 2


def test_a_vehicle_that_starts_again_is_heard_by_its_memory_only(planned):
    settings, controller = planned
    ecu = open_backend("python", controller.record, settings.firmware)
    world = build_world(settings, enabled=True)
    drive(world, ecu, 60)
    options = world_options(settings, enabled=True)
    before = ecu.refused
    forgotten = World(**options)
    drive(forgotten, ecu, 30)
    assert ecu.refused > before + 50
    before = ecu.refused
    again = World(**options, starts=world.starts + 1, ecu_starts=world.ecu_starts)
    assert drive(again, ecu, 90) > 5
    assert ecu.refused == before
    assert (again.starts, again.ecu_starts) == (2, 1)


def test_the_trace_of_a_later_start_replays(planned, tmp_path):
    settings, controller = planned
    memory = tmp_path / "ecu.json"
    started(planned, memory)
    world, ecu = build_world(settings, enabled=True), started(planned, memory)
    recorder = tick_trace.TickRecorder(room=settings.firmware.room)
    for number in range(1, 60):
        for frame in world.advance(10 * MS * number):
            payload = frame["payload"][: frame["length"]].tobytes()
            ecu.receive(int(frame["ident"]), payload, len(payload))
            recorder.consumed(int(frame["ident"]), payload)
        for ident, payload in ecu.tick(1):
            world.submit(world.now_ns, ident, payload)
            recorder.sent(ident, payload)
        recorder.tick(number, 1, 0, 0, 0)
    about = {"lasting": [1, []]}
    path = tmp_path / "ticks.npz"
    tick_trace.save(
        path,
        tick_trace.TickTrace(controller.record, recorder.ticks(), recorder.frames(), about),
    )
    trace = tick_trace.load(path)
    firmware = settings.firmware
    assert tick_trace.replay(trace, "native", firmware=firmware).difference is None
    assert tick_trace.replay(trace, "native", firmware=firmware, key=bytes(16)).difference
    for wrong in ([], 3, [1, ["x"]], [1 << 24, []], [-1, []], {"a": 1, "b": 2}):
        spoilt = tick_trace.TickTrace(
            trace.calibration, trace.ticks, trace.frames, {"lasting": wrong}
        )
        with pytest.raises(CanrollError, match="not a tick trace: 'lasting' is"):
            tick_trace.replay(spoilt, "python", firmware=firmware)
    with pytest.raises(CanrollError, match="of a bus with authenticated frames: choose its --bus"):
        tick_trace.replay(trace, "python")


def test_the_last_command_is_authentic(planned):
    settings, controller = planned
    world = build_world(settings, enabled=True)
    ecu = open_backend("python", controller.record, settings.firmware)
    assert isinstance(ecu, SecuredEcu)
    drive(world, ecu, 60)
    _, length = settings.firmware.sent[0]
    last = ecu_loop.last_command(ecu, controller.record, bytes(length), settings.firmware)
    assert (len(last[1]), last[1][8:11]) == (20, bytes([0, 0, 1]))
    refused = world.refused
    world.submit(world.now_ns, *last)
    world.advance(world.now_ns + 10 * MS)
    assert world.refused == refused


def test_a_drive_heard_again_is_new_to_an_ecu_that_starts_again(planned):
    settings, controller = planned
    firmware = settings.firmware
    ecu = open_backend("python", controller.record, firmware)
    recorder = Recorder(ecu, firmware)
    drive(build_world(settings, enabled=True), recorder, 40)
    sent, taken = recorder.traffic.frames, ecu.accepted
    assert taken > 50
    for starts_again, more in ((False, 0), (True, taken)):
        if starts_again:
            ecu.restart()
        before = ecu.accepted
        for tick in range(40):
            for event in sent[sent["tick"] == tick]:
                box = firmware.bus.received[event["message"]]
                if firmware.slots[box.ident][0] == event["message"]:
                    payload = event["payload"][: event["length"]].tobytes()
                    ecu.receive(box.ident, payload, len(payload))
            ecu.tick(1)
        assert ecu.accepted == before + more


@pytest.mark.slow
def test_the_own_bus_of_a_run_carries_its_frames(capsys):
    command = ["hil", "moose", *SECURED, "--law", "lqr", "--plant", "roll1", "--pace", "lockstep"]
    assert main([*command, "--duration", "0.6", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["timing"]["bus"]["ecu"]["interface"].startswith("udp_multicast")
    assert told["timing"]["frames"] > 100
    assert told["timing"]["valid"]


@pytest.mark.parametrize(("fd", "taken"), [({0x80: True}, [16]), ({}, [8]), (None, [8, 16])])
def test_a_frame_of_the_other_format_is_not_received(request, fd, taken):
    name = request.node.name
    sender = can.Bus(name, interface="virtual", protocol="CAN_FD")
    link = CanLink(can.Bus(name, interface="virtual", protocol="CAN_FD"), fd=fd)
    sender.send(can.Message(arbitration_id=0x80, data=bytes(8), is_extended_id=False))
    sender.send(can.Message(arbitration_id=0x80, data=bytes(16), is_fd=True, is_extended_id=False))
    assert [len(payload) for _, payload in link.receive()] == taken
    assert link.received == len(taken)
    link.close()
    sender.shutdown()


SECURED = ["--bus", "secured_fd"]
SERVED = ["-i", "udp_multicast", "-c", "239.74.163.2"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["ecu", *SERVED, "--key", "k"], "--key: the frames of bus 500k are not authenticated"),
        (["ecu", *SERVED, "--memory", "m"], "--memory: the frames of bus 500k are not authentic"),
        (["plant", "moose", *SERVED, "--memory", "m"], "--memory: the frames of bus 500k are not"),
        (["plant", "moose", *SECURED, "--serve", "127.0.0.1:1"], "--serve: socketcand has no CAN"),
        (["hil", "moose", *SECURED, "--serve", "127.0.0.1:1"], "--serve: socketcand has no CAN FD"),
    ],
)
def test_what_cannot_be_is_one_line(arguments, says, capsys):
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert says in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize(
    "content", ["", "{", "[]", '{"starts": 1}', '{"starts": -1, "senders": {}}']
)
def test_a_memory_that_is_none_is_one_line(content, tmp_path):
    path = tmp_path / "memory.json"
    path.write_text(content)
    with pytest.raises(CanrollError, match=r"memory\.json"):
        lasting.read(path)


def test_a_memory_that_cannot_be_written_is_one_line(tmp_path):
    not_a_folder = tmp_path / "notes.txt"
    not_a_folder.write_text("")
    with pytest.raises(CanrollError, match="cannot write"):
        lasting.write(not_a_folder / "memory.json", lasting.FIRST)
