"""``init`` starts the ECU at rest, whatever was in its memory."""

import numpy as np
import rig

from firmware import ecu as loop
from firmware.state import Ecu
from firmware.subset import fields


def filled(shape, value):
    return [filled(shape[1:], value) for _ in range(shape[0])] if shape else value


def test_init_leaves_nothing_of_what_was_there():
    cal = rig.calibration()
    dirty, fresh = Ecu(), Ecu()
    for field in fields(Ecu):
        setattr(dirty, field.name, filled(field.shape, field.f.hi))
    assert loop.init(dirty, cal) == loop.init(fresh, cal) == 0
    scratch = {"rx_payload", "work"}
    different = {
        field.name
        for field in fields(Ecu)
        if getattr(dirty, field.name) != getattr(fresh, field.name)
    }
    assert different <= scratch


def test_nothing_is_estimated_commanded_or_sent_at_the_start():
    ecu = rig.started(rig.calibration())
    for name in (
        "x",
        "ahead",
        "ring",
        "ring_head",
        "offset_rate",
        "offset_acceleration",
        "steering_acceleration",
        "moment",
        "outputs",
        "sent",
        "force",
        "bar",
        "current",
        "tx_pending",
        "compensator_x",
        "authority",
        "trouble_active",
        "trouble_count",
    ):
        assert not np.any(getattr(ecu, name)), name
