"""Browsers at the watch: what they are sent, and who is turned away."""

import asyncio
import http.client
import json
import socket
import sys
import threading
import time

import can
import pytest
from support.bus_frames import frame

from canroll.cli.main import main
from canroll.errors import CanrollError
from hil.process import Stop
from hil.watch.observation import Observation
from hil.watch.onlooker import Onlooker

websockets = pytest.importorskip("websockets.sync.client", reason="needs websockets")

from websockets.exceptions import InvalidStatus  # noqa: E402

from hil.watch import server  # noqa: E402

PAGE = "<!doctype html><title>ø</title>"


class ListLink:
    """What is in ``waiting`` is received once."""

    lost = False

    def __init__(self):
        self.waiting = []

    def messages(self):
        waiting, self.waiting = self.waiting, []
        return waiting


class Served:
    """A watch that runs in a thread until it is left."""

    def __init__(self, host="127.0.0.1"):
        self.link = ListLink()
        self.stop = Stop()
        self.url = ""
        self._ready = threading.Event()
        address = server.Address(host=host, port=0)
        onlooker = Onlooker(self.link, Observation(500_000))
        self._thread = threading.Thread(
            target=lambda: asyncio.run(
                server.run(
                    onlooker,
                    PAGE,
                    address,
                    stop=self.stop,
                    until=float("inf"),
                    announce=self._announce,
                )
            )
        )

    def _announce(self, url):
        self.url = url
        self._ready.set()

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(60)
        return self

    def __exit__(self, *_):
        self.stop.requested = True
        self._thread.join(60)
        assert not self._thread.is_alive()

    @property
    def host(self):
        return self.url.removeprefix("http://").removesuffix("/")

    def browser(self, **headers):
        origin = headers.pop("origin", f"http://{self.host}")
        return websockets.connect(f"ws://{self.host}/live", origin=origin, max_size=None, **headers)

    def bring(self, name, **signals):
        ident, payload = frame(name, **signals)
        self.link.waiting = [
            can.Message(
                arbitration_id=ident, data=payload, is_extended_id=False, timestamp=time.time()
            )
        ]

    def get(self, path="/", **headers):
        connection = http.client.HTTPConnection(self.host, timeout=1800)
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode(), answer.headers


@pytest.fixture
def served():
    with Served() as running:
        yield running


def rows_until(browser, track, count):
    """Collect the rows of a track until there are ``count``, from whole messages and news."""
    found = []
    while len(found) < count:
        message = json.loads(browser.recv(60))
        found = [] if message["whole"] else found
        found += message["rows"].get(track, [])
    return [row[1:] for row in found]


def test_frames_come_as_rows_and_late_joiners_get_them_too(served):
    with served.browser() as first:
        assert json.loads(first.recv(60))["whole"]
        served.bring("Imu", RollRate=1.5)
        assert rows_until(first, "imu", 1) == [[1.5, 0.0]]
        with served.browser() as second:
            assert rows_until(second, "imu", 1) == [[1.5, 0.0]]
            served.bring("Imu", RollRate=2.0)
            assert rows_until(first, "imu", 1) == rows_until(second, "imu", 1) == [[2.0, 0.0]]


def test_a_browser_that_goes_away_does_not_hold_up_the_others(served):
    with served.browser() as stays:
        with served.browser() as gone:
            gone.recv(60)
            gone.socket.shutdown(socket.SHUT_RDWR)
        served.bring("Imu", RollRate=1.0)
        assert rows_until(stays, "imu", 1) == [[1.0, 0.0]]


def test_the_end_is_a_close_that_browsers_understand():
    with Served() as served, served.browser() as browser:
        browser.recv(60)
        served.stop.requested = True
        for _ in browser:
            pass
        assert browser.close_code == 1001


def test_the_page_is_served_and_may_load_nothing_from_elsewhere(served):
    status, page, headers = served.get()
    assert (status, page) == (200, PAGE)
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert f"connect-src ws://{served.host};" in policy
    assert served.get("/elsewhere")[0] == 404


def test_a_name_that_was_rebound_to_this_machine_is_refused(served):
    status, text, _ = served.get(Host="evil.example:80")
    assert status == 403
    assert PAGE not in text
    assert served.get(Host=f"localhost:{served.host.rpartition(':')[2]}")[0] == 200


def test_a_socket_that_another_page_opens_is_refused(served):
    for origin in ("http://evil.example", "null", "https://" + served.host):
        with pytest.raises(InvalidStatus, match="403"), served.browser(origin=origin):
            pass
    with served.browser(origin=None) as program:
        assert json.loads(program.recv(60))["whole"]


@pytest.mark.parametrize(
    ("host", "ours"),
    [
        ("127.0.0.1:8029", True),
        ("localhost:8029", True),
        ("LOCALHOST", True),
        ("[::1]:8029", True),
        ("[::1]", True),
        ("192.168.1.7:8029", True),
        ("bench7.example:8029", True),
        ("evil.example:8029", False),
        ("127.0.0.1.evil.example:8029", False),
        ("", False),
        (":8029", False),
    ],
)
def test_hosts_that_can_only_be_ours(host, ours):
    assert server.is_ours(host, "bench7.example") is ours


def test_a_taken_port_is_one_line(served):
    port = int(served.host.rpartition(":")[2])
    address = server.Address(host="127.0.0.1", port=port)
    onlooker = Onlooker(ListLink(), Observation(500_000))
    with pytest.raises(CanrollError, match=f"--port {port} is taken: choose another"):
        asyncio.run(
            server.run(onlooker, PAGE, address, stop=Stop(), until=0.0, announce=lambda _: None)
        )


BUS = ["-i", "virtual", "-c", "watch-web"]


def test_who_else_may_watch_is_said(capsys):
    """Nobody speaks on this bus: exit code 1, as in the terminal."""
    command = ["watch", "--web", "--port", "0", "--duration", "0.1", *BUS]
    assert main(command) == 1
    alone = capsys.readouterr().out
    assert "watching at http://127.0.0.1:" in alone
    assert "note:" not in alone
    assert main([*command, "--host", "0.0.0.0"]) == 1
    assert "anyone who can reach 0.0.0.0 can watch" in capsys.readouterr().out


def test_json_is_all_on_stdout(capsys):
    assert main(["watch", "--web", "--port", "0", "--duration", "0.1", "--json", *BUS]) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out)["frames"] == {}
    assert "watching at" in printed.err


def test_without_the_library_the_extra_is_named(capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "hil.watch.server")
    monkeypatch.delattr("hil.watch.server")
    monkeypatch.setitem(sys.modules, "websockets", None)
    for name in [name for name in sys.modules if name.startswith("websockets.")]:
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["watch", "--web", *BUS]) == 2
    error = capsys.readouterr().err
    assert "needs websockets" in error and "'canroll[web]'" in error
    assert error.count("\n") == 1
