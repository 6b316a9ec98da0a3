"""What a certificate proves, held against floating point, the firmware and simulation."""

import copy
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("flint")

from flint import fmpq
from scipy.linalg import expm
from support.certificates import integers_of

from canroll.errors import CanrollError
from canroll.extensions.certify import checker, stored_ranges, subject
from canroll.extensions.certify.certificate import (
    EVERY_TICK,
    LEVEL,
    STEERED,
    TRIGGER,
    TRIGGER_LEVEL,
    certify,
)
from canroll.extensions.certify.claim import (
    MOMENT,
    READ,
    STEERING,
    Wish,
    prove,
    prove_level,
    texts,
    uncertain,
)
from canroll.extensions.certify.coverage import shortfall
from canroll.extensions.certify.delay_sequence import simulate
from canroll.extensions.certify.disturbed import disturbances
from canroll.extensions.certify.subject import condition_of, resolutions
from canroll.firmware.schedule import schedule
from canroll.firmware.state import RX_VEHICLE_MOTION, Ecu
from canroll.gain_gen.analysis.family import family_of
from canroll.gain_gen.analysis.sampled_loop import spectral_radius
from canroll.gain_gen.calibration.dequantise import dequantise
from canroll.gain_gen.calibration.rounding_error import integer_loop
from canroll.gain_gen.laws.rate_gain import free_peak
from canroll.gain_gen.laws.roll_rate_feedback import exact_gamma, open_loop_gamma
from canroll.gain_gen.margin_report import task_of
from canroll.gain_gen.models.task import Delay

LAWS = ("steering_lead", "lqr", "hinf_delay")
"""A compensator, a state feedback with prediction, an output feedback."""


def parts(calibration):
    """Return the task, the nominal member of the family and the integers."""
    task = task_of(calibration)
    member = family_of(task).members[0]
    return task, member, integers_of(calibration)


def bounds(task, member):
    return (task.delay.least - member.filtered, task.delay.most - member.filtered)


def wish_of(calibration, task, member, name=EVERY_TICK, *trigger):
    resolution = resolutions(task.vehicle, calibration.record, task.resolution)
    return Wish(name, bounds(task, member), resolution, *trigger)


@pytest.fixture(scope="module", params=LAWS)
def proved(request, calibrated):
    """Calibration and proved claim of the nominal condition."""
    calibration = calibrated(request.param)
    task, member, integers = parts(calibration)
    claim = prove(integers, condition_of(member), wish_of(calibration, task, member))
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
    condition = condition_of(member)
    for delay in (task.delay.least, 0.013, task.delay.most):
        claim = {
            "delay": texts(np.array([delay - member.filtered] * 2)),
            "resolution": ["0"] * 5,
            "trigger": False,
            "limited": False,
            "performance": False,
            "disturbances": [],
            "channels": [
                {"generators": [["0"]], "onto": [["0"]]} for _ in range(math.ceil(delay / 0.01))
            ],
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


def withheld(record, new, sent):
    """Whether the event trigger keeps back a command, N·m: as the paper has it, and its floor."""
    floor = record.trigger_floor / 2**14
    share = record.trigger_epsilon_squared / 2**20
    return (new - sent) ** 2 <= share * sent**2 + floor**2


def driven(calibration, member, delay_of, *, ticks, roll=0.0, off=None, push=None, trigger=False):
    """Return roll angles and moments of the firmware's own stages on the car, tick by tick.

    Integrated by matrix exponentials from one command's effect to the next. ``delay_of`` gives the
    delay of a tick's command, ``off`` the error of the readings, ``push`` what else acts on the
    states; with ``trigger`` commands are withheld.
    """
    car, tick = member.plant, 1e-6 * calibration.record.tick_us
    n = len(car.a)
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n] = car.a, car.command[:, 0]
    advance = integer_loop(calibration.record)
    x = roll * member.roll / float(member.roll @ member.roll)
    acting, under_way, last, sent = 0.0, [], -math.inf, 0.0
    angles, moments = [], []
    for k in range(ticks):
        if push is not None:
            block[:n, n + 1] = push(k)
        y = car.measured @ x
        if off is not None:
            y = y + off(k)
        u = advance(y)
        moments.append(u)
        angles.append(float(member.roll @ x))
        if not (trigger and withheld(calibration.record, u, sent)):
            sent = round(4.0 * u) / 4.0
            last = max(last, k * tick + delay_of(k))
            under_way.append((last, sent))
        now, end = k * tick, (k + 1) * tick
        while under_way and under_way[0][0] < end:
            at, command = under_way.pop(0)
            at = max(at, now)
            x = (expm(block * (at - now)) @ np.append(x, [acting, 1.0]))[:n]
            now, acting = at, command
        x = (expm(block * (end - now)) @ np.append(x, [acting, 1.0]))[:n]
    return np.abs(angles), np.abs(moments)


def test_the_integer_code_stays_within_the_proved_bounds(proved):
    """The firmware's own stages on the car, with the resolutions of the bus and random delays."""
    calibration, claim = proved
    task, member, _ = parts(calibration)
    steps = np.array([math.radians(0.005), 0.00125, 0.0, 0.5])
    draw = np.random.default_rng(3)
    angles, moments = driven(
        calibration,
        member,
        lambda _: draw.uniform(*bounds(task, member)),
        ticks=1500,
        # the adversary of the proof may round either way: a reading is off by half a step
        off=lambda k: steps * np.sign(np.sin(0.05 * k)) * 0.499,
    )
    roll, moment = float(Fraction(claim["roll_rad"])), float(Fraction(claim["moment_nm"]))
    assert 0.02 * roll < angles.max() <= roll
    assert 0.02 * moment < moments.max() <= moment
    assert math.degrees(roll) < 0.05


@pytest.mark.slow
def test_withheld_commands_stay_within_the_proved_bounds(certified, calibrated):
    calibration = calibrated("hinf_delay")
    task, member, _ = parts(calibration)
    claims = certified.content["conditions"][0]["claims"]
    claim = next(claim for claim in claims if claim["name"] == TRIGGER)
    roll, moment = float(Fraction(claim["roll_rad"])), float(Fraction(claim["moment_nm"]))
    draw, ends = np.random.default_rng(5), []
    for start in (2.0, 3.0, 4.0, 5.0, 6.0, 7.0):
        angles, moments = driven(
            calibration,
            member,
            lambda _: draw.uniform(*bounds(task, member)),
            ticks=300,
            roll=start * roll,
            trigger=True,
        )
        assert angles[0] > roll
        ends.append(angles[200:].max())
        assert moments[200:].max() <= moment
    assert 0.02 * roll < max(ends) <= roll


@pytest.mark.slow
def test_one_bit_of_the_gain_decides(calibrated, monkeypatch):
    """Half as loud as a law just beyond stability is proved; that one is refused, and grows."""
    stable = copy.deepcopy(calibrated("hinf_delay"))
    gain = stable.record.output_gain
    # three times the gain are unstable, half of that is one bit of the shift
    stable.record.output_gain = [3 * gain[0] // 4, 0, 0]
    stable.record.output_gain_shift -= 1
    unstable = copy.deepcopy(stable)
    unstable.record.output_gain_shift -= 1
    task = task_of(stable)
    family = family_of(task)
    member = family.members[3]
    monkeypatch.setattr(subject, "family_of", lambda _: replace(family, members=(member,)))

    assert certify(task, stable).every_tick

    refused = certify(task, unstable)
    assert refused.unproved == (member,)
    short = shortfall(member, task, unstable, refused.delay)
    assert short.unstable
    assert 1.0 < short.sequence.radius < 1.005
    assert short.most is not None
    assert short.most < refused.delay[1]
    delays = short.sequence.delays
    for calibration, grows in ((unstable, True), (stable, False)):
        angles, _ = driven(
            calibration, member, lambda k: delays[k % len(delays)], ticks=400, roll=0.01
        )
        growth = (angles[300:].max() / angles[100:200].max()) ** (1.0 / 200.0)
        assert (growth > 1.0) == grows
        if grows:
            assert growth == pytest.approx(short.sequence.radius, rel=2e-4)


def test_a_gain_that_destabilises_is_not_proved(calibrated):
    calibration = calibrated("hinf_delay")
    task, member, integers = parts(calibration)
    condition = condition_of(member)
    wish = wish_of(calibration, task, member)
    assert prove(integers, condition, wish) is not None
    # three bits more: eight times the gain
    shifted = integers | {"output_gain_shift": integers["output_gain_shift"] - 3}
    assert prove(shifted, condition, wish) is None


def test_a_single_delay_without_a_proof_is_an_answer(calibrated):
    """The delay varies within one tick: there are no multipliers to balance."""
    calibration = calibrated("hinf_delay")
    task, _, integers = parts(calibration)
    condition = condition_of(family_of(task).members[3])
    loud = integers | {"output_gain_shift": integers["output_gain_shift"] - 2}
    resolution = resolutions(task.vehicle, calibration.record, task.resolution)
    assert prove(loud, condition, Wish(EVERY_TICK, (0.0024, 0.0024), resolution)) is not None
    assert prove(loud, condition, Wish(EVERY_TICK, (0.0024, 0.0095), resolution)) is None
    assert prove_level(loud, condition, Wish(LEVEL, (0.0024, 0.0024), resolution)) is not None
    assert prove_level(loud, condition, Wish(LEVEL, (0.0024, 0.0095), resolution)) is None


def test_a_loop_without_a_gain_is_an_answer(calibrated):
    """No command depends on any delay, and none is withheld: there is nothing to balance."""
    calibration = calibrated("hinf_delay")
    task, member, integers = parts(calibration)
    condition = condition_of(member)
    silent = integers | {"output_gain": [0, 0, 0]}
    wish = wish_of(calibration, task, member)
    assert prove(silent, condition, wish) is not None
    with np.errstate(divide="raise", invalid="raise"):
        prove(silent, condition, replace(wish, name=TRIGGER, trigger=True))


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
    for condition in found.content["conditions"]:
        names = {claim["name"] for claim in condition["claims"]}
        lost = {f"{n + 1} lost" for n in range(found.lost)}
        assert {EVERY_TICK, TRIGGER, STEERED} | lost <= names
    roll, moment = found.worst(EVERY_TICK)
    assert roll < found.worst("event trigger")[0] < 5.0
    assert moment < found.worst("event trigger")[1]


def test_the_levels_are_near_those_of_the_design(certified, calibrated):
    """Against the solver's level of the design, and the exact level of a constant delay."""
    calibration = calibrated("hinf_delay")
    designed = calibration.tables["margins"]["certified_peak_ratio"]
    assert designed < certified.levels[LEVEL] < 1.1 * designed
    assert certified.levels[LEVEL] <= certified.levels[TRIGGER_LEVEL]

    model, record = calibration.vehicle.design, calibration.record
    gain = record.output_gain[0] * 2.0 ** (13 - record.output_gain_shift)
    for name, delay in (
        ("level without delay", 0.0),
        # a command acts until the next one
        ("level with delay", task_of(calibration).delay.most + calibration.tick),
    ):
        exact = exact_gamma(model, gain, delay)
        assert exact < certified.levels[name] < 1.13 * exact
    assert (
        certified.levels["level with delay"]
        < certified.levels["level with delay and event trigger"]
        < open_loop_gamma(model)
    )


@pytest.mark.parametrize("trigger", [False, True])
def test_the_level_of_a_state_feedback_holds_behind_a_gateway(calibrated, trigger):
    """The firmware's own stages on the car under sines of the roll moment, from rest."""
    calibration = calibrated("lqr", Delay(0.0331, 0.0160, 0.0502))
    task, member, integers = parts(calibration)
    wish = wish_of(calibration, task, member, LEVEL, trigger)
    claim = prove_level(integers, condition_of(member), wish)
    assert claim is not None
    level = math.sqrt(Fraction(claim["weights"][-1]))
    assert level < (1.15 if trigger else 0.82) * free_peak(member)

    draw, gains = np.random.default_rng(7), []
    for hertz in (0.2, 1.0, 1.5, 2.0):
        moments = 2000.0 * np.sin(2.0 * np.pi * hertz * 0.01 * np.arange(500))
        angles, _ = driven(
            calibration,
            member,
            lambda _: draw.uniform(*bounds(task, member)),
            ticks=len(moments),
            push=lambda k, moments=moments: member.plant.disturbance[:, MOMENT] * moments[k],
            trigger=trigger,
        )
        gains.append(np.linalg.norm(angles) / np.linalg.norm(moments))
    assert 0.5 * level < max(gains) <= level


def test_what_claims_let_be_stored_is_within_the_ranges_of_the_proof_of_the_code(monkeypatch):
    assert {"x", "ahead", "compensator_x", "moment"} <= set(stored_ranges.within_ranges())
    monkeypatch.setattr(checker, "LIMIT", 1 << 31)
    with pytest.raises(ValueError, match="leave the range of"):
        stored_ranges.within_ranges()


@pytest.mark.slow
def test_of_a_drawn_car_stability_is_certified(calibrated, monkeypatch):
    calibration = calibrated("hinf_delay")
    task = task_of(calibration)

    def drawn(family, _):
        member = family.members[0]
        other = replace(family.members[1], condition=replace(member.condition, draw=1))
        return replace(family, members=(member, other))

    monkeypatch.setattr(subject, "with_draws", drawn)
    found = certify(task, calibration)
    assert found.proved
    assert (found.draws, found.conditions) == (1, 1)
    own, other = found.content["conditions"]
    assert [claim["name"] for claim in other["claims"]] == [EVERY_TICK]
    assert other["name"].startswith("draw 1 of the fit")
    assert {EVERY_TICK, TRIGGER, STEERED} <= {claim["name"] for claim in own["claims"]}


def test_the_ecu_reads_no_more_of_the_steering_than_its_bound(calibrated):
    """By the schedule of the calibration, which has 1.3 % more at 40 km/h than the car at it."""
    calibration = calibrated("hinf_delay")
    task, ecu = task_of(calibration), Ecu()
    ecu.fresh[RX_VEHICLE_MOTION] = 1
    for member in family_of(task).members:
        bound = disturbances(member, task, calibration.record, 4.0)
        wheel = bound[STEERING] * task.vehicle.steering.ratio + 0.5 * task.resolution.steering
        ecu.speed = round(member.condition.speed * 2**20)
        ecu.steering = math.ceil(wheel * 2**24)
        schedule(ecu, calibration.record)
        read = abs(ecu.steering_acceleration)
        assert read <= bound[READ] <= 1.00001 * read + 100


@pytest.mark.slow
def test_the_roll_model_alone_is_a_condition_beside_the_model_of_the_papers(
    calibrated, monkeypatch
):
    """Of a data sheet without a linear car; both once had one name, which the checker refuses."""

    def no_car(*_, **__):
        raise CanrollError("no car")

    calibration = calibrated("hinf_delay")
    monkeypatch.setattr("canroll.gain_gen.analysis.family.family", no_car)
    content = certify(task_of(calibration), calibration).content
    claims = list(checker.check(content, integers_of(calibration)))[1:]
    assert claims[0].startswith("proved: 1-DOF roll model, 80 km/h: every tick: ")
    assert claims[-1].startswith("proved: 1-DOF roll model: level")


def test_forces_for_other_tracks_are_refused(calibrated):
    calibration = copy.deepcopy(calibrated("hinf_delay"))
    calibration.record.actuator = 0
    task = task_of(calibration)
    assert subject.subject(task, calibration)
    geometry = replace(task.vehicle.geometry, half_track_rear=0.9)
    wider = replace(task, vehicle=replace(task.vehicle, geometry=geometry))
    with pytest.raises(
        CanrollError, match="its forces are for other tracks than those of van_real"
    ):
        subject.subject(wider, calibration)


def test_steering_drives_no_stored_value_beyond_its_limit(certified, calibrated):
    """The firmware's own stages on the car under the worst square waves of the steering."""
    calibration = calibrated("hinf_delay")
    task, member, _ = parts(calibration)
    condition = certified.content["conditions"][0]
    claim = next(claim for claim in condition["claims"] if claim["name"] == STEERED)
    most = {each["input"]: float(Fraction(each["most"])) for each in condition["driven"]}
    roll, moment = float(Fraction(claim["roll_rad"])), float(Fraction(claim["moment_nm"]))
    assert certified.steered >= 1.0
    car = member.plant
    push = car.disturbance[:, 0] * most[0] + car.steering[:, 0] * most[1]
    for half in (30, 50, 100):
        angles, moments = driven(
            calibration,
            member,
            lambda _: task.delay.most - member.filtered,
            ticks=400,
            push=lambda k, half=half: push * (-1) ** (k // half),
        )
        assert 0.1 * roll < angles.max() <= roll
        assert 0.1 * moment < moments.max() <= moment
