"""The socketcand server: stock python-can connects; bad input and slow clients do no harm."""

import socket
import subprocess
import sys
import threading
import time

import can
import pytest

from canroll import dbc
from canroll.cli import bus_server
from canroll.cli.main import main
from canroll.errors import CanrollError
from canroll.plant_sim.can_bus.kernel.network import build_network
from canroll.plant_sim.can_bus.servers import socketcand
from canroll.plant_sim.can_bus.servers.socketcand import (
    MAX_CLIENTS,
    ProtocolError,
    SocketcandServer,
    parse_frame,
)
from canroll.plant_sim.can_bus.servers.wall_clock import serve_network
from canroll.plant_sim.can_bus.simulation.response_times import traffic_spec
from canroll.plant_sim.can_bus.traffic.files import load_traffic
from canroll.plant_sim.can_bus.wire.frame import EXTENDED, FD, REMOTE

DIAGNOSTICS = dbc.load().get_message_by_name("RollControlDiagnostics").frame_id


@pytest.fixture
def server():
    with SocketcandServer(port=0) as running:
        yield running


def eventually(condition, seconds=1800.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.005)
    return False


def client(server):
    host, port = server.address
    return can.Bus(server.channel, interface="socketcand", host=host, port=port)


def raw(server, text=b""):
    connection = socket.create_connection(server.address, timeout=600.0)
    assert connection.recv(64) == b"< hi >"
    connection.sendall(text)
    return connection


def everything(connection):
    data = b""
    while True:
        try:
            piece = connection.recv(4096)
        except ConnectionResetError:
            return data
        if not piece:
            return data
        data += piece


def test_what_is_published_right_after_a_client_has_opened_the_bus_reaches_it(server, monkeypatch):
    monkeypatch.setattr(socketcand, "_QUIET_S", 1e6)
    connection = raw(server, b"< open simbus >")
    assert connection.recv(64) == b"< ok >"
    connection.sendall(b"< rawmode >")
    assert eventually(lambda: [one for one in server._clients.values() if one.raw])
    server.publish(0x123, 0, b"\x01", length=1, time_s=2.0)
    server.publish(0x124, 0, b"\x02", length=1, time_s=2.0)
    # the reply comes alone: python-can takes nothing else for it
    assert connection.recv(256) == b"< ok >"
    server._clients[0].quiet_until = 0.0
    server.publish(0x125, 0, b"\x03", length=1, time_s=2.0)
    data = b""
    while data.count(b">") < 3:
        data += connection.recv(256)
    assert [piece.split()[2] for piece in data.split(b">")[:3]] == [b"123", b"124", b"125"]
    connection.close()
    assert server.lost == 0


def test_frames_kept_for_a_raw_client_are_not_for_one_that_subscribes(server, monkeypatch):
    monkeypatch.setattr(socketcand, "_QUIET_S", 1e6)
    connection = raw(server, b"< open simbus >< rawmode >")
    assert eventually(lambda: [one for one in server._clients.values() if one.raw])
    server.publish(0x123, 0, b"\x01", length=1, time_s=2.0)
    connection.sendall(b"< subscribe 0 0 124 >< bcmmode >")
    assert eventually(lambda: not server._clients[0].raw)
    server.publish(0x124, 0, b"\x02", length=1, time_s=2.0)
    assert [piece.split()[1] for piece in bytes(server._clients[0].held).split(b">")[:-1]] == [
        b"frame"
    ]
    assert b" 124 " in server._clients[0].held
    connection.close()


def test_python_can_sends_and_receives(server):
    with client(server) as bus:
        bus.send(can.Message(arbitration_id=0x123, data=[1, 0xAB], is_extended_id=False))
        bus.send(can.Message(arbitration_id=0x18FF00F1, data=[], is_extended_id=True))
        assert server.wait(600.0)
        frames = []
        assert eventually(lambda: frames.extend(server.take()) or len(frames) == 2)
        assert [f[1:] for f in frames] == [
            (0x123, 0, 2, b"\x01\xab"),
            (0x18FF00F1, EXTENDED, 0, b""),
        ]
        time.sleep(0.15)
        server.publish(0x0A0, 0, bytes(range(8)), length=8, time_s=12.5)
        server.publish(0x1ABCDEF0, EXTENDED, b"", length=0, time_s=12.75)
        one, two = bus.recv(600.0), bus.recv(600.0)
        assert (one.arbitration_id, one.is_extended_id, one.timestamp) == (0x0A0, False, 12.5)
        assert bytes(one.data) == bytes(range(8))
        assert (two.arbitration_id, two.is_extended_id, bytes(two.data)) == (0x1ABCDEF0, True, b"")


def test_own_frames_are_not_echoed_and_others_are(server):
    with client(server) as one, client(server) as two:
        one.send(can.Message(arbitration_id=0x55, data=[1], is_extended_id=False))
        assert server.wait(600.0)
        (frame,) = server.take()
        time.sleep(0.15)
        server.publish(
            frame.ident, frame.flags, frame.payload, length=1, time_s=1.0, sender=frame.client
        )
        assert two.recv(600.0).arbitration_id == 0x55
        assert one.recv(0.2) is None


@pytest.mark.parametrize(
    "text",
    [
        b"hello",
        b"< open nosuch >",
        b"< send 123 1 0 >",
        b"< open simbus >< nonsense >",
        b"< open simbus >< send 800 1 0 >",
        b"< open simbus >< send 123 9 0 0 0 0 0 0 0 0 0 >",
        b"< open simbus >< send 123 2 0 >",
        b"< open simbus >< send 123 1 100 >",
        b"< open simbus >< send 123 1 -1 >",
        b"< open simbus >< send xyz 0 >",
        b"< open simbus >< send >",
        b"< open simbus >< subscribe 0 0 z >",
        b"< open simbus >< \xff\xfe >",
        b"<" + b"a" * 5000,
        b"< open simbus ><" + b" " * 300 + b"echo >",
    ],
)
def test_malformed_and_oversized_input_is_refused(server, text):
    with raw(server, text) as connection:
        answer = everything(connection)
    assert b"< error " in answer
    assert eventually(lambda: server.refused == 1 and server.clients == 0)
    assert server.take() == []
    with client(server) as bus:
        assert bus.channel == "simbus"


def test_commands_may_arrive_in_pieces(server):
    with raw(server) as connection:
        for byte in b"< open simbus >< send 1A2 3 1 2 3 >< sendrtr 123 4 >< echo >":
            connection.sendall(bytes([byte]))
        assert eventually(lambda: server._taken and len(server._taken) == 2)
        frames = server.take()
        assert frames[0][1:] == (0x1A2, 0, 3, b"\x01\x02\x03")
        assert frames[1][1:] == (0x123, REMOTE, 4, b"")


def test_subscriptions_select_identifiers(server):
    with raw(server, b"< open simbus >< subscribe 0 0 123 >< echo >") as connection:
        data = b""
        while b"echo" not in data:
            data += connection.recv(100)
        server.publish(0x124, 0, b"\1", length=1, time_s=0.5)
        server.publish(0x123, 0, b"\2", length=1, time_s=0.5)
        server.publish(0x123, REMOTE, b"", length=4, time_s=0.5)
        text = b""
        while text.count(b">") < 2:
            text += connection.recv(100)
        assert text == b"< frame 123 0.500000 02 >< rtr 123 0.500000 4 >"


def test_a_slow_client_loses_frames_that_are_counted_and_nobody_waits(server):
    slow = raw(server, b"< open simbus >< rawmode >")
    assert eventually(lambda: server.clients == 1)
    time.sleep(0.2)
    with client(server) as quick:
        time.sleep(0.2)
        count = 0
        while server.lost == 0 and count < 2_000_000:
            server.publish(0x100, 0, bytes(8), length=8, time_s=1.0)
            count += 1
            if count % 1000 == 0:
                while quick.recv(0.0) is not None:
                    pass
        assert server.lost > 0
        assert server.clients == 2
        # the one that reads still gets what is published
        while quick.recv(0.3) is not None:
            pass
        before = server.lost
        server.publish(0x7, 0, b"", length=0, time_s=2.0)
        assert quick.recv(600.0).arbitration_id == 7
        assert server.lost >= before
    slow.close()


def test_fd_frames_do_not_vanish_in_a_protocol_without_them(server):
    with client(server), pytest.raises(ValueError, match="no CAN FD frames"):
        server.publish(0x1, FD, bytes(12), length=12, time_s=0.0)
    with raw(server, b"< open simbus >< rawmode >") as connection:
        connection.sendall(b"< send 123 c " + b" ".join([b"0"] * 12) + b" >")
        text = b""
        while chunk := connection.recv(200):
            text += chunk
        assert b"< error no frames of more than 8 bytes: the protocol has no CAN FD >" in text
    assert server.take() == []


def test_serving_refuses_frames_that_its_clients_would_not_see(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(bus_server, "serve_network", lambda network, **_: pytest.fail("served"))
    path = tmp_path / "fd.toml"
    row = "[[message]]\nname = '{0}'\nid = {1}\nperiod_ms = 10\nbytes = 8\nfd = {2}\n"
    path.write_text(row.format("Radar", 1, "true") + row.format("Wheels", 2, "false"))
    assert main(["bus", str(path), "--serve"]) == 2
    error = capsys.readouterr().err
    assert "client for it supports CAN FD, so Radar would be missing" in error
    assert error.count("\n") == 1


def test_places_are_limited_and_come_free(server):
    clients = [raw(server) for _ in range(MAX_CLIENTS)]
    assert eventually(lambda: server.clients == MAX_CLIENTS)
    with socket.create_connection(server.address, timeout=600.0) as extra:
        assert everything(extra) == b""
    for connection in clients:
        connection.close()
    assert eventually(lambda: server.clients == 0)


def test_it_listens_on_loopback_and_says_when_the_port_is_taken(server):
    assert server.address[0] == "127.0.0.1"
    with pytest.raises(CanrollError, match="cannot listen"):
        SocketcandServer(port=server.address[1])


def test_words_of_a_frame():
    assert parse_frame(["send", "00000123", "1", "f"]) == (0x123, EXTENDED, 1, b"\x0f")
    with pytest.raises(ProtocolError):
        parse_frame(["sendrtr", "123", "4", "1"])


def contract_traffic():
    traffic = load_traffic(dbc.PATH)
    return build_network(traffic_spec(traffic.messages, bitrate=traffic.bitrate))


@pytest.fixture
def served():
    """A network with the contract's traffic on a free port; yields where it listens."""
    probe = socket.create_server(("127.0.0.1", 0))
    port = probe.getsockname()[1]
    probe.close()
    told = []
    thread = threading.Thread(
        target=serve_network,
        args=(contract_traffic(),),
        kwargs={"port": port, "announce": told.append, "duration_s": 30.0},
        daemon=True,
    )
    thread.start()
    assert eventually(lambda: told)
    return port


def test_a_served_network_is_a_live_bus(served):
    with can.Bus("simbus", interface="socketcand", host="127.0.0.1", port=served) as one:
        messages = [one.recv(600.0) for _ in range(100)]
        known = {m.frame_id for m in dbc.load().messages}
        assert {m.arbitration_id for m in messages} <= known
        assert len({m.arbitration_id for m in messages}) >= 10
        # the payloads are made up, and the diagnostics' page then often one that there is not
        for message in (m for m in messages if m.arbitration_id != DIAGNOSTICS):
            dbc.load().decode_message(message.arbitration_id, message.data, decode_choices=False)
        with can.Bus("simbus", interface="socketcand", host="127.0.0.1", port=served) as two:
            # a client that is held up loses frames, so that the other one sends again and again
            heard = False
            for _ in range(1000):
                two.send(can.Message(arbitration_id=0x001, data=[7], is_extended_id=False))
                heard = heard or any(one.recv(600.0).arbitration_id == 1 for _ in range(200))
                if heard:
                    break
            assert heard


def test_the_stock_logger_writes_what_is_on_the_bus(served, tmp_path):
    path = tmp_path / "bus.log"
    logger = subprocess.Popen(
        [
            *(sys.executable, "-m", "can.logger", "-i", "socketcand", "-c", "simbus"),
            *("-f", str(path), "--bus-kwargs", "host=127.0.0.1", f"port={served}"),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    try:
        assert eventually(lambda: path.exists() and path.stat().st_size > 4000)
    finally:
        logger.send_signal(2)
        logger.wait(1800.0)
    with can.LogReader(path) as reader:
        idents = {message.arbitration_id for message in reader}
    assert dbc.load().get_message_by_name("Imu").frame_id in idents


def test_a_client_that_reads_no_replies_is_not_read_from(server, monkeypatch):
    monkeypatch.setattr(socketcand, "_BACKLOG_BYTES", 1 << 12)
    connection = raw(server)
    connection.settimeout(0.5)
    with pytest.raises(TimeoutError):
        while True:
            connection.sendall(b"< echo >" * 500)
    assert len(server._clients[0].outgoing) <= (1 << 12) + 4096
    with client(server) as other:  # whom it does not hold up
        other.send(can.Message(arbitration_id=0x55, data=[1], is_extended_id=False))
        assert server.wait(600.0)
    connection.close()


@pytest.mark.parametrize("last", ["1FFFFFFF0", "-1"])
def test_what_a_client_subscribes_to_is_bounded(server, monkeypatch, last):
    monkeypatch.setattr(socketcand, "_MAX_SUBSCRIBED", 3)
    for words in ([f"{n:X}" for n in range(4)], ["1FFFFFFF", last]):
        connection = raw(server, b"< open simbus >")
        connection.sendall("".join(f"< subscribe 0 0 {word} >" for word in words).encode())
        assert b"error" in everything(connection)


def test_a_client_that_opens_nothing_makes_room(server, monkeypatch):
    monkeypatch.setattr(socketcand, "_PATIENCE_S", 1.0)
    silent = [raw(server) for _ in range(MAX_CLIENTS)]
    assert eventually(lambda: not server.clients)
    assert server.refused == MAX_CLIENTS
    with client(server) as bus:
        time.sleep(1.2)  # one that has opened the bus may say nothing
        bus.send(can.Message(arbitration_id=0x55, data=[1], is_extended_id=False))
        assert server.wait(600.0)
    for connection in silent:
        connection.close()
