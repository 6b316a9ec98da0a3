"""What the README says of operation is what the firmware does."""

from types import SimpleNamespace

import pytest

from canroll import dbc
from canroll.codegen.export import operation
from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.backends import PythonEcu
from canroll.codegen.run.bus_firmware import built_in, of_bus, with_services
from canroll.firmware.event_trigger import command_slot
from canroll.firmware.state import N_FAULT_CODES, SAFE, TX_STATUS
from canroll.reaction.fault_codes import FAULT_CODES

RECORD = ecu_traffic.random_calibration(7)


def cells(text):
    return [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]


@pytest.mark.slow
def test_every_fault_code_has_a_name_a_function_and_a_requirement():
    text = operation.fault_codes(built_in())
    rows = cells(text)[2:]
    assert [int(row[0]) for row in rows] == list(range(N_FAULT_CODES))
    assert {int(row[0]): row[1] for row in rows} == FAULT_CODES
    assert all(row[2].startswith("`") for row in rows)
    for name in {name for row in rows for name in row[3].split(", ")}:
        assert f"\n- {name}: " in text
    by = {row[1]: row[2] for row in rows}
    assert by["own identifier heard"] == "`own_identifier.watch_own_identifiers`"
    assert by["stroke"] == "`plausibility.lost`"


def test_timeouts_are_those_of_the_calibration():
    text = operation.silence(RECORD, built_in())
    ms = RECORD.tick_us / 1000
    assert f"no valid Imu for {RECORD.timeout_ticks[0] * ms:g} ms | fault code 0" in text
    assert f"after {RECORD.heartbeat_ticks * ms:g} ms" in text


def test_a_slot_that_is_still_pending_is_overwritten_and_its_counter_goes_on():
    """Of a driver that never sends: the newest frame counts, and the counter tells the lost."""
    record = ecu_traffic.random_calibration(3)
    ecu = PythonEcu(record)
    ecu.state.mode = SAFE
    slots, box = (command_slot(record), TX_STATUS), built_in().bus.transmitted
    heard = {slot: [] for slot in slots}
    for _ in range(3 * record.status_ticks + 3 * record.heartbeat_ticks):
        before = {slot: bytes(ecu.state.tx_payload[slot]) for slot in slots}
        built_in().loop.tick(ecu.state, record, 1)
        for slot in slots:
            after = bytes(ecu.state.tx_payload[slot])
            if after != before[slot]:
                heard[slot].append(box[slot].protection.counter.read(after))
                assert ecu.state.tx_pending[slot] == 1
    for slot in slots:
        assert len(heard[slot]) >= 3
        if record.e2e:
            values = box[slot].protection.counter.values
            steps = {(b - a) % values for a, b in zip(heard[slot], heard[slot][1:], strict=False)}
            assert steps == {1}


@pytest.mark.parametrize("services", [(), ("nvm",)])
@pytest.mark.parametrize("secured", [False, True])
def test_wear_is_of_what_the_bundle_writes(services, secured):
    plain = of_bus(dbc.SECURED_PATH, dbc.SECURED_MAP) if secured else built_in()
    text = operation.wear(SimpleNamespace(services=services), with_services(plain, services))
    assert bool(text) == bool(services or secured)
    assert ("`canroll_nvm`, 532 bytes" in text) == bool(services)
    assert ("`secoc.rx_reset`" in text) == secured
    for row in cells(text)[2:]:
        assert int(row[2]) == int(row[1]) * operation.LIFE_STARTS
        assert 2 * int(row[3]) >= int(row[2])
