"""The watch in a browser: a page, and a socket that pushes the stream to its clients.

It listens on loopback by default. A foreign page must not read the bus through the user's browser:
requests with a foreign name as Host (DNS rebinding), and sockets opened by another page (Origin),
are refused.
"""

import asyncio
import errno
import ipaddress
import logging
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus

from websockets.asyncio.connection import broadcast
from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response

from canroll.errors import CanrollError, reason
from hil.process import Stop
from hil.watch.onlooker import Onlooker
from hil.watch.stream import LiveStream

PERIOD = 0.05
"""Time between two messages to the browsers, s."""
SOCKET = "/live"


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Address on which the server listens; port 0 selects a free one."""

    host: str
    port: int


async def run(
    onlooker: Onlooker,
    page: str,
    address: Address,
    *,
    stop: Stop,
    until: float,
    announce: Callable[[str], None],
) -> None:
    """Watch and serve until a stop request or until the monotonic clock reaches ``until``.

    Args:
        onlooker: monitor of the bus.
        page: HTML of the page, which opens a socket at :data:`SOCKET`.
        address: address to listen on.
        stop: checked once per period.
        until: s.
        announce: called with the page's URL once it can be opened.

    Raises:
        CanrollError: it is impossible to listen on the address.
    """
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    stream = LiveStream(onlooker.seen)
    browsers: set[ServerConnection] = set()

    async def greet(browser: ServerConnection) -> None:
        # not awaited in between, so that no news gets lost or comes first
        broadcast([browser], stream.everything(lost=onlooker.link.lost))
        browsers.add(browser)
        try:
            await browser.wait_closed()
        finally:
            browsers.discard(browser)

    def answer(browser: ServerConnection, request: Request) -> Response | None:
        return respond(browser, request, page=page, name=address.host)

    try:
        server = await serve(
            greet,
            address.host,
            address.port,
            process_request=answer,
            compression=None,
            ping_interval=5,
            ping_timeout=15,
            close_timeout=1,
            max_size=1024,
        )
    except OSError as error:
        raise CanrollError(_refusal(error, address)) from error
    async with server:
        announce(url(next(iter(server.sockets)).getsockname()[:2]))
        while not stop.requested and time.monotonic() < until:
            await asyncio.sleep(PERIOD)
            # a lost bus is opened again in here, which may take its time
            messages = await asyncio.to_thread(onlooker.link.messages)
            stream.add(onlooker.take(messages), onlooker.now())
            broadcast(browsers, stream.news(lost=onlooker.link.lost))


def respond(
    browser: ServerConnection, request: Request, *, page: str, name: str
) -> Response | None:
    """Return the response to a request, or None if it may open the socket.

    Args:
        browser: connection of the request.
        request: a GET request.
        page: response for the path ``/``.
        name: host name given by the user.
    """
    hosts = request.headers.get_all("Host")
    if len(hosts) != 1 or not is_ours(hosts[0], name):
        text = "canroll watch: open the address that it printed; other names are refused\n"
        return browser.respond(HTTPStatus.FORBIDDEN, text)
    if request.path == SOCKET:
        origins = request.headers.get_all("Origin")
        if origins and origins != [f"http://{hosts[0]}"]:
            return browser.respond(HTTPStatus.FORBIDDEN, "canroll watch: not for other pages\n")
        return None
    if request.path != "/":
        return browser.respond(HTTPStatus.NOT_FOUND, "canroll watch: the page is at /\n")
    response = browser.respond(HTTPStatus.OK, page)
    headers = response.headers
    del headers["Content-Type"]
    headers["Content-Type"] = "text/html; charset=utf-8"
    headers["Cache-Control"] = "no-store"
    headers["X-Content-Type-Options"] = "nosniff"
    headers["Referrer-Policy"] = "no-referrer"
    headers["Content-Security-Policy"] = (
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
        f"img-src data:; connect-src ws://{hosts[0]}; frame-ancestors 'none'; base-uri 'none'"
    )
    return response


def is_ours(host: str, name: str) -> bool:
    """Return whether a Host header can only mean this server.

    An address cannot be rebound to another machine, a name can: only ``localhost`` and the user's
    ``name`` are accepted.
    """
    given = host.rpartition(":")[0] if _has_port(host) else host
    given = given.removeprefix("[").removesuffix("]").lower()
    return given in ("localhost", name.lower()) or _address(given) is not None


def url(listening: tuple[str, int]) -> str:
    """Return the URL of the page served at an address."""
    host, port = listening
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def _has_port(host: str) -> bool:
    return host.rpartition(":")[2].isdigit() and not host.endswith("]") and host.count(":") > 0


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    with suppress(ValueError):
        return ipaddress.ip_address(text)
    return None


def _refusal(error: OSError, address: Address) -> str:
    """Return the reason why listening on an address failed, in one line."""
    if error.errno == errno.EADDRINUSE:
        return f"--port {address.port} is taken: choose another, or 0 for a free one"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"--port {address.port} is not for this user: choose one above 1023"
    return f"cannot listen on --host {address.host} --port {address.port}: {reason(error)}"
