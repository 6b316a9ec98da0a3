"""A clock that only moves when it is slept on or told to, and a bus that is a list."""

import signal
import subprocess
import sys
import time

import pytest

from canroll.hil import ecu_loop, plant_loop
from canroll.setup import controller

PATIENCE = 1800.0


class Clock:
    """Stands in for the module ``time`` in a loop; ``late`` adds to chosen sleeps, ns."""

    def __init__(self):
        self.now = 1_000_000_000
        self.late = {}
        self.sleeps = 0

    def monotonic_ns(self):
        return self.now

    def monotonic(self):
        return self.now * 1e-9

    def sleep(self, seconds):
        self.now += round(seconds * 1e9) + self.late.get(self.sleeps, 0)
        self.sleeps += 1


@pytest.fixture(scope="session")
def make_clock():
    return Clock


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    for loop in (ecu_loop, plant_loop):
        monkeypatch.setattr(loop, "time", clock)
    return clock


class ListBus:
    """What is in ``waiting`` is received once; what is sent is kept with its instant."""

    failed = 0

    def __init__(self, clock):
        self.clock = clock
        self.waiting = []
        self.out = []
        self.sent = self.received = 0

    def receive(self):
        waiting, self.waiting = self.waiting, []
        self.received += len(waiting)
        return waiting

    def send(self, ident, payload):
        self.out.append((self.clock.now, ident, payload))
        self.sent += 1

    def close(self):
        pass


@pytest.fixture
def list_bus(clock):
    return ListBus(clock)


@pytest.fixture(scope="session")
def calibration():
    return controller.prepare({"law": "lqr", "actuator": "suspension"}).record


@pytest.fixture(scope="session")
def calibration_file(tmp_path_factory):
    from canroll.gain_gen.calibration import calibration_file as files

    prepared = controller.prepare({"law": "lqr", "actuator": "suspension"})
    path = tmp_path_factory.mktemp("design") / "calibration.toml"
    files.save(path, prepared.record, prepared.tables)
    return path


class Program:
    """A canroll program in the background; its lines are waited for."""

    def __init__(self, log, *arguments):
        self.log = log
        with log.open("w") as out:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "canroll.cli.main", *map(str, arguments)],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def said(self):
        return self.log.read_text()

    def wait_for(self, text):
        until = time.monotonic() + PATIENCE
        while text not in self.said:
            assert self.process.poll() is None or text in self.said, self.said
            assert time.monotonic() < until, self.said
            time.sleep(0.01)

    def end(self):
        return self.process.wait(PATIENCE)

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@pytest.fixture
def programs(tmp_path):
    started = []

    def start(name, *arguments):
        program = Program(tmp_path / f"{name}-{len(started)}.txt", *arguments)
        started.append(program)
        return program

    yield start
    for program in started:
        if program.process.poll() is None:
            program.kill()
