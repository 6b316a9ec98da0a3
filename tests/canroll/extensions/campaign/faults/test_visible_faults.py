"""How visible a fault is to the residuals, judged by what the firmware finds."""

from dataclasses import replace

import numpy as np
import pytest

from canroll.extensions.campaign.faults.study import residuals_of
from canroll.plant_sim.faults import parse
from canroll.reaction.reaction import observe
from canroll.reaction.visibility import Visibility, accepted, visibility
from canroll.runs.experiment import drive, plan

OFFSETS = {
    "roll rate": "Imu.RollRate=offset:{}@1",
    "acceleration": "Imu.LateralAcceleration=offset:{}@1",
}
SIZES = (0.05, 0.2, 0.4), (1.0, 2.0, 4.0)


class Loop:
    """A lane change on the default bus, by lqr with bars."""

    def __init__(self):
        self.settings, self.controller = plan("double_lane_change", law="lqr", actuator="bars")
        self.bank = residuals_of(self.settings, self.controller)
        self.passive = drive(self.settings, self.controller, enabled=False)
        self.healthy = drive(self.settings, self.controller, enabled=True)

    def with_fault(self, fault):
        trace = drive(replace(self.settings, faults=(fault,)), self.controller, enabled=True)
        found = observe(trace, self.passive, parse(fault), self.healthy).detected_after is not None
        return self.visible(trace), found

    def visible(self, trace):
        return visibility(trace, self.healthy, self.bank, self.settings.vehicle, 1.0)


@pytest.fixture(scope="module")
def loop():
    return Loop()


def test_without_faults_all_that_is_received_is_right(loop):
    other = replace(loop.settings, seed=7)
    assert loop.visible(drive(other, loop.controller, enabled=True)) == Visibility()
    assert not Visibility().sure and "right" in Visibility().text


@pytest.mark.parametrize(
    ("fault", "sizes"), list(zip(OFFSETS.values(), SIZES, strict=True)), ids=list(OFFSETS)
)
def test_what_is_sure_to_be_found_is_found_by_the_firmware(loop, fault, sizes):
    rows = [loop.with_fault(fault.format(size)) for size in sizes]
    shares = [visible.share for visible, _ in rows]
    assert shares == sorted(shares) and shares[0] < 0.5 and shares[-1] > 1.0
    assert all(found for visible, found in rows if visible.sure)
    assert "would find it" in rows[0][0].text


def test_an_axle_that_reports_what_it_does_not_do_is_wrong_by_that(loop):
    visible, _ = loop.with_fault("front=stuck@1.6 + front=lying@1.6")
    assert visible.signal == "moment_front" and visible.residual
    honest, _ = loop.with_fault("front=derating:0.5@1.6")
    assert honest.share < 0.05 < visible.share


def test_frames_that_the_ecu_refuses_are_not_received(loop):
    frames, values = accepted(loop.healthy.frames, "Imu")
    other = np.array(loop.healthy.frames)
    imu = np.flatnonzero(other["ident"] == frames["ident"][0])
    other["payload"][imu[100], 3] ^= 1
    other["length"][imu[200]] = 4
    fewer, rest = accepted(other, "Imu")
    assert len(frames) - len(fewer) == 2
    assert set(fewer["t_origin"]) < set(frames["t_origin"])
    assert set(rest["RollRate"]) <= set(values["RollRate"])


def test_a_loop_without_residuals_has_no_visibility():
    settings, controller = plan("double_lane_change", law="lqr", observer="reference")
    assert residuals_of(settings, controller) is None
