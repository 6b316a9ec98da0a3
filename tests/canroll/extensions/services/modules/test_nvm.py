"""What outlives a loss of power: saved, restored, and refused where the record is not right."""

import random
from copy import deepcopy

import pytest
import rig

from canroll.codegen.run import memory_image, native
from canroll.codegen.run.bus_firmware import built_in, with_services
from canroll.extensions.services.modules import fault_memory, nvm, nvm_state, nvm_uds, uds
from canroll.extensions.services.modules.nvm_state import (
    ANOTHER_CALIBRATION,
    ANOTHER_VERSION,
    DAMAGED,
    Nvm,
)
from canroll.extensions.services.modules.uds_state import Uds
from canroll.firmware import ecu as loop
from canroll.firmware.state import Ecu
from canroll.firmware.subset import fields

IMU_LATE = 0
SERVED = with_services(built_in(), ("uds", "nvm", "nvm_uds"))


@pytest.fixture
def cal():
    its = rig.calibration()
    its.offset_learning = 1
    its.offset_rate_max, its.offset_acceleration_max = 1 << 20, 1 << 18
    its.id = 7
    return rig.sealed(its)


def driven(cal):
    """An ECU that has met faults and learnt offsets, its diagnostics and the record."""
    ecu, server, kept = Ecu(), Uds(), Nvm()
    assert loop.init(ecu, cal) == 0
    uds.init(server, ecu)
    for _ in range(300):
        loop.tick(ecu, cal, 1)
        uds.tick(server, ecu, cal, 1)
    assert ecu.fault_latched != 0 and server.known == ecu.fault_latched
    ecu.offset_rate, ecu.offset_acceleration = -12345, 6789
    nvm.save(kept, ecu, cal)
    return ecu, server, kept


def started(cal):
    ecu, server = Ecu(), Uds()
    assert loop.init(ecu, cal) == 0
    uds.init(server, ecu)
    return ecu, server


def test_faults_and_offsets_outlive_a_loss_of_power(cal):
    before, _, kept = driven(cal)
    assert nvm.size(kept) == len(memory_image.image(kept))
    ecu, _ = started(cal)
    unlike = {name for name, value in vars(ecu).items()}
    assert nvm.restore(kept, ecu, cal) == 0
    restored = {"fault_latched", "fault_count", "offset_rate", "offset_acceleration"}
    fresh, _ = started(cal)
    unlike = {name for name in unlike if getattr(ecu, name) != getattr(fresh, name)}
    assert unlike == restored
    assert all(getattr(ecu, name) == getattr(before, name) for name in restored)


def test_offsets_stay_within_what_the_calibration_allows(cal):
    before, _, kept = driven(cal)
    before.offset_rate, before.offset_acceleration = 1 << 29, -(1 << 29)
    nvm.save(kept, before, cal)
    ecu, _ = started(cal)
    assert nvm.restore(kept, ecu, cal) == 0
    assert (ecu.offset_rate, ecu.offset_acceleration) == (1 << 20, -(1 << 18))
    cal.offset_learning = 0
    ecu, _ = started(rig.sealed(cal))
    assert nvm.restore(kept, ecu, cal) == 0
    assert (ecu.offset_rate, ecu.offset_acceleration) == (0, 0)


def test_counts_go_on_and_saturate(cal):
    before, _, kept = driven(cal)
    code = before.fault_latched.bit_length() - 1
    before.fault_count[code] = 250
    nvm.save(kept, before, cal)
    ecu, _ = started(cal)
    ecu.fault_count[code] = 3
    assert nvm.restore(kept, ecu, cal) == 0
    assert ecu.fault_count[code] == 253
    assert nvm.restore(kept, ecu, cal) == 0
    assert ecu.fault_count[code] == 255


def test_a_record_that_is_not_right_leaves_the_ecu_as_after_init(cal):
    _, server, kept = driven(cal)
    nvm_uds.save(kept, server)
    rng = random.Random(1)
    image = memory_image.image(kept)
    blank = Nvm()
    memory_image.fill(blank, b"\xff" * len(image))
    refused = {ANOTHER_VERSION: [blank, Nvm()], DAMAGED: [], ANOTHER_CALIBRATION: [kept]}
    for field in fields(Nvm):
        if field.name != "version":
            damaged = deepcopy(kept)
            data = bytearray(image)
            kind = memory_image.dtype(Nvm).fields[field.name]
            data[kind[1] + rng.randrange(kind[0].itemsize)] ^= 1 << rng.randrange(8)
            memory_image.fill(damaged, bytes(data))
            refused[DAMAGED].append(damaged)
    for reason, records in refused.items():
        its = deepcopy(cal)
        if reason == ANOTHER_CALIBRATION:
            its.id = 8
        for each in records:
            ecu, other = started(cal)
            assert nvm.restore(each, ecu, its) == reason
            assert nvm_uds.restore(each, other, ecu, its) == reason
            fresh, fresh_server = started(cal)
            assert vars(ecu) == vars(fresh)
            assert vars(other) == vars(fresh_server)


def test_snapshots_outlive_it_and_are_not_of_this_cycle(cal):
    before, server, kept = driven(cal)
    nvm_uds.save(kept, server)
    ecu, other = started(cal)
    assert nvm.restore(kept, ecu, cal) == 0
    assert nvm_uds.restore(kept, other, ecu, cal) == 0
    assert (other.kept, other.kept_mode, other.known) == (
        server.kept,
        server.kept_mode,
        server.known,
    )
    code = before.fault_latched.bit_length() - 1
    assert fault_memory.status(other, ecu, code) == fault_memory.CONFIRMED
    # it fails again: the snapshot stays that of the first time
    for _ in range(300):
        loop.tick(ecu, cal, 1)
        uds.tick(other, ecu, cal, 1)
    assert ecu.fault_active >> code & 1
    here = fault_memory.CONFIRMED | fault_memory.FAILED_HERE | fault_memory.FAILED
    assert fault_memory.status(other, ecu, code) == here
    assert other.kept[code] == server.kept[code]


@pytest.mark.slow
@pytest.mark.skipif(native.compiler() is None, reason="needs cc (package gcc)")
def test_c_saves_and_restores_the_same(cal):
    before, server, kept = driven(cal)
    machine = native.NativeMachine(SERVED)
    c_nvm, c_cal = machine.record(nvm_state.Nvm()), machine.record(cal)
    machine.call("nvm.save", c_nvm, machine.record(before), c_cal)
    machine.call("nvm_uds.save", c_nvm, machine.record(server))
    nvm_uds.save(kept, server)
    assert c_nvm.image() == memory_image.image(kept)
    ecu, other = started(cal)
    c_ecu, c_uds = machine.record(ecu), machine.record(other)
    assert machine.call("nvm.restore", c_nvm, c_ecu, c_cal) == nvm.restore(kept, ecu, cal)
    assert machine.call("nvm_uds.restore", c_nvm, c_uds, c_ecu, c_cal) == 0
    assert nvm_uds.restore(kept, other, ecu, cal) == 0
    assert c_ecu.image() == memory_image.image(ecu)
    assert c_uds.image() == memory_image.image(other)
