"""A session in C runs what was recorded, and finds every byte that is another."""

import shutil
import subprocess

import pytest

from canroll.codegen.c99 import emit
from canroll.codegen.export.bundle import TEMPLATES
from canroll.codegen.export.sessions.session import Session
from canroll.codegen.run import ecu_traffic, memory_image, native
from canroll.codegen.run.bus_firmware import built_in
from canroll.firmware.calibration import Calibration

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
CALIBRATION = ecu_traffic.random_calibration(4)


def recorded():
    """A session with every kind of step."""
    session = Session(native.NativeMachine(built_in()), built_in(), gains=False)
    session.begin("the only part")
    cal, ecu = session.record(Calibration()), session.record(built_in().record())
    cal.fill(memory_image.image(CALIBRATION))
    ecu.fill(bytes(len(ecu.image())))
    assert session.call("init", ecu, cal) == 0
    for elapsed, frames in ecu_traffic.random_traffic(2, 20).by_tick():
        session.tick(ecu, cal, elapsed, frames)
    session.call("receive", ecu, -(2**31), bytes(8), 8)
    session.call("tick", ecu, cal, 2**31 - 1)
    session.read(ecu, "tx_pending")
    session.read(ecu, "tx_payload", 1, part=slice(2, 6))
    cal.flip(0, 3)
    session.digest(cal)
    return session


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("session")
    for name, text in emit.firmware().items():
        (path / name).write_text(text)
    for name in ("session.h", "test_session.c"):
        shutil.copy(TEMPLATES / name, path)
    sources = sorted(each.name for each in path.glob("canroll*.c"))
    subprocess.run(["cc", "-std=c99", "-O1", "-c", *sources], cwd=path, check=True)
    return path


def run(folder, session):
    (folder / "session.c").write_text(session.source("A test.", "all of it"))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Werror"]
    objects = sorted(each.name for each in folder.glob("canroll*.o"))
    command = ["cc", *flags, "-o", "session", "session.c", "test_session.c", *objects]
    subprocess.run(command, cwd=folder, check=True)
    return subprocess.run([folder / "session"], capture_output=True, text=True, check=False)


def test_it_gives_what_was_recorded(folder):
    done = run(folder, recorded())
    assert (done.returncode, done.stdout) == (0, "PASS: all of it\n")


@pytest.mark.parametrize("name", ["init", "state of ecu", "ecu.tx_payload", "state of calibration"])
def test_another_byte_is_found(folder, name):
    session = recorded()
    steps = session.parts[0].steps
    place = next(k for k, step in enumerate(steps) if step.operation.name == name)
    step = steps[place]
    wrong = bytes([*step.expected[:-1], step.expected[-1] ^ 1])
    steps[place] = type(step)(step.operation, step.numbers, step.array, wrong)
    done = run(folder, session)
    assert done.returncode == 1
    byte = len(wrong) - 1
    message = f"FAIL: the only part, step {place}: {name}: byte {byte} is {step.expected[-1]}, not"
    assert done.stdout == f"{message} {wrong[-1]}\n"
