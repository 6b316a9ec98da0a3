"""A bank of parity residuals with adaptive thresholds, and the table of their signatures.

A part is a row of at most two inputs, taken as it is, integrated or differentiated, washed out and
low-passed, or the mean of how much it changes in a tick. A residual is a signed sum of parts, zero
where the model and all sensors are right. Its threshold is a weighted sum of the magnitudes of
parts, held and fading, and a floor: what the stated uncertainties can make of it. Beyond it to one
side for its time a residual is raised. A signature is the residuals that one fault raises, with
their sides; it says what is not to be trusted any more, until the next ``init``.

What the parts and thresholds are is in the calibration, designed by ``gain_gen.monitors``: the
firmware has no number of the car. The parts are sorted by kind. After a start the washout is quick
and slows down to its corner, so that the noise of the first samples does not stay.

A round takes two ticks: in one residuals are judged, in the next parts advance by the mean of both.
So no tick is much longer than another, and no sample is lost.
"""

from firmware.calibration import (
    N_DERIVATIVES,
    N_PARTS,
    N_RESIDUALS,
    N_SIGNATURES,
    ONE,
    STATE_MAX,
    Calibration,
)
from firmware.fixed_point import product
from firmware.monitors.persistence import beyond, lasting, magnitude
from firmware.plausibility import NEEDED
from firmware.state import (
    FIRST_FRAME,
    GYRO_BIAS,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_SUSPENSION_RATE,
    Ecu,
)
from firmware.subset import byte, clamp, i32, narrow, rsh, sat31, scaled

# bits of what a part or a residual needs; the first three are those of an Imu frame
GYRO = 1
LATERAL = 2
YAW = 4
MOTION = 8
STROKE = 16
MOMENT = 32
# what a residual needs besides: tyres are linear, wheels on the road, the body off its stops
LINEAR = 64
ON_ROAD = 128
OFF_STOPS = 256
# what a signature says is wrong
WRONG_LATERAL = 1
WRONG_RATE = 2
WRONG_FRONT = 4
WRONG_REAR = 8
# inputs from here on: the first four summed over their samples since the last tick
SUMMED = 12
# ticks of a round
ROUND = 2
# fractional bits of gains, between inputs and parts of the same format
GAIN_BITS = 20
# magnitudes are weighted in units of 2^-10 of a part, weights have 6 fractional bits
COARSE = 10
FINE = 4
MOST = (1 << 26) - 1
# the washout starts at a quarter and slows down by an eighth a round
QUICK = ONE // 4
SLOWING = 3


def trusted(ecu: Ecu, cal: Calibration) -> i32:
    """Return the bits of the inputs that are valid, new and not found wrong; 0 at a standstill."""
    if ecu.gain_factor == 0 or ecu.unchanged[RX_IMU] > cal.timeout_ticks[RX_IMU]:
        return 0
    trust: i32 = ecu.valid[RX_IMU] & (GYRO | LATERAL | YAW)
    if ecu.lateral_lost == 1:
        trust = trust & (GYRO | YAW)
    if ecu.motion_lost == 0:
        trust = trust | MOTION
    stroke: i32 = NEEDED[RX_SUSPENSION_RATE]
    if (ecu.valid[RX_SUSPENSION_RATE] & stroke) == stroke:
        patience: i32 = cal.timeout_ticks[RX_SUSPENSION_RATE]
        if ecu.unchanged[RX_SUSPENSION_RATE] <= patience:
            trust = trust | STROKE
    moment: i32 = NEEDED[RX_ACTUATOR_STATE]
    if (ecu.valid[RX_ACTUATOR_STATE] & moment) == moment and ecu.moment_unknown == 0:
        if (ecu.contradicted[0] | ecu.contradicted[1]) == 0:
            trust = trust | (MOMENT * (ecu.enabled & ecu.command_held))
    return trust


def sum_stroke(ecu: Ecu, k: i32, rate: i32, samples: i32) -> None:
    """Add all that a stroke rate was since the last tick to its input; remember the newest.

    Samples that were lost since are taken to be on a line between the last one and this.
    """
    twice: i32 = sat31(samples * rate) + sat31((samples - 1) * sat31(ecu.residual_input[k]))
    ecu.residual_input[k] = rate
    total: i32 = sat31(ecu.residual_input[SUMMED + k])
    ecu.residual_input[SUMMED + k] = sat31(total + sat31(rsh(sat31(twice) + rate, 1)))


def gather_strokes(ecu: Ecu) -> None:
    """Take the newest stroke rates, left less right and left and right, of both axles."""
    if (ecu.fresh[RX_SUSPENSION_RATE] & FIRST_FRAME) == 0 or ecu.rate_sample == ecu.residual_sample:
        return
    samples: i32 = (ecu.rate_sample - ecu.residual_sample) & 15
    ecu.residual_sample = ecu.rate_sample
    sum_stroke(ecu, 0, sat31(ecu.stroke_rate[0] - ecu.stroke_rate[1]), samples)
    sum_stroke(ecu, 1, sat31(ecu.stroke_rate[2] - ecu.stroke_rate[3]), samples)
    sum_stroke(ecu, 2, sat31(ecu.stroke_rate[0] + ecu.stroke_rate[1]), samples)
    sum_stroke(ecu, 3, sat31(ecu.stroke_rate[2] + ecu.stroke_rate[3]), samples)


def take(ecu: Ecu, k: i32, value: i32) -> None:
    """Take a sample as input ``k``: of a round its mean."""
    if ecu.residual_turn == 0:
        ecu.residual_input[k] = value
    else:
        ecu.residual_input[k] = rsh(sat31(ecu.residual_input[k]) + value, 1)


def gather(ecu: Ecu) -> None:
    """Take the newest of the other signals as inputs of the parts."""
    take(ecu, 4, ecu.delivered[0])
    take(ecu, 5, ecu.delivered[1])
    take(ecu, 6, ecu.lateral_acceleration)
    take(ecu, 7, product(ecu.speed, ecu.yaw_rate, 23))
    take(ecu, 8, ecu.steering_acceleration)
    take(ecu, 9, ecu.roll_rate)
    take(ecu, 10, ecu.yaw_rate)
    take(ecu, 11, ecu.x[GYRO_BIAS])


def combined(ecu: Ecu, cal: Calibration, k: i32) -> i32:
    """Return the sum of the inputs of part ``k``."""
    first: i32 = ecu.residual_input[cal.part_input[k][0]]
    second: i32 = ecu.residual_input[cal.part_input[k][1]]
    return scaled(cal.part_gain[k][0] * first + cal.part_gain[k][1] * second, GAIN_BITS)


def share(value: i32, weight: i32) -> i32:
    """Return a share of ``value``; ``weight`` is of 2^30."""
    return narrow(rsh(value * weight, 30))


def followed(cal: Calibration, k: i32, slow: i32, value: i32) -> i32:
    """Return the low-pass of part ``k``, that was ``slow``, after a round with ``value``."""
    return sat31(slow + share(sat31(value - slow), cal.part_pass[k]))


def forget(ecu: Ecu, cal: Calibration, k: i32, value: i32) -> None:
    """Let the washout of part ``k`` forget its share of ``value``; none without a washout."""
    if cal.part_wash[k] != 0:
        share_now: i32 = clamp(cal.part_wash[k], ecu.residual_start, ONE)
        ecu.part_memory[k] = sat31(ecu.part_memory[k] - share(value, share_now))


def washed(ecu: Ecu, cal: Calibration, k: i32, value: i32) -> i32:
    """Return ``value`` less what it has long been, and remember more of it."""
    new: i32 = sat31(ecu.part_memory[k] + value)
    forget(ecu, cal, k, new)
    return new


def start_parts(ecu: Ecu, cal: Calibration) -> None:
    """Start all parts from their present inputs: nothing is left over now."""
    ecu.residual_start = QUICK
    ecu.on_stops = 1
    for k in range(cal.part_end[3]):
        value: i32 = combined(ecu, cal, k)
        ecu.part[k] = 0
        ecu.part_memory[k] = 0
        if k >= cal.part_end[2]:
            ecu.part_memory[k] = value
        elif k < cal.part_end[0] or k >= cal.part_end[1]:
            if cal.part_wash[k] != 0:
                ecu.part_memory[k] = sat31(-value)
    for j in range(N_DERIVATIVES):
        m: i32 = clamp(cal.part_end[1] + j, 0, N_PARTS - 1)
        ecu.part_slow[j] = 0
        if cal.part_wash[m] == 0:
            ecu.part_slow[j] = combined(ecu, cal, m)
    for row in range(N_RESIDUALS):
        ecu.residual_room[row] = 0


def advance_parts(ecu: Ecu, cal: Calibration) -> None:
    """Advance all parts by a round, as their kinds."""
    slower: i32 = rsh(ecu.residual_start, SLOWING)
    ecu.residual_start = clamp(ecu.residual_start - slower, 0, ONE)
    for d in range(cal.part_end[0]):
        # as it is
        direct: i32 = washed(ecu, cal, d, combined(ecu, cal, d))
        ecu.part[d] = followed(cal, d, ecu.part[d], direct)
    for i in range(cal.part_end[0], cal.part_end[1]):
        # integrated
        ecu.part[i] = followed(cal, i, ecu.part[i], ecu.part_memory[i])
        forget(ecu, cal, i, ecu.part_memory[i])
        ecu.part_memory[i] = sat31(ecu.part_memory[i] + combined(ecu, cal, i))
    for k in range(cal.part_end[1], cal.part_end[2]):
        # differentiated: less its low-pass
        j: i32 = clamp(k - cal.part_end[1], 0, N_DERIVATIVES - 1)
        value: i32 = washed(ecu, cal, k, combined(ecu, cal, k))
        ecu.part_slow[j] = followed(cal, k, ecu.part_slow[j], value)
        ecu.part[k] = sat31(value - ecu.part_slow[j])
    for m in range(cal.part_end[2], cal.part_end[3]):
        # mean magnitude of its steps
        new: i32 = combined(ecu, cal, m)
        step: i32 = magnitude(sat31(new - ecu.part_memory[m]))
        ecu.part_memory[m] = new
        weight: i32 = clamp(cal.part_pass[m], ecu.residual_start, ONE)
        ecu.part[m] = sat31(ecu.part[m] + share(sat31(step - ecu.part[m]), weight))


def judge(ecu: Ecu, cal: Calibration, row: i32, first: i32) -> None:
    """Compare one residual with its threshold; count how long it is beyond it, on which side."""
    left: i32 = 0
    size: i32 = 0
    for term in range(first, cal.residual_end[row]):
        value: i32 = ecu.part[cal.term_part[term]]
        left = sat31(left + (cal.term_sign[term] - 1) * value)
        coarse: i32 = rsh(magnitude(value), COARSE)
        size = clamp(size + coarse * cal.term_weight[term], 0, MOST)
    room: i32 = ecu.residual_room[row]
    room = clamp(size << FINE, room - share(room, cal.residual_fade[row]), STATE_MAX)
    ecu.residual_room[row] = room
    side: i32 = 1
    if left < 0:
        side = -1
    limit: i32 = cal.residual_ticks[row]
    so_far: i32 = clamp(side * ecu.residual_count[row], 0, limit)
    count: i32 = beyond(magnitude(left), sat31(room + cal.residual_floor[row]))
    ecu.residual_count[row] = side * lasting(so_far, count, limit)


def matches(cal: Calibration, k: i32, one: i32, other: i32) -> i32:
    """Return 1 where the residuals raised to ``one`` side and the ``other`` are signature ``k``."""
    same: i32 = cal.signature_same[k]
    opposite: i32 = cal.signature_opposite[k]
    if same == 0 or (one & same) != same or (other & opposite) != opposite:
        return 0
    if (one & cal.signature_absent[k]) != 0:
        return 0
    return 1


def isolate(ecu: Ecu, cal: Calibration, up: i32, down: i32) -> None:
    """Find the signatures of the residuals raised ``up`` and ``down``, and what is wrong then."""
    if (up | down | ecu.residual_raised) == 0:
        return
    ecu.residual_raised = up | down
    for k in range(N_SIGNATURES):
        seen: i32 = matches(cal, k, up, down) | matches(cal, k, down, up)
        ticks: i32 = cal.signature_ticks[k]
        ecu.signature_count[k] = byte(lasting(ecu.signature_count[k], seen, ticks))
        if ecu.signature_count[k] == ticks:
            wrong: i32 = cal.signature_wrong[k]
            if (wrong & WRONG_LATERAL) != 0:
                ecu.lateral_contradicted = 1
            if (wrong & WRONG_RATE) != 0:
                ecu.rate_contradicted = 1
            if (wrong & WRONG_FRONT) != 0:
                ecu.contradicted[0] = 1
            if (wrong & WRONG_REAR) != 0:
                ecu.contradicted[1] = 1


def in_range(ecu: Ecu, cal: Calibration) -> i32:
    """Return the bits of the ranges in which the car is.

    A body that was seen to lean as far as its stops is off them where no car would reach them.
    """
    bits: i32 = 0
    if ecu.motion_peak <= cal.residual_linear:
        bits = LINEAR
    if ecu.motion_peak <= cal.residual_on_road:
        bits = bits | ON_ROAD
    if magnitude(ecu.part[cal.lean_part]) > cal.lean_max:
        ecu.on_stops = 1
    elif ecu.motion_peak <= cal.residual_off_stops:
        ecu.on_stops = 0
    return bits | (OFF_STOPS * (ecu.on_stops ^ 1))


def judge_residuals(ecu: Ecu, cal: Calibration) -> None:
    """Judge all residuals of a round and what they say together."""
    trust: i32 = in_range(ecu, cal)
    trust = trust | ecu.residual_trust
    up: i32 = 0
    down: i32 = 0
    first: i32 = 0
    for row in range(N_RESIDUALS):
        if (trust & cal.residual_needs[row]) == cal.residual_needs[row]:
            judge(ecu, cal, row, first)
        else:
            ecu.residual_count[row] = 0
        if ecu.residual_count[row] >= cal.residual_ticks[row]:
            up = up | cal.residual_bit[row]
        elif ecu.residual_count[row] <= -cal.residual_ticks[row]:
            down = down | cal.residual_bit[row]
        first = cal.residual_end[row]
    isolate(ecu, cal, up, down)


def watch_residuals(ecu: Ecu, cal: Calibration, elapsed: i32) -> None:
    """Judge the newest samples by all residuals; a missed tick or a returning input starts anew."""
    if cal.part_end[3] == 0:
        return
    if elapsed > 1:
        ecu.residual_turn = 0
        ecu.residual_trust = 0
        return
    gather_strokes(ecu)
    gather(ecu)
    if ecu.residual_turn == 0:
        ecu.residual_turn = 1
        judge_residuals(ecu, cal)
        return
    ecu.residual_turn = 0
    trust: i32 = trusted(ecu, cal)
    if (trust & (255 ^ ecu.residual_trust)) != 0:
        start_parts(ecu, cal)
    else:
        advance_parts(ecu, cal)
    ecu.residual_trust = byte(trust)
    for k in range(4):
        ecu.residual_input[SUMMED + k] = 0
