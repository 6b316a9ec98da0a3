"""A bus that several programs share: processes in lock step, the same bytes every time."""

import os
import socket
import subprocess
import sys
import textwrap
import threading
import tomllib
from pathlib import Path

import can
import pytest

from canroll.cli.main import main
from canroll.errors import CanrollError
from plant_sim.can_bus import NetworkSpec, Segment, build_network
from plant_sim.can_bus.servers import shared_server
from plant_sim.can_bus.servers.frames import Mirror
from plant_sim.can_bus.servers.shared_client import SharedSimBus
from plant_sim.can_bus.servers.shared_server import SharedBus
from plant_sim.can_bus.simulation.response_times import traffic_spec
from plant_sim.can_bus.traffic.messages import BusMessage

ROOT = Path(__file__).parents[4]
MS = 1_000_000
PATIENCE = 120.0


def served(network, programs, **options):
    """Start a server in a thread; return its address, its thread, and what it gives back."""
    bus = SharedBus(network, programs=programs, port=0, **options)
    given = []
    thread = threading.Thread(target=lambda: given.append(bus.run()), daemon=True)
    thread.start()
    return f"{bus.address[0]}:{bus.address[1]}", thread, given


def background():
    messages = [BusMessage(f"b{i}", 0x300 + i, 8, (2.0 + i) * MS, "others") for i in range(4)]
    return build_network(traffic_spec(messages, bitrate=500_000, data_bitrate=2_000_000, seed=5))


PROGRAM = """
    import random, sys, time
    import can
    from plant_sim.can_bus.servers.shared_client import SharedSimBus

    channel, name, ident, fd = sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4] == "fd"
    with SharedSimBus(channel, node=name, fd=fd) as bus:
        for turn in range(40):
            time.sleep(random.random() * 0.003)
            bus.send(
                can.Message(
                    arbitration_id=ident,
                    is_extended_id=False,
                    is_fd=fd,
                    bitrate_switch=fd,
                    data=bytes([turn]) * (24 if fd else 8),
                )
            )
            end = bus.now + 0.005
            while (message := bus.recv(max(0.0, end - bus.now))) is not None:
                data = message.data.hex()
                print(f"{message.timestamp:.9f} {message.arbitration_id:X} {message.dlc} {data}")
"""


def run_programs(names, folder, **options):
    """Run one process for each (name, identifier, fd); return what each of them printed."""
    path = folder / "program.py"
    path.write_text(textwrap.dedent(PROGRAM))
    address, thread, given = served(background(), len(names), **options)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    processes = [
        subprocess.Popen(
            [sys.executable, str(path), address, *map(str, name)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
        )
        for name in names
    ]
    answers = [process.communicate(timeout=PATIENCE) for process in processes]
    assert [errors for _, errors in answers] == [b""] * len(names)
    thread.join(PATIENCE)
    return [out for out, _ in answers], given


PROGRAMS = (("alpha", 0x100, "classic"), ("beta", 0x200, "classic"), ("gamma", 0x150, "fd"))


@pytest.mark.slow
def test_processes_get_the_same_bytes_every_time(tmp_path):
    first, end = run_programs(PROGRAMS, tmp_path)
    again, _ = run_programs(tuple(reversed(PROGRAMS)), tmp_path)
    assert first == again[::-1]
    assert end == [pytest.approx(0.2e9, rel=0.01)]
    for place, (_, ident, _) in enumerate(PROGRAMS):
        lines = first[place].decode().splitlines()
        heard = {int(line.split()[1], 16) for line in lines}
        # nobody hears itself, FD is seen by who has it, and the background by all
        others = {i for _, i, fd in PROGRAMS if i != ident and fd == "classic"}
        assert others | {0x300, 0x301, 0x302, 0x303} <= heard
        assert ident not in heard
        assert len(lines) > 200
        times = [float(line.split()[0]) for line in lines]
        assert times == sorted(times)
    assert b" 200 8 " in first[2]
    assert not any(b" 150 24 " in out for out in first[:2])


def in_threads(*programs):
    """Run programs at the same time, each in its own thread; return what they return."""
    found = [None] * len(programs)

    def run(place):
        found[place] = programs[place]()

    threads = [threading.Thread(target=run, args=(i,), daemon=True) for i in range(len(programs))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive()
    return found


def empty(**options):
    return build_network(NetworkSpec((Segment(500_000, 2_000_000),), (), **options))


def frame(ident, data=b"\x01", **options):
    return can.Message(arbitration_id=ident, is_extended_id=False, data=data, **options)


def test_a_frame_takes_its_time_on_the_wire_and_priority_decides():
    address, _, _ = served(empty(), 2)

    def sender():
        with SharedSimBus(address, node="a") as bus:
            bus.send(frame(0x200, bytes(8)))
            bus.send(frame(0x100, bytes(8)))
            bus.let_pass(0.01)

    def receiver():
        with SharedSimBus(address, node="b") as bus:
            bus.send(frame(0x150, bytes(8)))
            return [bus.recv(0.01) for _ in range(2)], bus.recv(0.001)

    _, (messages, nothing) = in_threads(sender, receiver)
    # one node keeps its order; nothing was on the bus before
    assert [m.arbitration_id for m in messages] == [0x200, 0x100]
    assert nothing is None
    assert 0.0004 < messages[0].timestamp < messages[1].timestamp < 0.0009
    assert messages[0].is_rx


def test_fd_frames_are_seen_by_nodes_with_fd():
    address, _, _ = served(empty(), 3)
    payload = bytes(range(64))

    def sender():
        with SharedSimBus(address, node="a", fd=True) as bus:
            bus.send(frame(0x20, payload, is_fd=True, bitrate_switch=True))
            bus.let_pass(0.005)

    def receiver(name, fd):
        def run():
            with SharedSimBus(address, node=name, fd=fd) as bus:
                return bus.recv(0.005)

        return run

    _, seen, hidden = in_threads(sender, receiver("b", fd=True), receiver("c", fd=False))
    assert bytes(seen.data) == payload
    assert seen.is_fd
    assert seen.bitrate_switch
    assert hidden is None


def test_a_bus_on_which_nothing_will_happen_ends_all_waits():
    address, _, _ = served(empty(), 2)

    def program(name):
        def run():
            with SharedSimBus(address, node=name) as bus:
                return bus.recv(None)

        return run

    assert in_threads(program("a"), program("b")) == [None, None]


def test_a_program_that_leaves_holds_nobody():
    address, thread, given = served(empty(), 2)

    def short():
        with SharedSimBus(address, node="a") as bus:
            bus.send(frame(0x77))

    def long():
        with SharedSimBus(address, node="b") as bus:
            message = bus.recv(0.5)
            bus.let_pass(1.0)
            return message, bus.now

    _, (message, now) = in_threads(short, long)
    assert message.arbitration_id == 0x77
    assert now > 1.0
    thread.join(PATIENCE)
    assert given == [pytest.approx(now * 1e9)]


def test_two_programs_of_one_name_are_refused():
    address, _, _ = served(empty(), 2)
    refused = []

    def program(name):
        def run():
            try:
                with SharedSimBus(address, node=name) as bus:
                    bus.let_pass(0.001)
            except can.CanInitializationError as error:
                refused.append(str(error))
                with SharedSimBus(address, node="other") as bus:
                    bus.let_pass(0.001)

        return run

    in_threads(program("same"), program("same"))
    assert len(refused) == 1
    assert "a program 'same' is on the bus already" in refused[0]


def test_what_cannot_be_sent_is_said():
    address, _, _ = served(empty(), 1)
    with SharedSimBus(address, node="a") as bus:
        with pytest.raises(can.CanOperationError, match="has no FD"):
            bus.send(frame(0x1, bytes(12), is_fd=True))
        with pytest.raises(can.CanOperationError, match=r"transmit queue full, \d+ frames lost"):
            for _ in range(600):
                bus.send(frame(0x1))
    with pytest.raises(can.CanOperationError, match="has been shut down"):
        bus.recv(0.0)
    with pytest.raises(can.CanInitializationError, match="HOST:PORT expected"):
        SharedSimBus("nowhere")
    with pytest.raises(can.CanInitializationError, match="simbus_shared 127"):
        SharedSimBus("127.0.0.1:1", join_timeout=0.05)


def test_a_mirror_shows_background_and_programs():
    with can.Bus("shown", interface="virtual") as shown:
        mirror = Mirror("virtual:shown")
        address, thread, _ = served(background(), 1, mirror=mirror)
        with SharedSimBus(address, node="a") as bus:
            bus.send(frame(0x42))
            bus.let_pass(0.02)
        thread.join(PATIENCE)
        mirror.close()
        seen = [m.arbitration_id for m in iter(lambda: shown.recv(0.0), None)]
    assert {0x42, 0x300, 0x301, 0x302, 0x303} == set(seen)
    assert mirror.failed == 0
    with pytest.raises(CanrollError, match="expected INTERFACE:CHANNEL"):
        Mirror("vcan0")
    with pytest.raises(CanrollError, match="mirror 'nothing:x'"):
        Mirror("nothing:x")


def test_in_real_time_the_bus_waits_for_the_clock():
    import time

    address, _, _ = served(empty(), 1, real_time=True)
    with SharedSimBus(address, node="a") as bus:
        began = time.monotonic()
        bus.let_pass(0.3)
        assert time.monotonic() - began >= 0.29
        assert bus.now == pytest.approx(0.3)


def test_the_interface_is_an_entry_point():
    table = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    named = table["project"]["entry-points"]["can.interface"]["simbus_shared"]
    assert named == f"{SharedSimBus.__module__}:{SharedSimBus.__name__}"


def test_the_command_shares_a_set_with_its_programs():
    dbc = str(ROOT / "dbc" / "roll_control.dbc")
    command = [sys.executable, "-m", "canroll.cli.main", "bus", dbc]
    server = subprocess.Popen(
        [*command, "--share", "0", "--programs", "2"],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
        cwd=ROOT,
    )
    address = server.stdout.readline().strip().rpartition("channel=")[2]

    def program(name):
        def run():
            with SharedSimBus(address, node=name, join_timeout=PATIENCE) as bus:
                heard = [bus.recv(1.0).arbitration_id for _ in range(30)]
                bus.let_pass(0.5 - bus.now)
                return heard

        return run

    one, two = in_threads(program("a"), program("b"))
    assert one == two
    assert 0xA0 in one
    assert (
        "the last program left after 0.5 s of bus time" in server.communicate(timeout=PATIENCE)[0]
    )
    assert server.returncode == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--share"], "--share: it belongs to --programs: add that"),
        (["--share", "99999", "--programs", "1"], "the port must be 0 to 65535"),
        (["--share", "--programs", "0"], "--programs must be at least 1"),
        (["--mirror", "virtual:x"], "--mirror: it belongs to --share: add that"),
        (["--share", "--programs", "1", "--serve"], "--serve: --share has its own server: omit it"),
    ],
)
def test_the_command_refuses_what_cannot_be(capsys, options, message):
    assert main(["bus", str(ROOT / "dbc" / "roll_control.dbc"), *options]) == 2
    assert message in capsys.readouterr().err


def test_silent_connections_hold_up_nobody(monkeypatch):
    monkeypatch.setattr(shared_server, "GREETING_S", 0.5)
    address, thread, _ = served(background(), 1)
    host, port = address.split(":")
    silent = [socket.create_connection((host, int(port)), timeout=PATIENCE) for _ in range(100)]
    silent[0].sendall(b'{"name"')
    assert silent[0].recv(1) == b""  # closed in time
    with SharedSimBus(address, node="good") as bus:
        bus.let_pass(0.001)
    thread.join(PATIENCE)
    assert not thread.is_alive()
    for connection in silent:
        connection.close()


def test_a_bus_with_a_token_asks_for_it():
    address, thread, _ = served(background(), 1, token="secret")
    for options in ({}, {"token": "secreT"}, {"token": "s\ud800"}):
        with pytest.raises(can.CanInitializationError, match=r"token|joined"):
            SharedSimBus(address, node="foreign", **options)
    SharedSimBus(address, node="good", token="secret").shutdown()
    thread.join(PATIENCE)
    assert not thread.is_alive()
