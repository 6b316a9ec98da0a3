"""A page in headless Chromium, driven over the DevTools protocol."""

import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
]
COMPLAINTS = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
PATIENCE = 1800.0
PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}


class ProtocolError(Exception):
    """The browser could not do what it was called for."""


class Tab:
    """The one tab of a browser."""

    def __init__(self, socket: "ClientConnection") -> None:
        self._socket = socket
        self._calls = 0
        self.errors: list[dict[str, Any]] = []
        self.call("Runtime.enable")
        self.call("Log.enable")

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self._calls += 1
        call = {"id": self._calls, "method": method, "params": parameters}
        self._socket.send(json.dumps(call))
        while True:
            answer = json.loads(self._socket.recv(PATIENCE))
            if answer.get("method") in COMPLAINTS:
                self.errors.append(answer["params"])
            if answer.get("id") == self._calls:
                if "error" in answer:
                    raise ProtocolError(answer["error"])
                result: dict[str, Any] = answer["result"]
                return result

    def ask(self, expression: str) -> Any:
        """Return the value of an expression in the page, of a promise what it comes to."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Return once an expression holds in the page; between two pages there is none."""
        until = time.monotonic() + PATIENCE
        while not self._holds(expression):
            assert time.monotonic() < until, (expression, self.ask("document.body.innerText"))
            time.sleep(0.02)

    def _holds(self, expression: str) -> bool:
        try:
            return bool(self.ask(expression))
        except ProtocolError:
            return False

    def open(self, url: str) -> None:
        """Go to an address and wait until its scripts have run."""
        self.call("Page.navigate", url=url)
        self.wait_for(f"location.href === {json.dumps(url)} && document.readyState === 'complete'")

    def hover(self, selector: str, share: float = 0.5) -> None:
        """Move the mouse onto an element, to a share of its width."""
        self._mouse("mouseMoved", *self._point(selector, share))

    def click(self, selector: str, share: float = 0.5, *, times: int = 1) -> None:
        """Click on an element, so often in a row, at a share of its width."""
        x, y = self._point(selector, share)
        self._mouse("mouseMoved", x, y)
        for count in range(1, times + 1):
            self._mouse("mousePressed", x, y, button="left", clickCount=count)
            self._mouse("mouseReleased", x, y, button="left", clickCount=count)

    def write(self, selector: str, text: str) -> None:
        """Replace the text of an input field, and leave it with Tab."""
        self.click(selector)
        self.ask("document.activeElement.select()")
        self.call("Input.insertText", text=text)
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab")

    def drag(self, selector: str, first: float, last: float) -> None:
        """Drag the mouse across an element, between two shares of its width."""
        (x, y), (end, _) = self._point(selector, first), self._point(selector, last)
        self._mouse("mouseMoved", x, y)
        self._mouse("mousePressed", x, y, button="left", clickCount=1)
        for step in range(1, 5):
            self._mouse("mouseMoved", x + (end - x) * step / 4, y, button="left", buttons=1)
        self._mouse("mouseReleased", end, y, button="left", clickCount=1)

    def _mouse(self, kind: str, x: float, y: float, **more: object) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def _point(self, selector: str, share: float) -> tuple[float, float]:
        """Scroll an element into view and return a point in its middle row."""
        left, top, width, height = self.ask(
            f"""(() => {{
              const node = document.querySelector({json.dumps(selector)});
              node.scrollIntoView({{ block: "center" }});
              const box = node.getBoundingClientRect();
              return [box.left, box.top, box.width, box.height];
            }})()"""
        )
        return left + width * share, top + height / 2


@contextmanager
def shown(path: Path, *calls: tuple[str, dict[str, Any]]) -> Iterator[Tab]:
    """Show a page, after calls of methods of the protocol, once its scripts are done."""
    with tab() as browser:
        for method, parameters in calls:
            browser.call(method, **parameters)
        browser.open(f"file://{path}")
        browser.wait_for("document.body.dataset.ready")
        yield browser
        assert browser.errors == []


ON_A_PHONE = ("Emulation.setDeviceMetricsOverride", PHONE)


@contextmanager
def tab(*flags: str) -> Iterator[Tab]:
    """Run a browser with one tab; a missing package skips the test."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
    if program is None:
        pytest.skip("needs chromium")
    client = pytest.importorskip("websockets.sync.client", reason="needs websockets")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = subprocess.Popen(
            [program, *FLAGS, *flags, f"--user-data-dir={profile}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            with client.connect(_tab_of(browser, Path(profile)), max_size=None) as socket:
                yield Tab(socket)
        finally:
            browser.kill()
            browser.wait()


def _tab_of(browser: subprocess.Popen[bytes], profile: Path) -> str:
    """Wait until the browser says where it listens; return the address of its tab."""
    told = profile / "DevToolsActivePort"
    until = time.monotonic() + PATIENCE
    while True:
        assert browser.poll() is None and time.monotonic() < until
        lines = told.read_text().splitlines() if told.exists() else []
        if len(lines) == 2:
            with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list") as answer:
                tabs = [entry for entry in json.load(answer) if entry["type"] == "page"]
            if tabs:
                return str(tabs[0]["webSocketDebuggerUrl"])
        time.sleep(0.02)
