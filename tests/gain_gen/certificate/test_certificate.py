"""What a certificate proves, held against floating point, the firmware and simulation."""

import copy
import math
from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("flint")

from flint import fmpq
from scipy.linalg import expm

from canroll.errors import CanrollError
from gain_gen.analysis.family import family_of
from gain_gen.analysis.sampled_loop import spectral_radius
from gain_gen.calibration.dequantise import dequantise
from gain_gen.calibration.rounding_error import integer_loop
from gain_gen.certificate import checker
from gain_gen.certificate.certificate import (
    EVERY_TICK,
    INTEGERS,
    certify,
    condition_of,
    resolutions,
)
from gain_gen.certificate.claim import prove, texts, uncertain
from gain_gen.certificate.delay_sequence import simulate
from gain_gen.margin_report import task_of

LAWS = ("steering_lead", "lqr", "hinf_delay")
"""A compensator, a state feedback with prediction, an output feedback."""


def parts(calibration):
    """Return the task, the nominal member of the family and the integers."""
    task = task_of(calibration)
    member = family_of(task).members[0]
    return task, member, {name: getattr(calibration.record, name) for name in INTEGERS}


def bounds(task, member):
    return (task.delay.least - member.filtered, task.delay.most - member.filtered)


@pytest.fixture(scope="module", params=LAWS)
def proved(request, calibrated):
    """Calibration and proved claim of the nominal condition."""
    calibration = calibrated(request.param)
    task, member, integers = parts(calibration)
    claim = prove(
        integers,
        condition_of(member, calibration.record),
        name=EVERY_TICK,
        delay=bounds(task, member),
        resolution=resolutions(task.vehicle, calibration.record),
        trigger=False,
    )
    assert claim is not None
    return calibration, claim


@pytest.mark.parametrize(
    ("law", "predicted"), [("steering_lead", 0), ("hinf_delay", 0), ("lqr", 0), ("lqr", 3)]
)
def test_the_loop_of_the_integers_is_that_of_the_margins(law, predicted, calibrated):
    calibration = copy.deepcopy(calibrated(law))
    calibration.record.predict_steps = predicted
    calibration.record.actuator_rate = 1 << 28
    task, member, integers = parts(calibration)
    condition = condition_of(member, calibration.record)
    for delay in (task.delay.least, 0.013, task.delay.most):
        claim = {
            "delay": texts(np.array([delay - member.filtered] * 2)),
            "resolution": ["0"] * 5,
            "trigger": False,
            "channels": [],
        }
        sampled = checker.Sampled(integers, condition, claim, fmpq(1, 100))
        _, loop = uncertain(integers, condition, claim, sampled)
        expected = spectral_radius(member.loop(dequantise(calibration.record), delay))
        assert loop.radius == pytest.approx(expected, abs=1e-9)


def test_random_delays_decay_at_least_as_proved(proved):
    calibration, claim = proved
    task, member, _ = parts(calibration)
    rate = math.sqrt(Fraction(claim["decay"]))
    least, most = bounds(task, member)
    ticks = 600
    for seed in range(5):
        draw = np.random.default_rng(seed)
        effect = draw.uniform(least, most, ticks) + task.tick * np.arange(ticks)
        delays = np.maximum.accumulate(effect) - task.tick * np.arange(ticks)
        angles = simulate(member, dequantise(calibration.record), delays, roll=0.01, ticks=ticks)
        early, late = np.abs(angles[100:200]).max(), np.abs(angles[500:]).max()
        assert late <= 2.0 * early * rate**350 + 1e-15


def test_the_integer_code_stays_within_the_proved_bounds(proved):
    """The firmware's own stages on the car, with the resolutions of the bus and random delays."""
    calibration, claim = proved
    task, member, _ = parts(calibration)
    car, tick = member.plant, task.tick
    n = len(car.a)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = car.a, car.command[:, 0]
    advance = integer_loop(calibration.record)
    steps = np.array([math.radians(0.005), 0.00125, 1.0, 0.5])
    draw = np.random.default_rng(3)
    x, acting, under_way, last = np.zeros(n), 0.0, [], -math.inf
    angles, moments = [], []
    for k in range(1500):
        y = car.measured @ x
        # the adversary of the proof may round either way: a reading is off by half a step
        off = steps * np.sign(np.sin(0.05 * k)) * 0.499
        y = np.where([True, True, False, True], y + off, y)
        u = advance(y)
        moments.append(u)
        angles.append(float(member.roll @ x))
        last = max(last, k * tick + draw.uniform(*bounds(task, member)))
        under_way.append((last, round(4.0 * u) / 4.0))
        now, end = k * tick, (k + 1) * tick
        while under_way and under_way[0][0] < end:
            at, command = under_way.pop(0)
            at = max(at, now)
            x = (expm(block * (at - now)) @ np.append(x, acting))[:n]
            now, acting = at, command
        x = (expm(block * (end - now)) @ np.append(x, acting))[:n]
    roll, moment = float(Fraction(claim["roll_rad"])), float(Fraction(claim["moment_nm"]))
    assert 0.02 * roll < np.abs(angles).max() <= roll
    assert 0.02 * moment < np.abs(moments).max() <= moment
    assert math.degrees(roll) < 0.05


def test_a_gain_that_destabilises_is_not_proved(calibrated):
    calibration = calibrated("hinf_delay")
    task, member, integers = parts(calibration)
    condition = condition_of(member, calibration.record)
    given = {
        "name": EVERY_TICK,
        "delay": bounds(task, member),
        "resolution": resolutions(task.vehicle, calibration.record),
        "trigger": False,
    }
    assert prove(integers, condition, **given) is not None
    # three bits more: eight times the gain
    shifted = integers | {"output_gain_shift": integers["output_gain_shift"] - 3}
    assert prove(shifted, condition, **given) is None


def test_another_loop_is_refused(calibrated):
    calibration = calibrated("hinf_delay")
    task = task_of(calibration)
    for field, value, words in (
        ("observer", 2, "change at run time"),
        ("observer", 0, "true state"),
        ("identification", 1, "identified at run time"),
        ("actuator", 2, "no moments"),
    ):
        given = copy.deepcopy(calibration)
        setattr(given.record, field, value)
        with pytest.raises(CanrollError, match=words):
            certify(task, given)


def test_lost_commands_and_trigger_are_claims(certified):
    found = certified
    assert found.proved
    assert found.triggered
    assert found.lost >= 1
    names = {claim["name"] for c in found.content["conditions"] for claim in c["claims"]}
    assert names == {EVERY_TICK, "event trigger"} | {f"{n + 1} lost" for n in range(found.lost)}
    roll, moment = found.worst(EVERY_TICK)
    assert roll < found.worst("event trigger")[0] < 5.0
    assert moment < found.worst("event trigger")[1]
