"""When commands are sent: the mixed rule, heartbeats, echoes, losses, delays."""

import numpy as np
import pytest
import rig
from hypothesis import given
from hypothesis import strategies as st

from canroll.firmware import calibration as fw
from canroll.firmware.event_trigger import HEARTBEAT, NOTHING, TRIGGERED, moved
from canroll.firmware.plausibility import FAULT_COMMAND
from canroll.firmware.state import ACTIVE, SAFE

EPSILON_SQUARED, FLOOR = 0.1, 60.0
RULE = {
    "event_trigger": 1,
    "trigger_epsilon_squared": round(EPSILON_SQUARED * 2**20),
    "trigger_floor": round(FLOOR * 2**14),
}
moments = st.floats(-60000.0, 60000.0)


@given(moments, moments, moments, moments)
def test_the_rule_compares_with_what_was_sent(u0, u1, s0, s1):
    ecu = rig.started(rig.calibration(**RULE))
    ecu.outputs = [round(u0 * 2**14), round(u1 * 2**14)]
    ecu.sent = [round(s0 * 2**14), round(s1 * 2**14)]
    error = (u0 - s0) ** 2 + (u1 - s1) ** 2
    threshold = EPSILON_SQUARED * (s0**2 + s1**2) + FLOOR**2
    # squares are taken of quarter newton metres
    if abs(np.sqrt(error) - np.sqrt(threshold)) > 1.0:
        assert moved(ecu, rig.calibration(**RULE)) == (error > threshold)


def history(bench: rig.Bench, seconds: float, ay) -> list[tuple[int, float]]:
    """Reason to send and moment of every tick."""
    rows = []
    for _ in range(round(seconds / bench.tick)):
        bench.step(ay)
        rows.append((bench.ecu.triggered, bench.ecu.moment / 2**14))
        assert (0 in bench.frames) == (bench.ecu.triggered != NOTHING)
    return rows


def test_every_command_of_a_manoeuvre_is_due_and_none_is_missing():
    bench = rig.Bench(rig.calibration(**RULE), noise=(0.0017, 0.05)).active()
    sent, since = bench.ecu.sent[0] / 2**14, bench.ecu.since_sent
    rows = history(bench, 6.0, rig.lane_change)
    for reason, moment in rows:
        since += 1
        due = (moment - sent) ** 2 > EPSILON_SQUARED * sent**2 + FLOOR**2
        expected = TRIGGERED if due else HEARTBEAT if since >= 5 else NOTHING
        assert reason == expected
        if reason != NOTHING:
            sent, since = moment, 0
    reasons = [reason for reason, _ in rows]
    assert 20 < reasons.count(TRIGGERED) < 200
    assert bench.ecu.commands_sent >= reasons.count(HEARTBEAT) > 50
    assert bench.ecu.fault_latched == 0


def test_without_the_trigger_every_tick_sends():
    bench = rig.Bench(rig.calibration()).active()
    assert all(reason == TRIGGERED for reason, _ in history(bench, 0.5, rig.lane_change))


def test_standing_still_only_the_heartbeat_beats():
    bench = rig.Bench(rig.calibration(**RULE), speed_kmh=0.0).active()
    reasons = [reason for reason, _ in history(bench, 1.0, lambda t: 0.0)]
    assert reasons.count(HEARTBEAT) == 20
    assert reasons.count(TRIGGERED) == 0


def test_a_lost_command_is_sent_again_when_its_echo_is_overdue():
    bench = rig.Bench(rig.calibration(**RULE, heartbeat_ticks=100)).active()
    bench.run(1.0)
    while bench.ecu.triggered != TRIGGERED:
        bench.lose_commands = True
        bench.step(3.0)
    bench.lose_commands = False
    again = [reason for reason, _ in history(bench, 0.06, lambda t: 0.0)]
    # the loss is noticed after acknowledge_ticks; the moment may have moved before
    assert TRIGGERED in again[: bench.cal.acknowledge_ticks]
    bench.run(0.05)
    assert bench.ecu.waiting == 0


def test_commands_that_never_arrive_are_a_fault_and_repeat_as_the_echo_is_overdue():
    bench = rig.Bench(rig.calibration(**RULE, heartbeat_ticks=20), speed_kmh=0.0).active()
    bench.lose_commands = True
    while bench.ecu.triggered != HEARTBEAT:
        bench.step()
    # at standstill nothing triggers: what is sent now is sent again
    reasons = [reason for reason, _ in history(bench, 0.6, lambda t: 0.0)]
    assert 60 // 3 - 2 <= reasons.count(TRIGGERED) <= 60 // 3 + 1
    assert bench.ecu.fault_active >> FAULT_COMMAND & 1
    assert bench.ecu.mode == ACTIVE
    bench.lose_commands = False
    bench.run(0.1)
    assert not bench.ecu.fault_active >> FAULT_COMMAND & 1
    assert bench.ecu.fault_latched >> FAULT_COMMAND & 1
    assert bench.ecu.fault_count[FAULT_COMMAND] == 1


@pytest.mark.parametrize("delay", [0, 3, 11])
def test_an_echo_that_lags_commands_behind_is_no_fault(delay):
    """A gateway of 50 ms each way, a command every tick: the newest echo is never the last sent."""
    cal = rig.calibration(predict_steps=delay, acknowledge_ticks=delay + 3)
    bench = rig.Bench(cal, delay=delay).active()
    bench.run(5.0, rig.lane_change)
    assert bench.commands > 400
    assert bench.ecu.fault_latched == 0


def test_an_echo_while_nothing_is_held_acknowledges_nothing():
    bench = rig.Bench(rig.calibration(**RULE)).active()
    bench.run(0.2)
    bench.change["ActuatorState"] = {"CommandHeld": 0}
    bench.step()
    while bench.ecu.triggered == NOTHING:
        bench.step()
    bench.run(0.03)
    assert bench.ecu.waiting == 1


def test_without_protection_there_is_no_counter_to_wait_for():
    cal = rig.calibration(**RULE, e2e=0)
    ecu = rig.started(cal)
    sender = rig.Sender()
    counters = set()
    for k in range(200):
        for name, values in (
            ("Imu", {"RollRate": 0.0, "LateralAcceleration": 0.0, "YawRate": 0.0}),
            ("ActuatorState", rig.ACTUATOR_OK | {"AcceptedCounter": 3}),
            (
                "VehicleMotion",
                {
                    "VehicleSpeed": 50.0,
                    "SteeringWheelAngle": 0.0,
                    "LongitudinalAcceleration": 0.0,
                },
            ),
        ):
            rig.deliver(ecu, name, sender.frame(name, **values))
        rig.loop.tick(ecu, cal, 1)
        assert ecu.waiting == 0
        if ecu.tx_pending[0]:
            counters.add(tuple(ecu.tx_payload[0][:2]))
            ecu.tx_pending[0] = 0
        if k > 10:
            assert ecu.triggered != TRIGGERED
    assert counters == {(0, 0)}
    assert ecu.fault_latched == 0


def test_commands_carry_a_counter_that_advances_with_every_frame():
    bench = rig.Bench(rig.calibration(**RULE))
    counters = []
    for _ in range(300):
        bench.step(rig.lane_change)
        if 0 in bench.frames:
            counters.append(bench.frames[0]["Counter"])
    assert counters == [k % 15 for k in range(len(counters))]


def test_the_ring_holds_what_the_actuators_can_give():
    cal = rig.calibration(force_max=[200 << 14] * 4, share_slack=0)
    bench = rig.Bench(cal).active()
    bench.run(0.8, rig.lane_change)
    ecu = bench.ecu
    most = 4 * 200 * 0.819
    assert abs(ecu.outputs[0]) / 2**14 > 1.2 * most
    assert abs(ecu.ring[ecu.ring_head]) / 2**14 == pytest.approx(most, rel=1e-3)


@pytest.mark.parametrize(("predicted", "elapsed", "moved"), [(8, 4, 4), (3, 4, 3), (0, 4, 1)])
def test_missed_ticks_fill_what_the_prediction_reads_of_the_ring(predicted, elapsed, moved):
    bench = rig.Bench(rig.calibration(**RULE, predict_steps=predicted)).active()
    bench.run(0.3, rig.lane_change)
    head = bench.ecu.ring_head
    bench.step(3.0, elapsed=elapsed)
    assert (bench.ecu.ring_head - head) % 32 == moved
    assert len({bench.ecu.ring[(head + k) % 32] for k in range(1, moved + 1)}) == 1


def test_dampers_are_never_held():
    cal = rig.calibration(**RULE, actuator=fw.DAMPERS)
    cal.timeout_ticks[2] = 5
    ecu = rig.started(cal)
    ecu.mode = SAFE
    for _ in range(20):
        rig.loop.tick(ecu, cal, 1)
        assert ecu.tx_pending[2] == 1
        ecu.tx_pending[2] = 0
