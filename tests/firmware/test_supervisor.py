"""Modes, timeouts, plausibility, ramps, recovery and fault code, in closed loop."""

import numpy as np
import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware import plausibility as sv
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.state import (
    ACTIVE,
    DEGRADED,
    INIT,
    N_TX,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_VEHICLE_MOTION,
    SAFE,
)

ERROR = {"RollRate": 163.83, "LateralAcceleration": 40.9575, "VehicleSpeed": 655.34}


def busy(bench: rig.Bench) -> rig.Bench:
    """Active, and well into a turn: there is a moment to lose."""
    bench.active().run(0.5, lambda t: 3.0)
    assert bench.ecu.mode == ACTIVE
    assert abs(bench.ecu.moment) > 300 << 14
    return bench


def ticks_until(bench: rig.Bench, mode: int, most: int = 200, ay=3.0) -> int:
    for k in range(1, most + 1):
        bench.step(ay)
        if bench.ecu.mode == mode:
            return k
    raise AssertionError(f"mode {mode} not reached, {bench.ecu.mode} instead")


def active(bench: rig.Bench, code: int) -> bool:
    return bool(bench.ecu.fault_active >> code & 1)


def test_init_becomes_active_after_its_time_and_ramps_up():
    cal = rig.calibration()
    bench = rig.Bench(cal)
    assert bench.ecu.mode == INIT
    # the first frame only starts the E2E receivers
    assert ticks_until(bench, ACTIVE) in (cal.init_ticks + 1, cal.init_ticks + 2)
    authorities = [bench.ecu.authority]
    for _ in range(cal.ramp_ticks):
        bench.step(3.0)
        authorities.append(bench.ecu.authority)
    assert np.all(np.diff(authorities[:-1]) > 0)
    assert authorities[cal.ramp_ticks] >= (1 << 30) - cal.ramp_ticks
    assert bench.ecu.fault_latched == 0


def test_init_waits_for_a_late_node_without_a_fault_then_complains():
    cal = rig.calibration()
    bench = rig.Bench(cal, drop={"Imu"})
    for _ in range(cal.timeout_ticks[RX_IMU] + cal.init_ticks):
        bench.step()
        assert bench.ecu.fault_latched == 0
    bench.step()
    assert bench.ecu.mode == INIT
    assert active(bench, RX_IMU)
    bench.drop.clear()
    ticks_until(bench, ACTIVE)
    assert bench.ecu.fault_active == 0
    assert bench.ecu.fault_latched == 1 << RX_IMU


def test_init_sends_no_command_so_that_what_is_held_fades():
    cal = rig.calibration(event_trigger=1, trigger_floor=60 << 14)
    bench = rig.Bench(cal, drop={"Imu"})
    for _ in range(100):
        bench.step(3.0)
        assert bench.ecu.mode == INIT
        assert 0 not in bench.frames


LOST = [
    ("Imu", RX_IMU, SAFE),
    ("VehicleMotion", RX_VEHICLE_MOTION, DEGRADED),
    ("ActuatorState", RX_ACTUATOR_STATE, DEGRADED),
]


@pytest.mark.parametrize(("message", "code", "mode"), LOST)
@pytest.mark.parametrize("how", ["drop", "spoil"])
def test_a_lost_message_is_noticed_at_its_timeout(message, code, mode, how):
    bench = busy(rig.Bench(rig.calibration()))
    while message not in bench.received:
        bench.step(3.0)
    getattr(bench, how).add(message)
    assert ticks_until(bench, mode) == bench.cal.timeout_ticks[code] + 1
    assert active(bench, code)
    assert bench.ecu.fault_latched == 1 << code
    assert bench.ecu.fault_count[code] == 1
    getattr(bench, how).clear()
    back = ticks_until(bench, ACTIVE)
    assert bench.cal.recovery_ticks <= back <= bench.cal.recovery_ticks + 4
    assert not active(bench, code)
    assert bench.ecu.fault_latched == 1 << code


@pytest.mark.parametrize("message", ["Imu", "VehicleMotion", "ActuatorState"])
def test_a_message_that_repeats_one_sample_is_as_good_as_lost(message):
    bench = busy(rig.Bench(rig.calibration()))
    bench.frozen.add(message)
    mode = SAFE if message == "Imu" else DEGRADED
    assert ticks_until(bench, mode) <= bench.cal.stuck_ticks + 3
    assert active(bench, sv.FAULT_STUCK)
    assert bench.ecu.fault_latched == 1 << sv.FAULT_STUCK
    bench.frozen.clear()
    ticks_until(bench, ACTIVE)


def test_a_short_burst_of_bad_checksums_is_ridden_out():
    bench = busy(rig.Bench(rig.calibration()))
    for _ in range(10):
        bench.spoil.add("Imu")
        bench.run(0.04, lambda t: 3.0)
        bench.spoil.clear()
        bench.run(0.03, lambda t: 3.0)
    assert bench.ecu.mode == ACTIVE
    assert bench.ecu.fault_latched == 0


CODES = [
    ("Imu", "RollRate", 163.83, sv.FAULT_ROLL_RATE, SAFE),
    ("Imu", "RollRate", 163.835, sv.FAULT_ROLL_RATE, SAFE),
    ("Imu", "RollRate", 150.0, sv.FAULT_ROLL_RATE, SAFE),
    ("Imu", "LateralAcceleration", 40.9575, sv.FAULT_ACCELERATION, DEGRADED),
    ("Imu", "LateralAcceleration", -25.0, sv.FAULT_ACCELERATION, DEGRADED),
    ("VehicleMotion", "VehicleSpeed", 655.34, sv.FAULT_SPEED, DEGRADED),
    ("VehicleMotion", "SteeringWheelAngle", 3276.7, sv.FAULT_SPEED, DEGRADED),
    ("ActuatorState", "DeliveredMomentRear", 16383.0, sv.FAULT_MOMENT, DEGRADED),
]


@pytest.mark.parametrize(("message", "signal", "value", "code", "mode"), CODES)
def test_error_codes_and_implausible_values_last_their_timeout(message, signal, value, code, mode):
    bench = busy(rig.Bench(rig.calibration()))
    before = bench.ecu.moment
    bench.change[message] = {signal: value}
    numbers = {
        "Imu": RX_IMU,
        "VehicleMotion": RX_VEHICLE_MOTION,
        "ActuatorState": RX_ACTUATOR_STATE,
    }
    timeout = bench.cal.timeout_ticks[numbers[message]]
    taken = ticks_until(bench, mode)
    assert timeout + 1 <= taken <= timeout + 3
    assert active(bench, code)
    assert bench.ecu.fault_latched == 1 << code
    # up to then the bad value did no harm
    assert abs(bench.ecu.moment - before) < 100 << 14
    bench.change.clear()
    back = ticks_until(bench, ACTIVE)
    assert back >= bench.cal.recovery_ticks


def test_a_spike_reaches_neither_observer_nor_law():
    for law in (fw.STATE_FEEDBACK, fw.OUTPUT_FEEDBACK):
        peaks = []
        for spike in (False, True):
            bench = busy(rig.Bench(rig.calibration(law=law)))
            if spike:
                bench.change["Imu"] = {"RollRate": 160.0, "LateralAcceleration": 40.0}
            bench.run(0.03, lambda t: 3.0)
            bench.change.clear()
            bench.run(0.05, lambda t: 3.0)
            peaks.append(bench.ecu.moment / 2**14)
            assert bench.ecu.mode == ACTIVE
        assert abs(peaks[1] - peaks[0]) < 20.0


def test_lost_lateral_acceleration_ends_with_the_feedforward_back_after_recovery():
    bench = busy(rig.Bench(rig.calibration()))
    bench.change["Imu"] = {"LateralAcceleration": 40.9575}
    ticks_until(bench, DEGRADED)
    assert bench.ecu.lateral_lost == 1
    ramp = []
    for _ in range(bench.cal.ramp_ticks):
        ramp.append(bench.ecu.feedforward)
        bench.step(3.0)
    assert np.allclose(np.diff(ramp), -(1 << 30) / bench.cal.ramp_ticks, rtol=1e-6)
    assert bench.ecu.feedforward < 100
    bench.change.clear()
    for _ in range(bench.cal.recovery_ticks - 2):
        bench.step(3.0)
        assert (bench.ecu.mode, bench.ecu.lateral_lost) == (DEGRADED, 1)
    # meanwhile the observer sees it again
    assert bench.ecu.x[2] / 2**24 == pytest.approx(3.0, abs=0.05)
    # a glitch starts the wait anew
    bench.change["Imu"] = {"LateralAcceleration": 40.9575}
    bench.step(3.0)
    bench.change.clear()
    for _ in range(bench.cal.recovery_ticks - 2):
        bench.step(3.0)
        assert (bench.ecu.mode, bench.ecu.lateral_lost) == (DEGRADED, 1)
    bench.run(0.05, lambda t: 3.0)
    assert (bench.ecu.mode, bench.ecu.lateral_lost) == (ACTIVE, 0)
    bench.run(0.3, lambda t: 3.0)
    assert bench.ecu.feedforward == 1 << 30
    assert bench.ecu.fault_count[sv.FAULT_ACCELERATION] == 1


def test_without_the_lateral_acceleration_roll_is_still_reduced():
    """DEGRADED is worth having: roll rate alone still damps the manoeuvre."""
    peaks = {}
    for name, change in (("degraded", {"LateralAcceleration": 40.9575}), ("passive", {})):
        cal = rig.calibration(moment_max=0) if name == "passive" else rig.calibration()
        bench = rig.Bench(cal).active()
        bench.change["Imu"] = change
        bench.run(0.2)
        peak = 0.0
        for _ in range(500):
            bench.step(rig.lane_change)
            peak = max(peak, abs(bench.x[0]))
        peaks[name] = peak
    assert peaks["degraded"] < 0.9 * peaks["passive"]


def test_lost_delivered_moment_is_replaced_by_the_commanded():
    bench = busy(rig.Bench(rig.calibration()))
    bench.drop.add("ActuatorState")
    ticks_until(bench, DEGRADED)
    assert bench.ecu.moment_unknown == 1
    bench.run(3.0, rig.lane_change)
    errors = []
    for _ in range(250):
        truth = bench.x[0]
        bench.step(rig.lane_change)
        errors.append(bench.ecu.x[0] / 2**30 - truth)
    assert np.degrees(np.max(np.abs(errors))) < 0.3


def test_lost_speed_keeps_the_schedule_and_lets_the_estimate_stand_for_the_steering():
    cal = rig.calibration(schedule_steering=[round(12.0 * 2**20)] * 8)
    bench = rig.Bench(cal, steering_deg=14.3).active().run(0.5, lambda t: 3.0)
    bench.drop.add("VehicleMotion")
    ticks_until(bench, DEGRADED)
    # the turn ends, the old steering angle would not
    bench.run(4.0, lambda t: 0.0)
    assert bench.ecu.gain_factor == 1 << 28
    assert abs(bench.ecu.x[2] / 2**24) < 0.02
    assert abs(bench.ecu.moment / 2**14) < 20.0


STATUS = ("StatusFrontLeft", "StatusFrontRight", "StatusRearLeft", "StatusRearRight")


@pytest.mark.parametrize(
    ("status", "code"), [(2, sv.FAULT_CORNER_STUCK), (3, sv.FAULT_CORNER_FLOATING)]
)
@pytest.mark.parametrize("corner", range(4))
def test_one_failed_corner_degrades_and_is_not_used(corner, status, code):
    bench = busy(rig.Bench(rig.calibration()))
    bench.change["ActuatorState"] = {STATUS[corner]: status}
    bench.step(3.0)
    assert bench.ecu.mode == DEGRADED
    assert active(bench, code)
    given = abs(bench.ecu.force[corner])
    fading = []
    for _ in range(bench.cal.release_ticks):
        bench.step(3.0)
        fading.append(abs(bench.ecu.force[corner]) / given)
    assert fading == sorted(fading, reverse=True)
    assert fading[bench.cal.release_ticks // 2] == pytest.approx(0.5, abs=0.1)
    force = np.array([bench.frames[0][name] for name in rig.FORCES])
    assert force[corner] == 0
    assert np.count_nonzero(force) == 3
    moment = force @ np.array([1, -1, 1, -1]) * 0.819
    assert moment == pytest.approx(bench.ecu.moment / 2**14, abs=5.0)
    bench.change.clear()
    assert ticks_until(bench, ACTIVE) >= bench.cal.recovery_ticks


@pytest.mark.parametrize("release_ticks", [7, 20, 50])
def test_safe_fades_in_the_calibrated_time_with_the_heartbeat_kept(release_ticks):
    cal = rig.calibration(release_ticks=release_ticks, event_trigger=1, trigger_floor=60 << 14)
    bench = busy(rig.Bench(cal))
    bench.drop.add("Imu")
    ticks_until(bench, SAFE)
    start = sum(bench.ecu.held)
    sent = []
    for k in range(2, release_ticks + 40):
        bench.step(3.0)
        expected = start * max(0.0, 1 - k / release_ticks)
        assert bench.ecu.moment == pytest.approx(expected, abs=100)
        if 0 in bench.frames:
            sent.append(k)
            assert bench.frames[0]["Mode"] == SAFE
    assert bench.ecu.moment == 0
    assert max(np.diff(sent)) <= cal.heartbeat_ticks
    forces = [bench.frames[0][name] for name in rig.FORCES] if 0 in bench.frames else [0] * 4
    assert forces == [0] * 4


def test_a_fault_during_the_way_up_fades_from_what_was_given():
    cal = rig.calibration()
    bench = rig.Bench(cal)
    ticks_until(bench, ACTIVE)
    for _ in range(cal.ramp_ticks // 2):
        bench.step(3.0)
    given = bench.ecu.moment
    assert given != 0
    bench.change["ActuatorState"] = {"StatusFrontLeft": 2, "StatusRearLeft": 2}
    bench.step(3.0)
    assert bench.ecu.mode == SAFE
    assert bench.ecu.moment == pytest.approx(given * (1 - 1 / cal.release_ticks), rel=1e-3)


def test_recovery_waits_and_ramps_without_a_jump():
    bench = busy(rig.Bench(rig.calibration()))
    bench.drop.add("Imu")
    bench.run(0.5, lambda t: 3.0)
    assert (bench.ecu.mode, bench.ecu.moment) == (SAFE, 0)
    bench.drop.clear()
    # flapping inputs keep it safe
    for _ in range(5):
        bench.run(0.3, lambda t: 3.0)
        bench.drop.add("Imu")
        bench.run(0.1, lambda t: 3.0)
        bench.drop.clear()
        assert bench.ecu.mode == SAFE
    assert bench.ecu.fault_count[RX_IMU] == 6
    ticks_until(bench, ACTIVE)
    moments = [bench.ecu.moment]
    for _ in range(40):
        bench.step(3.0)
        moments.append(bench.ecu.moment)
    assert np.max(np.abs(np.diff(moments))) < 0.12 * abs(moments[-1])


def test_fault_codes_are_latched_counted_and_shown_on_the_bus():
    bench = busy(rig.Bench(rig.calibration(status_ticks=1)))
    for _ in range(3):
        bench.change["Imu"] = {"LateralAcceleration": 40.9575}
        bench.run(0.2, lambda t: 3.0)
        bench.change.clear()
        bench.run(0.2, lambda t: 3.0)
    bench.change["Imu"] = {"LateralAcceleration": 40.9575}
    bench.run(0.2, lambda t: 3.0)
    assert bench.ecu.fault_count[sv.FAULT_ACCELERATION] == 4
    pages, status = {}, {}
    for _ in range(7):
        bench.step(3.0)
        pages[bench.frames[5]["Page"]] = bench.frames[5]
        status = bench.frames[4]
    assert sorted(pages) == [0, 1, 2, 3, 4, 5, 6]
    assert pages[0]["ActiveFaultCodes"] == 1 << sv.FAULT_ACCELERATION
    assert pages[1]["LatchedFaultCodes"] == 1 << sv.FAULT_ACCELERATION
    assert pages[3]["Occurrences07"] == 4
    assert status["Mode"] == DEGRADED
    assert status["FaultCodeCount"] == 1
    assert status["MomentCommand"] == pytest.approx(bench.ecu.moment / 2**14, abs=0.26)
    assert status["RollAngleEstimate"] == pytest.approx(
        np.degrees(bench.ecu.x[0] / 2**30), abs=2e-3
    )
    assert status["CommandsSent"] == bench.ecu.commands_sent & 255


def test_occurrences_saturate():
    ecu = rig.started(rig.calibration())
    for found in 300 * [1 << 9, 0]:
        ecu.detected = found
        sv.latch_faults(ecu)
    assert ecu.fault_count[9] == 255
    assert ecu.fault_number == 0
    assert ecu.fault_latched == 1 << 9


def test_missed_ticks_age_the_inputs_and_are_counted():
    bench = busy(rig.Bench(rig.calibration()))
    bench.step(3.0, elapsed=3)
    assert bench.ecu.mode == ACTIVE
    assert bench.ecu.fault_count[sv.FAULT_TICK_MISSED] == 1
    bench.step(3.0)
    assert not active(bench, sv.FAULT_TICK_MISSED)
    bench.drop.add("Imu")
    bench.step(3.0, elapsed=3)
    assert bench.ecu.mode == ACTIVE
    bench.step(3.0, elapsed=3)
    assert bench.ecu.mode == SAFE
    # however long the loop slept, the sleep counts
    asleep = busy(rig.Bench(rig.calibration()))
    asleep.drop |= {"Imu", "ActuatorState", "VehicleMotion"}
    asleep.step(0.0, elapsed=5000)
    assert asleep.ecu.age[RX_IMU] == 5000
    assert asleep.ecu.mode == SAFE


def test_time_wraps():
    bench = rig.Bench(rig.calibration())
    bench.ecu.time = 2**31 - 2
    bench.step()
    bench.step(elapsed=2)
    assert bench.ecu.time == -(2**31) + 1


REFUSED = [
    ({"tick_us": 500}, 31),
    ({"law": 3}, 3),
    ({"schedule_points": 2, "schedule_speed": [5, 5, 0, 0, 0, 0, 0, 0]}, 501),
    ({"fade_low": 5 << 20, "fade_high": 5 << 20}, 502),
    ({"rls_lo": [1 << 28, 1 << 27], "rls_hi": [1 << 27, 1 << 28]}, 503),
    ({"actuator": fw.VALVES}, 504),
    ({"actuator": fw.BARS, "compensator_outputs": 2}, 505),
    (
        {"law": fw.COMPENSATOR, "compensator_outputs": 2}
        | {"compensator_shift": [1] * 8, "compensator_output_shift": [1] * 2},
        505,
    ),
    ({"timeout_ticks": [0, 10, 0, 5, 0]}, 506),
    ({"observer": fw.BYPASS}, 507),
    ({"actuator": fw.DAMPERS}, 508),
    ({"actuator": fw.DAMPERS, "timeout_ticks": [5, 10, 5, 0, 0]}, 509),
    ({"timeout_ticks": [5, 0, 0, 5, 0]}, 510),
]


@pytest.mark.parametrize(("change", "rule"), REFUSED)
def test_a_refused_calibration_never_runs(change, rule):
    good, bad = rig.sealed(rig.calibration()), rig.sealed(rig.calibration(**change))
    bench = busy(rig.Bench(good))
    assert loop.init(bench.ecu, bad) == rule
    bench.cal = bad
    assert bench.ecu.mode == SAFE
    assert bench.ecu.fault_active == 1 << sv.FAULT_CALIBRATION
    before = {name: str(getattr(bench.ecu, name)) for name in ("x", "moment", "age", "time")}
    for _ in range(50):
        bench.step(3.0)
        assert bench.frames == {}
    assert before == {name: str(getattr(bench.ecu, name)) for name in before}
    assert loop.init(bench.ecu, good) == 0
    bench.cal = good
    ticks_until(bench, ACTIVE)


def test_without_control_frames_flow_and_no_fault_is_raised():
    bench = rig.Bench(rig.calibration(), change={"ActuatorState": {"Enabled": 0}}).active()
    bench.run(2.0, rig.lane_change)
    assert bench.ecu.fault_latched == 0
    assert bench.ecu.enabled == 0


def test_foreign_short_and_misplaced_frames_are_harmless():
    bench = busy(rig.Bench(rig.calibration()))
    for message in (-1, fw.N_RX + N_TX, 1000):
        loop.receive(bench.ecu, message, [255] * 8, 8)
    before = bench.ecu.roll_rate
    loop.receive(bench.ecu, RX_IMU, [255] * 8, 3)
    loop.tick(bench.ecu, bench.cal, 1)
    assert bench.ecu.roll_rate == before
    assert bench.ecu.fresh[RX_IMU] == 0


def test_a_short_frame_does_not_displace_a_good_one():
    bench = busy(rig.Bench(rig.calibration()))
    good = bench.sender.frame("Imu", **bench.inputs(3.0)["Imu"])
    rig.deliver(bench.ecu, "Imu", good)
    loop.receive(bench.ecu, RX_IMU, [255] * 8, 7)
    loop.tick(bench.ecu, bench.cal, 1)
    assert bench.ecu.fresh[RX_IMU] == RX_SIGNALS[RX_IMU]


def test_a_slow_message_is_not_stuck_between_its_frames():
    """Ticks of 1 ms: VehicleMotion brings a sample every twentieth."""
    bench = rig.Bench(rig.calibration(tick=0.001, stuck_ticks=5))
    bench.run(0.5)
    assert bench.ecu.mode == ACTIVE
    assert bench.ecu.fault_latched == 0
