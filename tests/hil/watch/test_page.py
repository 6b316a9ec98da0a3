"""The live page in a browser: a recorded bus is played to a watch that runs as users run it."""

import json
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from support.chromium import PATIENCE, tab

import dbc
from canroll import run
from hil import own_bus
from hil.watch.page import live_page
from plant_sim.can_bus.kernel.layout import DELIVERED

SECONDS = 3.0
SHOWN = """Object.fromEntries([...document.querySelectorAll("#messages tr")].map(
  (row) => [row.cells[0].textContent, Number(row.cells[1].textContent)]))"""


def recorded():
    """Return the frames that were on the bus while the controller drove, in order of reception."""
    driven = run("double_lane_change", law="lqr", duration=SECONDS).controlled.frames
    ours = {message.frame_id for message in dbc.load().messages}
    delivered = [f for f in driven if f["outcome"] == DELIVERED and int(f["ident"]) in ours]
    return sorted(delivered, key=lambda f: f["t_received"])


def last_of(frames, name):
    """Return the signals of the last frame of a message."""
    message = dbc.load().get_message_by_name(name)
    last = [f for f in frames if f["ident"] == message.frame_id][-1]
    return message.decode(last["payload"][: last["length"]].tobytes())


def counts(frames):
    """Return the number of frames by message."""
    names = [dbc.load().get_message_by_frame_id(int(f["ident"])).name for f in frames]
    return {name: names.count(name) for name in names}


class Watch:
    """``canroll watch --web`` on a bus, as a program."""

    def __init__(self, bus):
        command = [sys.executable, "-m", "canroll.cli.main", "watch", "--web", "--port", "0"]
        self.process = subprocess.Popen(
            [*command, *bus.options.split()], stdout=subprocess.PIPE, text=True
        )
        self.url = re.search(r"http://\S+", self.process.stdout.readline())[0]

    def interrupt(self):
        """Press Ctrl-C; return the exit code and what was printed."""
        self.process.send_signal(signal.SIGINT)
        printed, _ = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, printed


def play(bus, page, frames):
    """Play frames to a watch that surely listens; the stamps are those of the recording."""
    # a server leaves out who has only just joined
    while not page.ask(f"({SHOWN})['0x7FF']"):
        bus.send(0x7FF, b"")
        time.sleep(0.02)
    origin = time.time()
    for f in frames:
        payload = f["payload"][: f["length"]].tobytes()
        t = origin + int(f["t_received"]) * 1e-9
        bus._server.publish(int(f["ident"]), 0, payload, length=len(payload), time_s=t)
    assert bus.failed == 0


@contextmanager
def watched():
    """A bus, a watch on it and a browser."""
    bus = own_bus.serve("127.0.0.1:0")
    watch = Watch(bus)
    try:
        with tab() as page:
            page.open(watch.url)
            yield bus, watch, page
            assert page.errors == []
    finally:
        watch.process.kill()
        watch.process.communicate()
        bus.close()


@pytest.mark.slow
def test_the_page_shows_what_is_on_the_bus():
    frames = recorded()
    expected = counts(frames)
    with watched() as (bus, watch, page):
        page.wait_for("document.getElementById('state').textContent.includes('silent')")
        play(bus, page, frames)
        every = "Object.entries(%s).every(([name, count]) => (%s)[name] === count)"
        page.wait_for(every % (json.dumps(expected), SHOWN))
        check(page, frames)
        page.wait_for("document.getElementById('state').textContent.includes('The bus is silent')")
        # who joins late sees the same
        page.reload()
        page.wait_for(every % (json.dumps(expected), SHOWN))
        check(page, frames)
        assert watch.interrupt()[0] == 0
        page.wait_for("document.body.hasAttribute('data-gone')")


def check(page, frames):
    """The page has mode, values and events of the recording, and every plot has data."""
    status, motion = last_of(frames, "RollControlStatus"), last_of(frames, "VehicleMotion")
    assert page.ask("document.querySelector('#mode b').textContent") == "ACTIVE"
    assert page.ask("document.querySelector('#faults b').textContent") == "none"
    for key, value, digits in (
        ("roll_estimate_deg", status["RollAngleEstimate"], 2),
        ("moment_command_nm", status["MomentCommand"], 0),
        ("speed_km_h", motion["VehicleSpeed"], 1),
    ):
        shown = page.ask(f"""document.querySelector("[data-value='{key}']").textContent""")
        # a page and Python round a half to different sides
        assert float(shown.replace("−", "-")) == pytest.approx(value, abs=0.501 * 10**-digits), key
    assert "INIT → ACTIVE" in page.ask("document.getElementById('events').innerText")
    page.ask("choose(60)")
    page.wait_for(
        "[...document.querySelectorAll('#plots figure')].every((f) => Number(f.dataset.points) > 9"
        " || f.id === 'figure-modes' && Number(f.dataset.points) > 1)"
    )


def test_a_drag_zooms_and_keys_pause_and_follow():
    """While time goes on the zoomed range stays, and Escape follows again."""
    with watched() as (_, watch, page):
        page.wait_for("document.body.dataset.drawn > 0.5")
        page.drag("#figure-roll .u-over", 0.4, 0.6)
        low, high = json.loads(page.ask("JSON.stringify(shared.range)"))
        assert 0 < low < high < 30
        page.wait_for("view.now > 1 + Number(document.body.dataset.drawn)")
        assert json.loads(page.ask("JSON.stringify(shared.range)")) == [low, high]
        assert page.ask("document.getElementById('pause').textContent") == "Go on"
        drawn = page.ask("document.body.dataset.drawn")
        press = "document.dispatchEvent(new KeyboardEvent('keydown', { key: '%s' }))"
        page.ask(press % "Escape")
        page.wait_for(f"shared.range === null && document.body.dataset.drawn > {drawn}")
        page.ask(press % "1")
        page.wait_for("shared.window[1] - shared.window[0] === 10")
        page.ask(press % " ")
        assert page.ask("shared.range !== null")
        assert watch.interrupt()[0] == 1


def test_the_page_asks_for_nothing_from_outside():
    page = live_page(bitrate=250_000, assumed=False)
    assert "250 kbit/s (as given)" in page
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    # the first line of uPlot says where it is from
    named = page.replace("/*! https://github.com/leeoniya/uPlot", "")
    assert not re.search(r"@import|url\((?!#)|https?://", named)
