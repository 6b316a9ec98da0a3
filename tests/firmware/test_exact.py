"""Each formula of the loop in rational arithmetic: the firmware is its nearest integer.

What the float64 tests leave within their tolerance, a bias of one unit in the last place say, is
told here. Values are random but far from the limits; the limits have tests of their own.
"""

import random
from fractions import Fraction

import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import control_law
from canroll.firmware.allocation import allocate
from canroll.firmware.com.signals import RX_SIGNALS
from canroll.firmware.covariance import propagate, update
from canroll.firmware.identification import identify, learn
from canroll.firmware.observer import look_ahead, observe
from canroll.firmware.schedule import schedule
from canroll.firmware.state import ACTIVE, RX_IMU, RX_VEHICLE_MOTION

N = 5
SEEDS = pytest.mark.parametrize("seed", range(12))


def nearest(value: Fraction) -> int:
    """Rounded to nearest, halves upwards."""
    return (value + Fraction(1, 2)).__floor__()


def dot(row, values) -> Fraction:
    return sum((Fraction(a) * b for a, b in zip(row, values, strict=True)), Fraction(0))


def small(rng: random.Random, n: int, bits: int) -> list[int]:
    return [rng.randint(-(1 << bits), 1 << bits) for _ in range(n)]


def started(rng: random.Random, **changes):
    """An ECU with a random estimate, in control with everything it needs."""
    cal = rig.calibration(**changes)
    ecu = rig.started(cal)
    ecu.mode, ecu.authority, ecu.gain_factor = ACTIVE, 1 << 30, 1 << 28
    ecu.motion_lost = ecu.moment_unknown = 0
    ecu.x, ecu.ahead = small(rng, N, 24), small(rng, N, 24)
    ecu.delivered = small(rng, 2, 24)
    ecu.steering_acceleration = rng.randint(-(1 << 24), 1 << 24)
    return ecu, cal


def advanced(ecu, cal, state, moment: int) -> list[int]:
    """One tick of the model from ``state``, the identified rows from the ECU."""
    new = []
    for i in range(N):
        row = [*ecu.model[i][:3], *cal.phi[i][3:]] if i < 2 else cal.phi[i]
        gamma = ecu.model[i][3] if i < 2 else cal.gamma[i]
        total = dot(
            [*row, gamma, cal.gamma_steering[i]], [*state, moment, ecu.steering_acceleration]
        )
        new.append(nearest(total / 2 ** cal.phi_shift[i]))
    return new


def coarse_model(rng: random.Random, cal) -> None:
    """Small coefficients and shifts, so that one unit more anywhere is seen."""
    cal.phi, cal.gamma, cal.gamma_steering = (
        [small(rng, N, 4) for _ in range(N)],
        *(small(rng, N, 3) for _ in range(2)),
    )
    cal.phi_shift = [rng.randint(1, 3) for _ in range(N)]
    cal.output = [small(rng, N, 3) for _ in range(3)]
    cal.output_moment, cal.output_shift = small(rng, 3, 3), [rng.randint(1, 3) for _ in range(3)]
    cal.correction = [small(rng, N, 3) for _ in range(3)]
    cal.correction_shift = [[rng.randint(1, 4) for _ in range(N)] for _ in range(3)]
    cal.bias_max = fw.STATE_MAX


@SEEDS
def test_the_observer_is_its_model_and_its_corrections(seed):
    rng = random.Random(seed)
    cal = rig.calibration()
    coarse_model(rng, cal)
    ecu = rig.started(cal)
    ecu.x, ecu.delivered, ecu.moment_unknown = small(rng, N, 14), small(rng, 2, 14), 0
    ecu.steering_acceleration = rng.randint(-(1 << 14), 1 << 14)
    ecu.motion_lost = 0
    ecu.roll_rate, ecu.offset_rate = small(rng, 2, 14)
    ecu.lateral_acceleration, ecu.offset_acceleration = small(rng, 2, 14)
    ecu.fresh[RX_IMU] = RX_SIGNALS[RX_IMU]
    moment = sum(ecu.delivered)
    # two ticks: the change of one of them twice
    x = [2 * after - x for x, after in zip(ecu.x, advanced(ecu, cal, ecu.x, moment), strict=True)]
    measured = (
        ecu.roll_rate - ecu.offset_rate,
        ecu.lateral_acceleration - ecu.offset_acceleration,
    )
    for m, y in enumerate(measured):
        told = dot([*cal.output[m], cal.output_moment[m]], [*x, moment]) / 2 ** cal.output_shift[m]
        innovation = y - nearest(told)
        gains = zip(cal.correction[m], cal.correction_shift[m], strict=True)
        x = [
            before + nearest(Fraction(gain * innovation, 2**shift))
            for before, (gain, shift) in zip(x, gains, strict=True)
        ]
    observe(ecu, cal, 2)
    assert ecu.x == x


@SEEDS
def test_the_prediction_walks_through_the_commands_under_way(seed):
    rng = random.Random(100 + seed)
    ecu, cal = started(rng, predict_steps=rng.choice((1, 2, 5, 32)))
    coarse_model(rng, cal)
    cal.phi = [[4 if i == j else rng.randint(0, 1) for j in range(N)] for i in range(N)]
    cal.phi_shift = [3] * N
    ecu.model = [[*cal.phi[i][:3], cal.gamma[i]] for i in range(2)]
    cal.actuator_rate = rng.randint(1 << 28, 1 << 30)
    ecu.ring, ecu.ring_head = small(rng, 32, 20), rng.randrange(32)
    state, moment = list(ecu.x), sum(ecu.delivered)
    for k in range(cal.predict_steps - 1, -1, -1):
        command = ecu.ring[(ecu.ring_head - k) % 32]
        reached = moment + nearest(Fraction(cal.actuator_rate * (command - moment), 1 << 30))
        state = advanced(ecu, cal, state, nearest(Fraction(moment + reached, 2)))
        moment = reached
    look_ahead(ecu, cal)
    assert ecu.ahead == state


@SEEDS
def test_state_feedback_is_the_weighted_estimate(seed):
    rng = random.Random(200 + seed)
    ecu, cal = started(rng, moment_max=fw.STATE_MAX, slew_max=fw.STATE_MAX)
    cal.feedback, cal.feedforward = small(rng, N, 3), small(rng, N, 3)
    cal.feedback_shift, cal.feedforward_shift = rng.randint(1, 4), rng.randint(1, 4)
    ecu.feedforward = rng.randint(0, 1 << 30)
    back = nearest(dot(cal.feedback, ecu.ahead) / 2**cal.feedback_shift)
    fed = nearest(dot(cal.feedforward, ecu.ahead) / 2**cal.feedforward_shift)
    forward = nearest(Fraction(fed * ecu.feedforward, 1 << 30))
    control_law.control(ecu, cal, 1)
    assert ecu.moment == ecu.outputs[0] == -back - forward


@SEEDS
def test_output_feedback_is_the_weighted_measurements(seed):
    rng = random.Random(300 + seed)
    ecu, cal = started(rng, law=fw.OUTPUT_FEEDBACK, moment_max=fw.STATE_MAX, slew_max=fw.STATE_MAX)
    cal.output_gain, cal.output_gain_shift = small(rng, 3, 3), rng.randint(1, 4)
    ecu.rate_good, ecu.offset_rate, ecu.acceleration_good, ecu.offset_acceleration = small(
        rng, 4, 24
    )
    inputs = [ecu.rate_good - ecu.offset_rate, ecu.acceleration_good - ecu.offset_acceleration]
    expected = nearest(dot(cal.output_gain, [*inputs, ecu.x[0]]) / 2**cal.output_gain_shift)
    control_law.control(ecu, cal, 1)
    assert ecu.moment == expected
    cal.observer = fw.BYPASS
    inputs = [ecu.x[1], ecu.x[2], ecu.x[0]]
    control_law.control(ecu, cal, 1)
    assert ecu.moment == nearest(dot(cal.output_gain, inputs) / 2**cal.output_gain_shift)


@SEEDS
def test_the_compensator_is_its_matrices(seed):
    rng = random.Random(400 + seed)
    order, outputs = rng.randint(0, 8), rng.randint(1, 2)
    ecu, cal = started(rng, moment_max=fw.STATE_MAX, slew_max=fw.STATE_MAX)
    cal.law, cal.actuator = fw.COMPENSATOR, fw.BARS
    cal.compensator_order, cal.compensator_outputs = order, outputs
    cal.compensator_a, cal.compensator_b = ([small(rng, n, 2) for _ in range(8)] for n in (8, 4))
    cal.compensator_c, cal.compensator_d = ([small(rng, n, 2) for _ in range(2)] for n in (8, 4))
    cal.compensator_e = [small(rng, 2, 2) for _ in range(8)]
    cal.compensator_shift = [rng.randint(3, 5) for _ in range(8)]
    cal.compensator_output_shift = [rng.randint(1, 3) for _ in range(2)]
    ecu.compensator_x = small(rng, 8, 20)
    ecu.acceleration_good, ecu.offset_acceleration = small(rng, 2, 20)
    ecu.rate_good, ecu.offset_rate = small(rng, 2, 20)
    rate = ecu.rate_good - ecu.offset_rate
    lateral = ecu.acceleration_good - ecu.offset_acceleration
    cal.steering_limit = rng.randint(0, 1 << 14)
    steered = limited(ecu.steering_acceleration, -cal.steering_limit, cal.steering_limit)
    inputs = [ecu.x[0], rate, lateral, steered]
    state = ecu.compensator_x[:order]
    given = [
        nearest(
            dot([*cal.compensator_c[k][:order], *cal.compensator_d[k]], [*state, *inputs])
            / 2 ** cal.compensator_output_shift[k]
        )
        for k in range(outputs)
    ]
    given += [0] * (2 - outputs)
    control_law.control(ecu, cal, 2)
    assert ecu.outputs == given
    assert ecu.moment == sum(given)
    state = [
        nearest(
            dot(
                [*cal.compensator_a[i][:order], *cal.compensator_b[i], *cal.compensator_e[i]],
                [*state, *inputs, *given],
            )
            / 2 ** cal.compensator_shift[i]
        )
        for i in range(order)
    ]
    assert ecu.compensator_x[:order] == state


@SEEDS
def test_schedule_authority_and_gain_scale_to_the_nearest_unit(seed):
    rng = random.Random(500 + seed)
    ecu, cal = started(rng, moment_max=fw.STATE_MAX, slew_max=fw.STATE_MAX)
    cal.feedback, cal.feedforward, cal.feedback_shift = [0, -2, 0, 0, 0], [0] * N, 1
    ecu.gain_factor, ecu.authority = rng.randint(0, 1 << 30), rng.randint(0, 1 << 30)
    wanted = ecu.ahead[1]
    scheduled = nearest(Fraction(wanted * ecu.gain_factor, 1 << 28))
    control_law.control(ecu, cal, 1)
    assert ecu.moment == nearest(Fraction(scheduled * ecu.authority, 1 << 30))


@SEEDS
def test_covariance_is_propagated_and_corrected_to_the_nearest_unit(seed):
    rng = random.Random(600 + seed)
    cal = rig.calibration(observer=fw.PROPAGATED_COVARIANCE)
    cal.covariance_max = [fw.STATE_MAX] * N
    cal.covariance_phi = [
        [(1 << 24 if i == j else 0) + rng.randint(-(1 << 20), 1 << 20) for j in range(N)]
        for i in range(N)
    ]
    cal.covariance_output = [small(rng, N, 24) for _ in range(2)]
    cal.process_noise = [rng.randint(0, 9) for _ in range(N)]
    cal.covariance_gain_shift = [[rng.randint(16, 30) for _ in range(N)] for _ in range(2)]
    ecu = rig.started(cal)
    half = [small(rng, N, 12) for _ in range(N)]
    p = [[sum(a * b for a, b in zip(r, s, strict=True)) for s in half] for r in half]
    ecu.covariance = [list(row) for row in p]
    phi, one = cal.covariance_phi, Fraction(1, 1 << 24)
    rows = [
        [nearest(dot(phi[i], [p[j][k] for j in range(N)]) * one) for k in range(N)]
        for i in range(N)
    ]
    # each row once it is done is also its column
    for i in range(N):
        done = [nearest(dot(rows[i], phi[k]) * one) for k in range(i + 1)]
        for k in range(i + 1):
            rows[i][k] = rows[k][i] = done[k]
        rows[i][i] += cal.process_noise[i]
    propagate(ecu, cal, 1)
    assert ecu.covariance == rows
    m, innovation = seed % 2, rng.randint(-(1 << 14), 1 << 14)
    ecu.x = small(rng, N, 20)
    c, x, p = cal.covariance_output[m], list(ecu.x), [list(row) for row in rows]
    work = [nearest(dot(p[i], c) * one) for i in range(N)]
    total = nearest(dot(c, work) * one) + cal.measurement_noise[m]
    gain = [int(Fraction(value << 24, total)) for value in work]
    for i in range(N):
        x[i] += nearest(Fraction(gain[i] * innovation, 2 ** cal.covariance_gain_shift[m][i]))
        for j in range(i + 1):
            p[i][j] -= nearest(gain[i] * work[j] * one)
            p[j][i] = p[i][j]
        p[i][i] = max(p[i][i], 1)
    update(ecu, cal, m, innovation)
    assert ecu.x == x
    assert ecu.covariance == p


def towards_zero(value: Fraction) -> int:
    return int(value)


def limited(value: int, lo: int, hi: int) -> int:
    return min(max(value, lo), hi)


def parts(ecu, moment: int) -> tuple[int, int]:
    front = nearest(Fraction(moment * ecu.front_share, 1 << 30))
    return front, moment - front


@SEEDS
def test_corner_forces_and_bars_are_their_shares(seed):
    rng = random.Random(700 + seed)
    ecu, cal = started(rng, force_max=[4090 << 14] * 4, bar_max=[8191 << 14] * 2)
    cal.arm_front, cal.arm_rear = rng.randint(1 << 26, 1 << 27), rng.randint(1 << 26, 1 << 27)
    ecu.front_share, ecu.moment = rng.randint(0, 1 << 30), rng.randint(-(1 << 26), 1 << 26)
    front, rear = parts(ecu, ecu.moment)
    forces = [
        nearest(Fraction(part * arm, 1 << 28))
        for part, arm in ((front, cal.arm_front), (rear, cal.arm_rear))
    ]
    allocate(ecu, cal)
    assert ecu.force == [forces[0], -forces[0], forces[1], -forces[1]]
    assert ecu.given == ecu.moment
    cal.actuator = fw.BARS
    allocate(ecu, cal)
    assert ecu.bar == [front, rear]
    assert ecu.given == ecu.moment


def damper(cal, setting: int, speed: int) -> int:
    force, knee = cal.damper_force[setting], cal.damper_speed[setting]
    if speed < knee:
        return towards_zero(Fraction(force * speed, knee))
    return force + nearest(Fraction(cal.damper_slope[setting] * (speed - knee), 1 << 27))


@SEEDS
def test_damper_currents_are_the_share_between_soft_and_firm(seed):
    """Down to forces of a few units, where soft and firm may be the same."""
    rng = random.Random(800 + seed)
    ecu, cal = started(rng, actuator=fw.DAMPERS, timeout_ticks=[5] * 5, current_max=16382 << 14)
    for _ in range(60):
        scale = rng.choice((2, 4, 1 << 12, 1 << 24))
        cal.damper_speed = [rng.randint(1, scale) for _ in range(2)]
        cal.damper_force = [rng.randint(0, scale), rng.randint(0, 2 * scale)]
        cal.damper_slope = [rng.randint(0, 1 << 27) for _ in range(2)]
        ecu.stroke_rate = [rng.randint(-2 * scale, 2 * scale) for _ in range(4)]
        ecu.failed = [rng.choice((0, 0, 0, 1)) for _ in range(4)]
        ecu.moment, ecu.front_share = rng.randint(-8 * scale, 8 * scale), rng.randint(0, 1 << 30)
        wanted = [
            nearest(Fraction(part * arm, 1 << 28))
            for part, arm in zip(parts(ecu, ecu.moment), (cal.arm_front, cal.arm_rear), strict=True)
        ]
        expected = []
        for corner in range(4):
            force = wanted[corner // 2] * (-1) ** corner * (1 + ecu.failed[corner ^ 1])
            rate = ecu.stroke_rate[corner]
            brake = force if rate < 0 else -force
            soft, firm = (damper(cal, setting, abs(rate)) for setting in (0, 1))
            share = towards_zero(Fraction((brake - soft) << 28, max(firm - soft, 1)))
            share = limited(share, 0, 1 << 28)
            expected.append(nearest(Fraction(share * cal.current_max, 1 << 28)))
        allocate(ecu, cal)
        assert ecu.current == expected


@SEEDS
def test_the_schedule_is_linear_between_its_points(seed):
    rng = random.Random(900 + seed)
    grid = sorted(rng.sample(range(1 << 24), 8))
    points = 1 + seed % 8
    ecu, cal = started(rng, schedule_points=points, schedule_speed=grid)
    cal.fade_low, cal.fade_high = 1, rng.randint(2, 1 << 24)
    cal.schedule_gain = [rng.randint(0, 1 << 30) for _ in range(8)]
    cal.schedule_front_share = [rng.randint(0, 1 << 30) for _ in range(8)]
    cal.schedule_steering = [rng.randint(-(1 << 26), 1 << 26) for _ in range(8)]
    for speed in (0, 1, 2, *cal.schedule_speed, *(rng.randint(0, 1 << 24) for _ in range(20))):
        ecu.speed, ecu.steering = speed, rng.randint(-(1 << 24), 1 << 24)
        below = max((k for k in range(points) if cal.schedule_speed[k] <= speed), default=0)
        above = min(below + 1, points - 1)
        width = max(cal.schedule_speed[above] - cal.schedule_speed[below], 1)
        gone = limited(speed - cal.schedule_speed[below], 0, width)
        share = towards_zero(Fraction(gone << 28, width))

        def at(values, below=below, above=above, share=share) -> int:
            step = Fraction((values[above] - values[below]) * share, 1 << 28)
            return values[below] + nearest(step)

        way = limited(speed - cal.fade_low, 0, cal.fade_high - cal.fade_low)
        fade = towards_zero(Fraction(way << 28, cal.fade_high - cal.fade_low))
        steering = nearest(Fraction(at(cal.schedule_steering) * ecu.steering, 1 << 20))
        ecu.fresh[RX_VEHICLE_MOTION] = RX_SIGNALS[RX_VEHICLE_MOTION]
        schedule(ecu, cal)
        assert ecu.front_share == at(cal.schedule_front_share)
        assert ecu.gain_factor == nearest(Fraction(at(cal.schedule_gain) * fade, 1 << 28))
        assert ecu.steering_acceleration == limited(steering, -(1 << 30), fw.STATE_MAX)


def learnt(ecu, cal, f: tuple[int, int], y: int) -> tuple[list[int], list[int]]:
    """Ratios and covariance after one step of recursive least squares with forgetting, Q20."""
    p0, p1, p2 = ecu.rls_covariance
    g = [nearest(dot(row, f) / 2**20) for row in ((p0, p1), (p1, p2))]
    total = max(nearest(dot(f, g) / 2**20), 0) + nearest(Fraction(cal.rls_forgetting, 1 << 10))
    k = [towards_zero(Fraction(value << 20, total)) for value in g]
    error = y - nearest(dot(ecu.theta, f) / 2**28)
    theta = [
        limited(ratio + nearest(Fraction(gain * error, 1 << 12)), lo, hi)
        for ratio, gain, lo, hi in zip(ecu.theta, k, cal.rls_lo, cal.rls_hi, strict=True)
    ]
    pairs = ((k[0], g[0]), (k[0], g[1]), (k[1], g[1]))
    taken = [nearest(Fraction(a * b, 1 << 20)) for a, b in pairs]
    p = [max(p0 - taken[0], 1), p1 - taken[1], max(p2 - taken[2], 1)]
    if p[0] + p[2] < cal.rls_trace_max:
        p = [towards_zero(Fraction(value << 30, cal.rls_forgetting)) for value in p]
    return theta, p


def teachable(rng: random.Random):
    """Settled filters, random memories; everything teaches."""
    ecu, cal = started(rng, identification=1, rls_gate=0, rls_decimation=1)
    cal.rls_lo, cal.rls_hi = [3 << 26, 1 << 26], [1 << 29, 3 << 28]
    cal.rls_forgetting = rng.randint(29 << 25, 1 << 30)
    ecu.theta = [rng.randint(1 << 27, 1 << 29) for _ in range(2)]
    p0, p1, p2 = rng.randint(1 << 20, 1 << 23), *small(rng, 1, 19), rng.randint(1 << 20, 1 << 23)
    ecu.rls_covariance = [p0, p1, p2]
    cal.rls_trace_max = (p0 + p2) // rng.choice((1, 2))
    ecu.rls_filled = 200
    return ecu, cal


@SEEDS
def test_least_squares_learn_to_the_nearest_unit(seed):
    rng = random.Random(1000 + seed)
    ecu, cal = teachable(rng)
    for _ in range(20):
        f, y = tuple(small(rng, 2, rng.choice((8, 20)))), rng.randint(-(1 << 21), 1 << 21)
        expected = learnt(ecu, cal, f, y)
        learn(ecu, cal, *f, y)
        assert (ecu.theta, ecu.rls_covariance) == expected


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("which", [0, 1])
def test_ratios_stop_at_their_own_bounds(which, sign):
    rng = random.Random(which)
    ecu, cal = teachable(rng)
    f = [0, 0]
    f[which] = 1 << 20
    for _ in range(20):
        y = sign * (1 << 23)
        expected = learnt(ecu, cal, tuple(f), y)
        learn(ecu, cal, *f, y)
        assert (ecu.theta, ecu.rls_covariance) == expected
    assert ecu.theta[which] == (cal.rls_hi if sign > 0 else cal.rls_lo)[which]


@pytest.mark.parametrize("which", [0, 1])
def test_the_largest_variance_learns_from_one_unit_and_the_least_stays(which):
    rng = random.Random(which)
    ecu, cal = teachable(rng)
    cal.rls_forgetting, cal.rls_trace_max = 1 << 30, 1
    ecu.rls_covariance = [fw.STATE_MAX, 0, fw.STATE_MAX]
    f = (1 - which, which)
    expected = learnt(ecu, cal, f, 1 << 16)
    learn(ecu, cal, *f, 1 << 16)
    assert (ecu.theta, ecu.rls_covariance) == expected
    for trace_max in (1, 1 << 25):
        cal.rls_trace_max = trace_max
        ecu.rls_covariance = [1, 0, 1]
        learn(ecu, cal, *f, 1 << 16)
        assert ecu.rls_covariance == [1, 0, 1]


@pytest.mark.parametrize("sign", [-1, 1])
def test_an_error_counts_up_to_its_limit(sign):
    """16 in Q20: a target that is far off pulls no more than one that is just beyond."""
    pulled = []
    for beyond in (-(1 << 10), 0, 1 << 10, 1 << 26):
        ecu, cal = teachable(random.Random(3))
        cal.rls_lo, cal.rls_hi = [1, 1], [fw.STATE_MAX] * 2
        ecu.theta, ecu.rls_covariance = [1 << 29, 1 << 28], [1 << 23, 0, 1 << 23]
        told = (1 << 29) * (1 << 12) >> 28
        learn(ecu, cal, 1 << 12, 0, told + sign * ((1 << 24) + beyond))
        pulled.append(ecu.theta[0])
    assert pulled[0] != pulled[1] == pulled[2] == pulled[3]


@SEEDS
def test_an_identification_step_is_its_filters_and_its_window(seed):
    rng = random.Random(1100 + seed)
    ecu, cal = teachable(rng)
    ecu.rls_index = seed % 10
    cal.rls_washout = rng.randint(1 << 29, 1 << 30)
    cal.rls_moment, cal.rls_lateral, cal.rls_inertia, cal.rls_stiffness = (
        rng.randint(1 << 26, 1 << 29) for _ in range(4)
    )
    cal.rls_damping = rng.randint(1 << 18, 1 << 21)
    ecu.rate_good, ecu.acceleration_good = small(rng, 2, 20)
    ecu.rls_last, ecu.rls_washed = small(rng, 2, 20), small(rng, 5, 20)
    ecu.rls_history, ecu.rls_integrals = [small(rng, 10, 18) for _ in range(2)], small(rng, 2, 20)
    ecu.delivered = small(rng, 2, 20)
    washed = list(ecu.rls_washed)

    def wash(signal: int, change: int) -> int:
        before = washed[signal]
        washed[signal] = nearest(Fraction(before * cal.rls_washout, 1 << 30)) + change
        return washed[signal] - before

    def part(value: int, factor: int, bits: int = 30) -> int:
        return nearest(Fraction(value * factor, 1 << bits))

    def net_impulse() -> int:
        lean = part(washed[4], round(9.80665 * 2**10), 16)
        return washed[3] - part(lean, cal.rls_lateral)

    impulse = part(sum(ecu.delivered), cal.rls_moment)
    impulse += part(ecu.acceleration_good, cal.rls_lateral)
    impulses, momentum = net_impulse(), part(washed[2], cal.rls_inertia)
    wash(3, wash(1, impulse - ecu.rls_last[1]))
    change = wash(0, ecu.rate_good - ecu.rls_last[0])
    wash(2, change)
    # the trapezoid of the rate over a step, from Q27 to Q30
    wash(4, part(2 * washed[0] - change, cal.tick_us * round(0.5e-6 * 2**33)))
    impulses += net_impulse()
    gained = part(washed[2], cal.rls_inertia) - momentum
    kept = [part(washed[4], cal.rls_stiffness), nearest(Fraction(impulses, 2)) - gained]
    index = ecu.rls_index
    changes = [new - ecu.rls_history[k][index] for k, new in enumerate(kept)]
    integrals = [a + b for a, b in zip(ecu.rls_integrals, changes, strict=True)]
    f = (integrals[0] - nearest(Fraction(changes[0], 2)), part(changes[0], cal.rls_damping, 20))
    ratios = learnt(ecu, cal, f, integrals[1])
    last = [ecu.rate_good, impulse]
    identify(ecu, cal, 1)
    assert (ecu.rls_washed, ecu.rls_last, ecu.rls_integrals) == (washed, last, integrals)
    assert [history[index] for history in ecu.rls_history] == kept
    assert ecu.rls_index == (index + 1) % 10
    assert (ecu.theta, ecu.rls_covariance) == ratios


@SEEDS
@pytest.mark.parametrize("axle", [0, 1])
def test_what_an_axle_lacks_moves_to_the_other_within_the_slack(seed, axle):
    """All is asked of one axle, whose limits lie within a few units of it; the other gives all."""
    rng = random.Random(1200 + seed)
    ecu, cal = started(rng, share_slack=rng.choice((0, 1 << 10, 1 << 20, 1 << 30)))
    cal.arm_front, cal.arm_rear = rng.randint(1 << 26, 1 << 27), rng.randint(1 << 26, 1 << 27)
    arms, tracks = (cal.arm_front, cal.arm_rear), (cal.track_front, cal.track_rear)
    ecu.front_share = (1 - axle) << 30
    for _ in range(60):
        ecu.moment = rng.randint(-(1 << 24), 1 << 24)
        want = nearest(Fraction(ecu.moment * arms[axle], 1 << 28))
        bounds = [max(abs(want) + rng.randint(-3, 3), 0) for _ in range(2)]
        cal.force_max = [4090 << 14] * 4
        cal.force_max[2 * axle : 2 * axle + 2] = bounds
        most = sum(bounds)
        total = limited(2 * want, -most, most)
        lack = nearest(Fraction((2 * want - total) * tracks[axle], 1 << 29))
        room = nearest(Fraction(abs(ecu.moment) * cal.share_slack, 1 << 30))
        moved = limited(lack, -room, room)
        taken = nearest(Fraction(moved * arms[1 - axle], 1 << 28))
        allocate(ecu, cal)
        force = ecu.force[2 * axle : 2 * axle + 2]
        assert force[0] - force[1] == total
        assert all(abs(value) <= bound for value, bound in zip(force, bounds, strict=True))
        assert ecu.force[2 - 2 * axle : 4 - 2 * axle] == [taken, -taken]
        assert ecu.given == ecu.moment - lack + moved
