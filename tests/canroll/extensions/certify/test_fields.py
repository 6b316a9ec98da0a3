"""Every field of the calibration is read by the checker, or has a reason why it need not be."""

import copy
import random

import numpy as np
import pytest

pytest.importorskip("flint")

from flint import fmpq

from canroll.codegen.run.memory_image import sealed
from canroll.extensions.certify import checker
from canroll.extensions.certify.certificate import EVERY_TICK, TRIGGER, state
from canroll.extensions.certify.claim import Wish, prove
from canroll.extensions.certify.subject import INTEGERS, condition_of, subject
from canroll.firmware.calibration import Q_ACCELERATION, Q_MOMENT, Q_RATE, STATE_MAX, Calibration
from canroll.firmware.control_law import control
from canroll.firmware.ecu import init
from canroll.firmware.observer import look_ahead, observe
from canroll.firmware.schedule import schedule
from canroll.firmware.state import ACTIVE, RX_ACTUATOR_STATE, RX_IMU, RX_VEHICLE_MOTION, Ecu
from canroll.firmware.subset import fields
from canroll.gain_gen.margin_report import task_of

REASONS = {
    "what it is called, and its own sum": ("layout", "version", "id", "crc"),
    "of observers and models that are refused": (
        *("covariance_gain_shift", "covariance_phi", "covariance_output", "process_noise"),
        *("measurement_noise", "covariance_start", "covariance_max", "rls_decimation"),
        *("rls_forgetting", "rls_washout", "rls_gate", "rls_trace_max", "rls_start", "rls_lo"),
        *("rls_hi", "rls_moment", "rls_lateral", "rls_inertia", "rls_stiffness", "rls_damping"),
        *("model_stiffness", "model_damping", "model_scale"),
    ),
    "of actuators that are refused": (
        *("damper_speed", "damper_force", "damper_slope", "current_max"),
    ),
    "assumed: every tick has a new sample of each sensor, and the loop is active": (
        *("e2e", "e2e_max_delta", "e2e_max_repeated", "e2e_sync", "init_ticks", "recovery_ticks"),
        *("ramp_ticks", "release_ticks", "stuck_ticks", "correction_single"),
        "correction_single_shift",
    ),
    "assumed: the estimates of offsets stand still": (
        *("offset_learning", "offset_shift", "straight_steering", "straight_yaw_rate"),
        *("offset_gain", "offset_rate_max", "offset_acceleration_max"),
    ),
    "assumed: no limit of slew, corner or estimate acts": (
        *("slew_max", "force_max", "bar_max", "share_slack", "bias_max"),
        *("roll_rate_max", "acceleration_max", "acceleration_change", "acceleration_noise"),
        *("envelope_moment", "envelope_slew", "envelope_age", "envelope_outward"),
        *("envelope_lateral", "envelope_ticks", "envelope_pass"),
    ),
    "what is sent besides is in force already": (
        *("heartbeat_ticks", "acknowledge_ticks", "status_ticks"),
    ),
    "the reading of the steering is an input with a bound, which --check compares": (
        *("schedule_steering", "steering_limit"),
    ),
    "the split leaves the moment as it is; canroll certify refuses arms of other tracks": (
        *("schedule_front_share", "arm_front", "arm_rear", "track_front", "track_rear"),
    ),
    "faults are not covered: monitors act on nothing else": (
        *("redundancy_min", "redundancy_share", "redundancy_limit", "opposite_min", "slide_max"),
        *("redundancy_pass", "erratic_kept", "response_mean"),
        *("apart_samples", "bound_samples", "mirror_limit", "mirror_min", "clock_period"),
        *("clock_limit", "clock_window", "erratic_scale", "erratic_samples", "erratic_gap"),
        *("delivery_window", "delivery_samples", "delivery_min", "delivery_share", "rolling_min"),
        *("rolling_ticks", "rolling_track", "rolling_share", "rolling_tyres", "response_min"),
        *("response_share", "response_late", "response_limit", "limit_share", "response_ticks"),
        *("response_stroke", "response_rough", "response_knee", "response_fast"),
        *("response_stretch", "response_lateral", "response_inertia", "response_pass"),
        *("response_wash", "steady_min", "steady_share", "lateral_share", "axles_ticks"),
        *("axles_min", "axles_rest", "axles_limit", "axles_stretch", "axles_damping", "axles_side"),
        *("axles_rough", "axles_rear", "axles_lateral", "axles_yaw", "heave_min", "heave_late"),
        *("heave_ticks", "heave_stretch", "speed_fall", "speed_noise"),
    ),
}
"""Fields that the checker does not read, by the reason."""
LAWS = ("hinf_delay", "lqr", "steering_lead")


class Read(dict):
    """Integers that note which of them are asked for."""

    def __init__(self, *values):
        super().__init__(*values)
        self.names = set()

    def __getitem__(self, name):
        self.names.add(name)
        return super().__getitem__(name)


def test_every_field_is_read_or_has_a_reason():
    without = [name for names in REASONS.values() for name in names]
    assert len(without) == len(set(without))
    assert not set(without) & set(INTEGERS)
    assert set(without) | set(INTEGERS) == {field.name for field in fields(Calibration)}


def test_the_checker_reads_all_fields_that_decide_the_loop(calibrated):
    read = set()
    for law in LAWS:
        calibration = calibrated(law)
        task = task_of(calibration)
        family, content = subject(task, calibration)
        integers = {name: getattr(calibration.record, name) for name in INTEGERS}
        integers["predict_steps"] = max(integers["predict_steps"], 1)
        given, condition = Read(integers), condition_of(family.members[0])
        claim = {"name": EVERY_TICK, "channels": [{"onto": [["0"]]}] * 2}
        content["conditions"][0]["claims"] = [claim]
        state(content)
        next(checker.check(content, given))
        about = claim | checker.meant(content, condition, TRIGGER, fmpq(1, 100))
        checker.Sampled(given, condition, about, fmpq(1, 100))
        if law == "hinf_delay":
            delay = tuple(map(float, (task.delay.least, 0.0099)))
            wish = Wish(TRIGGER, delay, content["resolution"], trigger=True)
            proof = prove(integers, condition, wish)
            checker.proved(given, condition, proof, fmpq(1, 100))
        read |= given.names
    assert read == set(INTEGERS)


def test_the_factor_is_that_of_the_firmware():
    """Tables that rise, fall, stand still and overlap, at their points and anywhere."""
    draw = random.Random(3)
    record, ecu = Calibration(), Ecu()
    for _ in range(3000):
        record.schedule_points = draw.randint(1, 8)
        record.schedule_speed = [draw.choice((0, draw.randrange(200 << 20))) for _ in range(8)]
        if draw.random() < 0.7:
            record.schedule_speed.sort()
        record.schedule_gain = [draw.choice((1 << 28, draw.randrange(1 << 30))) for _ in range(8)]
        record.schedule_gain[0] = draw.choice((0, 1 << 30))
        record.fade_low, record.fade_high = sorted(draw.randrange(1, 200 << 20) for _ in range(2))
        ecu.speed = draw.choice((draw.randrange(200 << 20), record.schedule_speed[-1]))
        ecu.fresh[RX_VEHICLE_MOTION] = 1
        schedule(ecu, record)
        integers = {name: getattr(record, name) for name in INTEGERS}
        assert checker.factor(integers, ecu.speed) == ecu.gain_factor


@pytest.mark.parametrize("reported", [True, False])
def test_without_a_reported_moment_the_loop_has_the_commanded_one(calibrated, reported):
    """The firmware's own stages against the checker's forms, on readings that mean nothing."""
    record = copy.deepcopy(calibrated("lqr").record)
    record.predict_steps, record.actuator_rate, record.slew_max = 2, 1 << 28, STATE_MAX
    record.moment_max = STATE_MAX
    if not reported:
        record.timeout_ticks[RX_ACTUATOR_STATE] = 0
    integers = {name: getattr(record, name) for name in INTEGERS}
    y, past = checker.variables("y", 3), checker.variables("u", 2)
    command, inner = checker.controller(integers, 1 << 28, y, past, [], cut=[])
    ecu = Ecu()
    init(ecu, sealed(record))
    ecu.mode, ecu.lateral_lost, ecu.motion_lost = ACTIVE, 0, 0
    ecu.moment_unknown = int(record.timeout_ticks[RX_ACTUATOR_STATE] == 0)
    ecu.authority = ecu.feedforward = 1 << 30
    ecu.gain_factor, ecu.fresh[RX_IMU] = 1 << 28, 7
    draw, states, sent, largest = np.random.default_rng(1), [0.0] * 5, [0.0, 0.0], 0.0
    units = 2.0**Q_RATE, 2.0**Q_ACCELERATION, 2.0**Q_MOMENT
    for _ in range(100):
        readings = [round(x) for x in draw.normal(size=3) * (0.05, 1.0, 300.0) * units]
        ecu.roll_rate, ecu.lateral_acceleration, ecu.delivered[0] = readings
        ecu.rate_good, ecu.acceleration_good = readings[:2]
        observe(ecu, record, 1)
        look_ahead(ecu, record)
        control(ecu, record, 1)
        ecu.ring_head = (ecu.ring_head + 1) & 31
        ecu.ring[ecu.ring_head] = ecu.moment
        values = {("y", i): reading for i, reading in enumerate(readings)}
        values |= {("c", i): state for i, state in enumerate(states)}
        values |= {("u", i): moment for i, moment in enumerate(sent)}

        def of(form, values=values):
            return sum(float(int(v.p) / int(v.q)) * values.get(k, 0.0) for k, v in form.items())

        moment, states = of(command), [of(form) for form in inner]
        assert moment == pytest.approx(ecu.moment, abs=0.5 * 2**Q_MOMENT)
        sent, largest = [ecu.moment, sent[0]], max(largest, abs(moment))
    assert largest > 100 * 2**Q_MOMENT
