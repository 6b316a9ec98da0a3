"""Frames of the ECU's own identifiers that somebody else sends."""

import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware.ecu import receive
from canroll.firmware.plausibility import FAULT_OWN_IDENTIFIER_HEARD
from canroll.firmware.state import (
    ACTIVE,
    TX_ANTI_ROLL_BAR,
    TX_DIAGNOSTICS,
    TX_STATUS,
    TX_SUSPENSION_FORCE,
)

BIT = 1 << FAULT_OWN_IDENTIFIER_HEARD
NOTHING = [0] * 8


def heard(bench: rig.Bench) -> bool:
    return bench.ecu.fault_active & BIT != 0


@pytest.mark.parametrize("slot", [TX_SUSPENSION_FORCE, TX_STATUS, TX_DIAGNOSTICS])
@pytest.mark.parametrize("length", [0, 8])
def test_a_foreign_frame_of_an_own_identifier_is_reported_and_changes_no_mode(slot, length):
    bench = rig.Bench(rig.calibration()).active()
    receive(bench.ecu, fw.N_RX + slot, NOTHING, length)
    bench.step()
    assert heard(bench)
    assert bench.ecu.rx_own == 0
    assert bench.ecu.mode == ACTIVE


def test_the_report_ends_after_the_recovery_time():
    cal = rig.calibration(recovery_ticks=5)
    bench = rig.Bench(cal).active()
    for _ in range(2):
        receive(bench.ecu, fw.N_RX + TX_STATUS, NOTHING, 8)
        bench.step()
    active = [heard(bench)]
    for _ in range(6):
        bench.step()
        active.append(heard(bench))
    assert active == [True] * 5 + [False] * 2
    assert bench.ecu.fault_count[FAULT_OWN_IDENTIFIER_HEARD] == 1


def test_slots_that_are_not_in_use_are_others():
    bench = rig.Bench(rig.calibration()).active()
    receive(bench.ecu, fw.N_RX + TX_ANTI_ROLL_BAR, NOTHING, 8)
    bench.step()
    assert not heard(bench)
