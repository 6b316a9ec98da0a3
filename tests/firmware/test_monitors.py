"""Monitors: each sensor against the others, delivered moments against their commands."""

import numpy as np
import pytest
import rig

from firmware import calibration as fw
from firmware import plausibility as sv
from firmware.monitors.delivery import note_command, watch_delivery
from firmware.monitors.redundancy import envelope, median, watch_redundancy
from firmware.monitors.watch import watch
from firmware.state import (
    ACTIVE,
    DEGRADED,
    RX_ACTUATOR_STATE,
    RX_IMU,
    SAFE,
    Ecu,
)
from firmware.supervisor import change_mode

ARM, STIFFNESS, DAMPING, INERTIA = 1600.0, 240_000.0, 15_600.0, 1400.0
STEP = 0.01
HALF_TRACK = 0.87


def monitored(**overrides) -> fw.Calibration:
    """A calibration with every monitor on, for a rigid-tyred body of the numbers above."""
    cal = rig.calibration(**overrides)
    cal.turn_shift, cal.response_shift = 7, 8
    cal.monitor_gap_max, cal.monitor_samples = 3, 5
    cal.monitor_limit = 6 << fw.Q_ACCELERATION
    cal.monitor_step = round(STEP * 2**30)
    cal.monitor_stiffness = round(STIFFNESS / ARM * 2**20)
    cal.monitor_damping = round(DAMPING / ARM * 2**20)
    cal.monitor_inertia = round(INERTIA / ARM / (3 * STEP) * 2**20)
    cal.monitor_moment = round(2**36 / ARM)
    cal.response_min = round(0.4 * 2**fw.Q_ACCELERATION)
    cal.response_rough = round(3.0 * 2**20)
    cal.turn_min, cal.warp_min = round(0.006 * 2**27), round(0.012 * 2**27)
    cal.delivery_min = 500 << fw.Q_MOMENT
    cal.arm_front = cal.arm_rear = round(2**28 / (2 * HALF_TRACK))
    cal.track_front = cal.track_rear = round(2**28 * 2 * HALF_TRACK)
    return cal


class Body:
    """A body that rolls by m h a = K s + C s' + I s'' - M, and the sensors' readings of it."""

    def __init__(self) -> None:
        self.roll = self.rate = self.moment = 0.0
        self.wrong: dict[str, float] = {}

    def advance(self, lateral: float) -> None:
        """Advance by a sample, implicitly."""
        for _ in range(10):
            pushed = ARM * lateral + self.moment - STIFFNESS * self.roll - DAMPING * self.rate
            self.rate += STEP / 10 * pushed / INERTIA
            self.roll += STEP / 10 * self.rate

    def read(self, ecu: Ecu, lateral: float, speed: float = 20.0) -> None:
        """Fill the ECU's inputs; ``wrong`` adds to a reading by its name."""
        add = self.wrong.get
        ecu.roll_rate = round((self.rate + add("roll_rate", 0.0)) * 2**27)
        ecu.lateral_acceleration = round((lateral + add("lateral", 0.0)) * 2**24)
        ecu.yaw_rate = round(lateral / speed * 2**27)
        ecu.speed = round(speed * 2**20)
        strokes = [side * self.rate * HALF_TRACK for side in (1, -1, 1, -1)]
        strokes[0] += add("stroke", 0.0)
        ecu.stroke_rate = [round(stroke * 2**27) for stroke in strokes]
        ecu.delivered = [round((self.moment + add("moment", 0.0)) / 2 * 2**14)] * 2


def driven(wrong: dict[str, float], *, size: float = 3.0, seconds: float = 4.0) -> Ecu:
    """An ECU after a lane change at ``size`` m/s², with readings wrong from 1 s on."""
    cal, body = monitored(), Body()
    ecu = rig.started(cal)
    ecu.moment_unknown, ecu.gain_factor = 0, 1 << 28
    for k in range(round(seconds / STEP)):
        lateral = size * np.sin(2.5 * k * STEP)
        body.moment = -500.0 * lateral
        body.advance(lateral)
        body.wrong = wrong if k >= 100 else {}
        body.read(ecu, lateral)
        ecu.fresh[RX_IMU] = 1
        ecu.age[2] = 0
        watch_redundancy(ecu, cal, 1)
    return ecu


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"roll_rate": 0.05}, sv.FAULT_ROLL_RATE_CONTRADICTED),
        ({"roll_rate": -0.05}, sv.FAULT_ROLL_RATE_CONTRADICTED),
        ({"lateral": 2.5}, sv.FAULT_LATERAL_CONTRADICTED),
        ({"lateral": -2.5}, sv.FAULT_LATERAL_CONTRADICTED),
        ({"stroke": 0.5}, sv.FAULT_STROKE_CONTRADICTED),
        ({"moment": 4500.0}, sv.FAULT_ACTUATOR_CONTRADICTED),
    ],
)
def test_a_sensor_that_contradicts_the_others_is_named(wrong, code):
    assert driven(wrong).accused >> code & 1 == 1


@pytest.mark.parametrize("wrong", [{}, {"roll_rate": 0.002}, {"lateral": 0.2}])
def test_good_sensors_are_not_accused(wrong):
    assert driven(wrong, seconds=8.0).accused == 0


def test_near_the_limit_nothing_is_judged():
    ecu = driven({"roll_rate": 0.3}, size=9.0, seconds=1.1)
    assert ecu.near_limit > monitored().monitor_limit
    assert ecu.accused == 0
    assert (ecu.stroke_roll, ecu.turn_roll, ecu.response) == (0, 0, 0)


def test_missing_samples_start_anew():
    cal, ecu = monitored(), driven({})
    assert ecu.stroke_roll != 0
    ecu.fresh[RX_IMU] = 0
    for _ in range(4):
        watch_redundancy(ecu, cal, 1)
    assert ecu.stroke_roll != 0
    ecu.fresh[RX_IMU] = 1
    watch_redundancy(ecu, cal, 1)
    assert ecu.stroke_roll == 0
    assert ecu.monitor_gap == 0


def test_without_limits_nothing_is_compared():
    cal = monitored()
    cal.monitor_limit = 0
    ecu = rig.started(cal)
    ecu.fresh[RX_IMU], ecu.stroke_rate[0] = 1, 1 << 27
    watch_redundancy(ecu, cal, 1)
    assert (ecu.stroke_roll, ecu.rough, ecu.monitor_gap) == (0, 0, 0)


def test_the_median_is_the_second_of_three():
    for values in np.random.default_rng(1).integers(0, 1 << 29, (50, 3)).tolist():
        assert median(*values) == sorted(values)[1]


def test_an_envelope_rises_at_once_and_decays():
    assert envelope(0, 1000, 4) == 1000
    assert envelope(1600, 1000, 4) == 1500
    assert envelope(1600, 1500, 4) == 1500


def following(actuator: int, delivered: float, *, samples: int = 30, **status) -> Ecu:
    """An ECU that has commanded 1000 N·m at each axle for a while; ``delivered`` at the front."""
    cal = monitored(actuator=actuator)
    ecu = rig.started(cal)
    ecu.enabled = ecu.command_held = 1
    force = round(500.0 / HALF_TRACK * 2**14)
    ecu.force = [force, -force, force, -force]
    ecu.bar = [1000 << 14] * 2
    note_command(ecu, cal)
    for name, value in status.items():
        setattr(ecu, name, value)
    ecu.fresh[RX_ACTUATOR_STATE] = 1
    for _ in range(samples):
        ecu.delivered = [round(delivered * 2**14), 1000 << 14]
        watch_delivery(ecu, cal)
    return ecu


@pytest.mark.parametrize("actuator", [fw.SUSPENSION, fw.BARS])
@pytest.mark.parametrize(
    ("delivered", "fault"), [(-1000.0, 1), (0.0, 1), (2000.0, 1), (1000.0, 0), (400.0, 0)]
)
def test_a_moment_outside_the_band_of_its_commands_is_a_fault(actuator, delivered, fault):
    found = following(actuator, delivered).accused >> sv.FAULT_ACTUATOR_CONTRADICTED & 1
    assert found == fault


@pytest.mark.parametrize(
    "status", [{"enabled": 0}, {"command_held": 0}, {"status": [2, 0, 0, 0]}, {"status": [1] * 4}]
)
def test_what_follows_no_command_is_not_judged(status):
    assert following(fw.BARS, 0.0, **status).accused == 0


def test_a_limited_actuator_may_fall_short_but_not_push_the_other_way():
    assert following(fw.BARS, -1000.0, status=[1] * 4).accused != 0


def test_findings_last_and_decide_the_mode():
    cal = monitored()
    for code, expected in (
        (sv.FAULT_STROKE_CONTRADICTED, DEGRADED),
        (sv.FAULT_ROLL_RATE_CONTRADICTED, SAFE),
        (sv.FAULT_LATERAL_CONTRADICTED, SAFE),
        (sv.FAULT_ACTUATOR_CONTRADICTED, SAFE),
    ):
        ecu = rig.started(cal)
        ecu.mode, ecu.accused = ACTIVE, 1 << code
        for _ in range(2 * cal.recovery_ticks):
            change_mode(ecu, cal, watch(ecu, cal, 1))
            assert ecu.mode == expected
        assert ecu.found >> code & 1 == 1
    ecu.accused, ecu.lateral_lost = 1 << sv.FAULT_STROKE_CONTRADICTED, 1
    assert watch(ecu, cal, 1) == sv.UNSAFE
