"""A machine runs the firmware's functions by name: CPython, this computer, an emulated Cortex-M."""

import pytest

from canroll import dbc
from canroll.codegen.run import cortex, ecu_traffic, memory_image
from canroll.codegen.run.bus_firmware import of_bus
from canroll.codegen.run.machine import PythonMachine
from canroll.codegen.run.native import NativeMachine, compiler
from canroll.codegen.run.unicorn import CortexMachine
from canroll.firmware.calibration import Calibration
from canroll.firmware.security.secoc_state import SECURED, Secoc

FIRMWARE = of_bus(dbc.SECURED_PATH, dbc.SECURED_MAP)
CALIBRATION = ecu_traffic.random_calibration(3)
MACHINES = {
    "python": PythonMachine,
    "native": NativeMachine,
    "cortex-m4": lambda firmware: CortexMachine(firmware, cpu="cortex-m4"),
}


@pytest.fixture(params=MACHINES)
def machine(request):
    if request.param == "native" and compiler() is None:
        pytest.skip("needs cc")
    if request.param == "cortex-m4" and not cortex.has_pip_tools():
        pytest.skip("needs canroll[target]")
    return MACHINES[request.param](FIRMWARE)


def test_fields_are_read_and_written_by_name(machine):
    record = machine.record(FIRMWARE.record())
    record["time"] = -5
    record["tx_pending"] = [1, 0, 1, 0, 0, 0]
    assert int(record["time"]) == record.value.time == -5
    assert bytes(record["tx_pending"]) == bytes([1, 0, 1, 0, 0, 0])
    expected = FIRMWARE.record()
    expected.time, expected.tx_pending = -5, [1, 0, 1, 0, 0, 0]
    assert record.image() == memory_image.image(expected)
    record.fill(bytes(len(record.image())))
    assert record.image() == memory_image.image(FIRMWARE.record())


def test_records_do_not_overlap(machine):
    first, second = machine.record(FIRMWARE.record()), machine.record(CALIBRATION)
    first.fill(b"\xff" * len(first.image()))
    assert second.image() == memory_image.image(CALIBRATION)


def test_a_function_returns_its_number(machine):
    ecu = machine.record(FIRMWARE.record())
    assert machine.call("init", ecu, machine.record(CALIBRATION)) == 0
    rule = machine.call("init", ecu, machine.record(Calibration()))
    assert rule == FIRMWARE.loop.init(FIRMWARE.record(), Calibration()) != 0


def test_an_array_is_read_as_bytes_and_written_as_a_bytearray(machine):
    secoc, key, frame = FIRMWARE.module("security.secoc"), bytes(range(16)), bytes(range(SECURED))
    record, expected = machine.record(Secoc()), Secoc()
    secoc.start(expected, list(key), 7, 0)
    machine.call("secoc.start", record, key, 7, 0)
    sent, other = bytearray(frame), list(frame)
    secoc.protect(expected, 1, other)
    machine.call("secoc.protect", record, 1, sent)
    assert sent == bytes(other) != frame
    assert record.image() == memory_image.image(expected)
