"""``init`` starts the ECU at rest, whatever was in its memory."""

import numpy as np
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware.state import AGE_MAX, N_TX, Ecu
from canroll.firmware.subset import fields


def filled(shape, value):
    return [filled(shape[1:], value) for _ in range(shape[0])] if shape else value


def test_init_leaves_nothing_of_what_was_there():
    cal = rig.sealed(rig.calibration())
    dirty, fresh = Ecu(), Ecu()
    for field in fields(Ecu):
        setattr(dirty, field.name, filled(field.shape, field.f.hi))
    assert loop.init(dirty, cal) == loop.init(fresh, cal) == 0
    assert vars(dirty) == vars(fresh)


def test_everything_starts_at_zero_but_what_is_calibrated_or_means_that_nothing_has_come_yet():
    shares = [(9 + k) << 26 for k in range(8)]
    cal = rig.calibration(law=fw.OUTPUT_FEEDBACK, schedule_front_share=shares)
    ecu = rig.started(cal)
    expected = {
        # full authority for the feedforward, the command due at once, its first counter 0
        "feedforward": 1 << 30,
        "since_sent": AGE_MAX,
        # every corner may give all
        "trust": [1 << 30] * 4,
        "tx_counter": [14] * N_TX,
        # nothing is known of the vehicle's motion and moment, no counter has been seen
        "motion_lost": 1,
        "moment_unknown": 1,
        "frozen_lateral": fw.STATE_MAX,
        "echo": 255,
        "e2e_last": [255] * fw.N_RX,
        "last_sample": [16] * fw.N_RX,
        "sample_gap": [AGE_MAX, 0],
        # as calibrated
        "e2e_delta": cal.e2e_max_delta,
        "front_share": cal.schedule_front_share[0],
        "law": cal.law,
        "covariance": np.diag(cal.covariance_start).tolist(),
        "rls_covariance": [cal.rls_start, 0, cal.rls_start],
        "theta": [1 << 28, 1 << 28],
        "model": [[*cal.phi[i][:3], cal.gamma[i]] for i in range(2)],
    }
    for field in fields(Ecu):
        value = getattr(ecu, field.name)
        if field.name in expected:
            assert value == expected[field.name], field.name
        else:
            assert not np.any(value), field.name
