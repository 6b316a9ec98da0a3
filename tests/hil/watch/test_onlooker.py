"""What comes over a link, timed by its stamps."""

import can
import pytest
from support.bus_frames import frame

from hil.watch.observation import Observation
from hil.watch.onlooker import Onlooker


def message(name, stamp, **signals):
    ident, payload = frame(name, **signals)
    return can.Message(timestamp=stamp, arbitration_id=ident, data=payload, is_extended_id=False)


def test_frames_taken_at_once_are_apart_by_their_stamps():
    onlooker = Onlooker(None, Observation(500_000))
    taken = [
        message("Imu", 1.8e9),
        message("SuspensionForceCommand", 1.8e9 + 0.004, Counter=2),
        message("ActuatorState", 1.8e9 + 0.01, AcceptedCounter=2),
    ]
    seen = onlooker.take(taken)
    assert [one.t - seen[0].t for one in seen] == pytest.approx([0.0, 0.004, 0.01], abs=1e-6)
    assert seen[-1].t <= onlooker.now()
    assert onlooker.seen.summary()["imu_to_command_ms"]["max"] == pytest.approx(4.0, abs=1e-3)


def test_error_frames_are_counted_and_others_told_apart():
    onlooker = Onlooker(None, Observation(500_000))
    extended = can.Message(timestamp=5.0, arbitration_id=0xA0, is_extended_id=True, data=bytes(8))
    error = can.Message(timestamp=5.0, arbitration_id=0xA0, is_error_frame=True)
    onlooker.take([extended, error, message("Imu", 5.0)])
    summary = onlooker.seen.summary()
    assert summary["error_frames"] == 1
    assert summary["frames"] == {"0x000000A0": 1, "Imu": 1}
