"""The calibration record: all parameters of a design, in one fixed layout for all laws.

Formats of the quantities the coefficients meet are fixed: roll angle Q30 rad, rates Q27 rad/s,
accelerations Q24 m/s², moments Q14 N·m. A coefficient row shares one shift n: the products are
summed in 64 bits and come out through ``rsh(sum, n)``. For a row whose result has format Qr and
a column whose factor has format Qc, the stored coefficient is ``round(value * 2**(n + r - c))``.
States have 31 bits and coefficients within 2**29, so that no row's sum of up to fifteen
products leaves 64 bits, whatever the calibration.
"""

from typing import Annotated

from canroll.firmware.subset import F, i32, record, u8

# laws
STATE_FEEDBACK = 0
OUTPUT_FEEDBACK = 1
COMPENSATOR = 2
# actuators
SUSPENSION = 0
BARS = 1
DAMPERS = 2
VALVES = 3
# observers
BYPASS = 0
CONSTANT_GAIN = 1
PROPAGATED_COVARIANCE = 2

N_STATES = 5
N_MEASUREMENTS = 3
N_RX = 5
N_POINTS = 8
N_ORDER = 8
N_RING = 32

Q_ANGLE = 30
Q_RATE = 27
Q_ACCELERATION = 24
Q_MOMENT = 14
Q_UNIT = 30
Q_SPEED = 20
# a sum of accelerations over samples
Q_SLIDE = 18

# states have 31 bits: the sum of two of them fits 32
STATE_MIN = -(1 << 30)
STATE_MAX = (1 << 30) - 1
ONE = 1 << 30
COEFFICIENT = 1 << 29
# shares of what a model may be wrong by
Q_SHARE = 10
SHARE_MAX = 16 << Q_SHARE
LARGE = (1 << 31) - 1


@record
class Calibration:
    """Const memory of the ECU; written by the gain generator, never by the loop.

    Bytes first, then words, each in the groups of the loop's stages: no byte is padding, so that
    the CRC is that of the memory.
    """

    # identity
    layout: Annotated[u8, F(1, 1, 0, "", "of this record")]
    version: Annotated[list[u8], 3, F(0, 255, 0, "", "of canroll that made it: 1.2.3")]

    # selection
    law: Annotated[u8, F(0, 2, 0, "", "0 state feedback, 1 output feedback, 2 compensator")]
    actuator: Annotated[u8, F(0, 3, 0, "", "0 suspension, 1 bars, 2 dampers, 3 valves")]
    observer: Annotated[u8, F(0, 2, 0, "", "0 bypass, 1 constant gain, 2 covariance")]
    measurements: Annotated[u8, F(1, 3, 0, "", "bit 0 roll rate, bit 1 lateral acceleration")]
    identification: Annotated[u8, F(0, 1, 0, "", "1: roll stiffness and damping are identified")]
    offset_learning: Annotated[
        u8, F(0, 1, 0, "", "1: sensor offsets are learnt in straight running")
    ]
    event_trigger: Annotated[u8, F(0, 1, 0, "", "0: a command every tick, 1: event-triggered")]
    e2e: Annotated[u8, F(0, 1, 0, "", "1: frames carry and need their protection")]

    # supervision, per received message
    e2e_max_delta: Annotated[list[u8], N_RX, F(1, 14, 0, "", "largest counter step accepted")]
    e2e_max_repeated: Annotated[list[u8], N_RX, F(0, 14, 0, "", "repetitions before a resync")]
    e2e_sync: Annotated[list[u8], N_RX, F(0, 14, 0, "", "good frames needed to resynchronise")]

    # observer: states are roll, roll rate, effective a_y, its rate, gyro bias
    phi_shift: Annotated[list[u8], N_STATES, F(1, 62, 0, "", "shift of each transition row")]
    output_shift: Annotated[list[u8], N_MEASUREMENTS, F(1, 62, 0, "", "shift of each output row")]
    correction_shift: Annotated[
        list[list[u8]], N_MEASUREMENTS, N_STATES, F(1, 62, 0, "", "shift of each gain")
    ]
    correction_single_shift: Annotated[list[u8], N_STATES, F(1, 62, 0, "", "its shifts")]

    # propagated covariance of the states, each in units of its own power of two
    covariance_gain_shift: Annotated[
        list[list[u8]], 2, N_STATES, F(1, 62, 0, "", "gain Q24 times innovation to the state")
    ]

    # prediction over the delay
    predict_steps: Annotated[u8, F(0, N_RING, 0, "ticks", "from the sample to the actuation")]

    # identification of roll stiffness and damping, relative to nominal: theta [int phi, d phi] =
    # int(M + m h a_y) - I_x d phi', all over a window of ten steps, in a unit of 100 N·m·s or more
    rls_decimation: Annotated[u8, F(1, 20, 0, "ticks", "ticks per identification step")]

    # control laws; the moment is minus the sum for state feedback, plus for output feedback
    feedback_shift: Annotated[u8, F(1, 62, 0, "", "shift of the feedback row")]
    feedforward_shift: Annotated[u8, F(1, 62, 0, "", "shift of the feedforward row")]
    output_gain_shift: Annotated[u8, F(1, 62, 0, "", "shift of the output-feedback row")]
    compensator_order: Annotated[u8, F(0, N_ORDER, 0, "", "number of compensator states")]
    compensator_outputs: Annotated[u8, F(1, 2, 0, "", "1 moment, or front and rear")]
    compensator_shift: Annotated[list[u8], N_ORDER, F(1, 60, 0, "", "shift of each state row")]
    compensator_output_shift: Annotated[list[u8], 2, F(1, 60, 0, "", "shift of each output")]

    # speed schedule and fading
    schedule_points: Annotated[u8, F(1, N_POINTS, 0, "", "points of the speed schedule")]

    # offset learning
    offset_shift: Annotated[u8, F(1, 62, 0, "", "shift of its gain")]

    # identity
    id: Annotated[i32, F(0, LARGE, 0, "", "identifies the calibration")]
    tick_us: Annotated[i32, F(1000, 20000, 0, "us", "period of the loop")]

    # supervision, per received message
    timeout_ticks: Annotated[list[i32], N_RX, F(0, 100000, 0, "ticks", "0: not needed")]
    init_ticks: Annotated[i32, F(1, 100000, 0, "ticks", "good inputs before ACTIVE")]
    recovery_ticks: Annotated[i32, F(1, 100000, 0, "ticks", "good inputs before SAFE ends")]
    ramp_ticks: Annotated[i32, F(1, 100000, 0, "ticks", "ramp of the law's authority from 0")]
    release_ticks: Annotated[
        i32, F(1, 100000, 0, "ticks", "in which a moment fades that is taken away")
    ]
    stuck_ticks: Annotated[i32, F(1, 100000, 0, "ticks", "an unchanging sample counter is stuck")]
    roll_rate_max: Annotated[i32, F(0, STATE_MAX, Q_RATE, "rad/s", "plausible roll rate")]
    acceleration_max: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "plausible lateral acceleration")
    ]
    acceleration_change: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "most that it changes by a tick")
    ]
    acceleration_noise: Annotated[i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "and noise besides")]
    speed_fall: Annotated[
        i32, F(0, 200 << Q_SPEED, Q_SPEED, "m/s", "most that brakes take from the speed a tick")
    ]
    speed_noise: Annotated[i32, F(0, 200 << Q_SPEED, Q_SPEED, "m/s", "and noise besides")]

    # observer: states are roll, roll rate, effective a_y, its rate, gyro bias
    phi: Annotated[
        list[list[i32]], N_STATES, N_STATES, F(-COEFFICIENT, COEFFICIENT, 0, "", "transition")
    ]
    gamma: Annotated[
        list[i32], N_STATES, F(-COEFFICIENT, COEFFICIENT, 0, "", "input: delivered moment")
    ]
    gamma_steering: Annotated[
        list[i32], N_STATES, F(-COEFFICIENT, COEFFICIENT, 0, "", "input: a_y from steering")
    ]
    output: Annotated[
        list[list[i32]],
        N_MEASUREMENTS,
        N_STATES,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "roll rate, a_y, roll angle from the state"),
    ]
    output_moment: Annotated[
        list[i32], N_MEASUREMENTS, F(-COEFFICIENT, COEFFICIENT, 0, "", "and from the moment")
    ]
    correction: Annotated[
        list[list[i32]],
        N_MEASUREMENTS,
        N_STATES,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "Kalman gain, a row per measurement"),
    ]
    correction_single: Annotated[
        list[i32],
        N_STATES,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "roll-rate gain when a_y is lost"),
    ]
    bias_max: Annotated[i32, F(0, STATE_MAX, Q_RATE, "rad/s", "largest plausible gyro bias")]

    # propagated covariance of the states, each in units of its own power of two
    covariance_phi: Annotated[
        list[list[i32]], N_STATES, N_STATES, F(-COEFFICIENT, COEFFICIENT, 24, "", "scaled phi")
    ]
    covariance_output: Annotated[
        list[list[i32]], 2, N_STATES, F(-COEFFICIENT, COEFFICIENT, 24, "", "scaled output rows")
    ]
    process_noise: Annotated[list[i32], N_STATES, F(0, STATE_MAX, 24, "", "added a tick")]
    measurement_noise: Annotated[list[i32], 2, F(1, STATE_MAX, 24, "", "variance")]
    covariance_start: Annotated[list[i32], N_STATES, F(1, STATE_MAX, 24, "", "initial variance")]
    covariance_max: Annotated[list[i32], N_STATES, F(1, STATE_MAX, 24, "", "cap of a variance")]

    # prediction over the delay
    actuator_rate: Annotated[
        i32, F(0, ONE, Q_UNIT, "", "fraction of a step command covered by the actuator per tick")
    ]

    # identification of roll stiffness and damping, relative to nominal: theta [int phi, d phi] =
    # int(M + m h a_y) - I_x d phi', all over a window of ten steps, in a unit of 100 N·m·s or more
    rls_forgetting: Annotated[i32, F(ONE // 2, ONE, Q_UNIT, "", "forgetting factor a step")]
    rls_washout: Annotated[i32, F(ONE // 2, ONE, Q_UNIT, "", "washout factor per step")]
    rls_gate: Annotated[i32, F(0, STATE_MAX, Q_RATE, "rad/s", "least roll rate for identification")]
    rls_trace_max: Annotated[i32, F(1, 1 << 25, 20, "", "no forgetting above this trace")]
    rls_start: Annotated[i32, F(1, 1 << 24, 20, "", "initial variance of each ratio")]
    rls_lo: Annotated[list[i32], 2, F(1, STATE_MAX, 28, "", "least stiffness, damping ratio")]
    rls_hi: Annotated[list[i32], 2, F(1, STATE_MAX, 28, "", "largest stiffness, damping ratio")]
    rls_moment: Annotated[i32, F(0, COEFFICIENT, 30, "", "Q14 moment to its impulse per step, Q20")]
    rls_lateral: Annotated[i32, F(0, COEFFICIENT, 30, "", "Q24 a_y to m h a_y a step, Q20")]
    rls_inertia: Annotated[i32, F(0, COEFFICIENT, 30, "", "Q27 rate to I_x rate, Q20")]
    rls_stiffness: Annotated[i32, F(0, COEFFICIENT, 30, "", "Q30 roll to T0 roll per step, Q20")]
    rls_damping: Annotated[i32, F(0, COEFFICIENT, 20, "", "C0 / (T0 step)")]
    model_stiffness: Annotated[i32, F(0, COEFFICIENT, 30, "", "T0 tick**2 / I_x, nominal")]
    model_damping: Annotated[i32, F(0, COEFFICIENT, 30, "", "C0 tick / I_x, nominal")]
    model_scale: Annotated[
        list[list[i32]],
        2,
        4,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "roll, rate, a_y, moment: to the rows of phi, gamma"),
    ]

    # control laws; the moment is minus the sum for state feedback, plus for output feedback
    feedback: Annotated[
        list[i32], N_STATES, F(-COEFFICIENT, COEFFICIENT, 0, "", "u = -(feedback) x")
    ]
    feedforward: Annotated[
        list[i32], N_STATES, F(-COEFFICIENT, COEFFICIENT, 0, "", "u -= (feedforward) x")
    ]
    output_gain: Annotated[
        list[i32],
        N_MEASUREMENTS,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "u = (gain) [roll rate, a_y, roll]"),
    ]
    compensator_a: Annotated[
        list[list[i32]], N_ORDER, N_ORDER, F(-COEFFICIENT, COEFFICIENT, 0, "", "states Q24")
    ]
    compensator_b: Annotated[
        list[list[i32]],
        N_ORDER,
        4,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "inputs: roll, roll rate, a_y, a_y by steering"),
    ]
    compensator_e: Annotated[
        list[list[i32]],
        N_ORDER,
        2,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "inputs: the saturated outputs"),
    ]
    compensator_c: Annotated[
        list[list[i32]], 2, N_ORDER, F(-COEFFICIENT, COEFFICIENT, 0, "", "outputs Q14")
    ]
    compensator_d: Annotated[
        list[list[i32]], 2, 4, F(-COEFFICIENT, COEFFICIENT, 0, "", "from the inputs")
    ]
    steering_limit: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "largest a_y by steering of the inputs")
    ]
    moment_max: Annotated[i32, F(0, STATE_MAX, Q_MOMENT, "N·m", "largest moment commanded")]
    slew_max: Annotated[i32, F(1, STATE_MAX, Q_MOMENT, "N·m", "largest change of it per tick")]

    # speed schedule and fading
    schedule_speed: Annotated[
        list[i32], N_POINTS, F(0, 200 << Q_SPEED, Q_SPEED, "m/s", "ascending")
    ]
    schedule_gain: Annotated[list[i32], N_POINTS, F(0, ONE, 28, "", "factor on the moment")]
    schedule_front_share: Annotated[
        list[i32], N_POINTS, F(0, ONE, Q_UNIT, "", "share of the front axle")
    ]
    schedule_steering: Annotated[
        list[i32], N_POINTS, F(-STATE_MAX, STATE_MAX, 20, "m/s2/rad", "a_y per rad of the wheel")
    ]
    fade_low: Annotated[i32, F(0, 200 << Q_SPEED, Q_SPEED, "m/s", "no authority below")]
    fade_high: Annotated[i32, F(1, 200 << Q_SPEED, Q_SPEED, "m/s", "full authority above")]

    # offset learning
    straight_steering: Annotated[i32, F(0, STATE_MAX, 24, "rad", "wheel angle in straight running")]
    straight_yaw_rate: Annotated[i32, F(0, STATE_MAX, Q_RATE, "rad/s", "and yaw rate")]
    offset_gain: Annotated[i32, F(0, COEFFICIENT, 0, "", "of the error to the offset per sample")]
    offset_rate_max: Annotated[i32, F(0, STATE_MAX, Q_RATE, "rad/s", "largest roll-rate offset")]
    offset_acceleration_max: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "largest lateral-acceleration offset")
    ]

    # event trigger: send when e**2 > epsilon**2 u**2 + floor**2
    trigger_epsilon_squared: Annotated[i32, F(0, 1 << 20, 20, "", "relative threshold, squared")]
    trigger_floor: Annotated[i32, F(0, STATE_MAX, Q_MOMENT, "N·m", "absolute threshold")]
    heartbeat_ticks: Annotated[i32, F(1, 1000, 0, "ticks", "maximum time between commands")]
    acknowledge_ticks: Annotated[i32, F(1, 1000, 0, "ticks", "time after which the echo is due")]
    status_ticks: Annotated[i32, F(1, 10000, 0, "ticks", "time between two status frames")]

    # safety envelope
    envelope_moment: Annotated[i32, F(0, STATE_MAX, Q_MOMENT, "N·m", "largest output")]
    envelope_slew: Annotated[i32, F(1, STATE_MAX, Q_MOMENT, "N·m", "largest change per tick")]
    envelope_age: Annotated[
        i32, F(1, 1 << 20, 0, "ticks", "largest age of the lateral acceleration")
    ]
    envelope_outward: Annotated[
        i32, F(0, STATE_MAX, Q_MOMENT, "N·m", "moment outward that does no harm")
    ]
    envelope_lateral: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "direction is judged above it")
    ]
    envelope_ticks: Annotated[i32, F(1, 1 << 20, 0, "ticks", "a moment outward is cut after")]
    envelope_pass: Annotated[i32, F(0, ONE, Q_UNIT, "", "low-pass of a_y: its weight per tick")]

    # redundancy monitor
    redundancy_min: Annotated[
        i32, F(0, STATE_MAX // 2, Q_ACCELERATION, "m/s2", "least gap of a_y that counts, 0: off")
    ]
    redundancy_share: Annotated[
        i32, F(0, SHARE_MAX, Q_SHARE, "", "of the lateral acceleration that is expected besides")
    ]
    redundancy_limit: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "end of the tyres' linear range")
    ]
    redundancy_pass: Annotated[
        list[i32],
        4,
        F(0, ONE, Q_UNIT, "", "weights per sample: fading of the range, of a_y; mirror's two"),
    ]
    opposite_min: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "least a_y and yaw rate times speed")
    ]
    slide_max: Annotated[
        i32, F(0, STATE_MAX, Q_SLIDE, "1/s", "largest swing of the sideslip, per sample's period")
    ]
    apart_samples: Annotated[i32, F(1, 1000, 0, "", "outside both or frozen in a row that count")]
    bound_samples: Annotated[i32, F(1, 1000, 0, "", "gyro bias at its bound in a row that count")]
    mirror_limit: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "no mirror image is judged above")
    ]
    mirror_min: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "so much nearer to it is a mirror image")
    ]

    # clock monitor
    clock_period: Annotated[
        i32, F(0, 100000, 0, "us", "between two counts of the inertial unit, 0: off")
    ]
    clock_limit: Annotated[
        i32, F(0, 1000000, 0, "us", "by which counts and ticks of a window may differ")
    ]
    clock_window: Annotated[i32, F(1, 10000, 0, "ticks", "length of a window")]

    # erratic monitor
    erratic_scale: Annotated[
        list[i32], 5, F(0, STATE_MAX, 0, "", "by signal: 2**42 over the largest bend, 0: off")
    ]
    erratic_kept: Annotated[
        list[i32], 5, F(0, ONE - ONE // 128, Q_UNIT, "", "by signal: of its sum per sample")
    ]
    erratic_samples: Annotated[
        list[i32], 2, F(0, 1000, 0, "", "of one tick or frame: inertial unit, motion")
    ]
    erratic_gap: Annotated[
        list[i32], 2, F(0, 1000, 0, "ticks", "between samples in a row: inertial unit, motion")
    ]

    # delivery monitor
    delivery_window: Annotated[i32, F(1, 1000, 0, "", "samples of a window of commands")]
    delivery_samples: Annotated[i32, F(1, 1000, 0, "", "in a row outside the band that count")]
    delivery_min: Annotated[
        i32, F(0, STATE_MAX // 2, Q_MOMENT, "N·m", "least width of the band's edges, 0: off")
    ]
    delivery_share: Annotated[i32, F(0, SHARE_MAX, Q_SHARE, "", "of the band's size besides")]

    # rolling monitor: the roll rate by the suspensions
    rolling_min: Annotated[
        i32, F(0, STATE_MAX, Q_RATE, "rad/s", "least distance from both axles, 0: off")
    ]
    rolling_ticks: Annotated[i32, F(1, 1000, 0, "ticks", "so far without a break that count")]
    rolling_track: Annotated[list[i32], 2, F(0, 4 << 28, 28, "1/m", "roll over difference")]
    rolling_share: Annotated[i32, F(0, SHARE_MAX, Q_SHARE, "", "of the larger rate besides")]
    rolling_tyres: Annotated[
        i32, F(0, ONE, Q_UNIT, "1/(N·m·s)", "roll rate on the tyres over change of moment")
    ]

    # response monitor: I_x phi'' = delivered moments + m h a_y - springs and dampers
    response_min: Annotated[
        i32, F(0, STATE_MAX // 2, Q_MOMENT, "N·m", "may always be left over, 0: off")
    ]
    response_share: Annotated[
        list[i32],
        6,
        F(0, SHARE_MAX, Q_SHARE, "", "force, springs, dampers, moments, inertia; of an axle"),
    ]
    response_late: Annotated[
        list[i32],
        2,
        F(0, COEFFICIENT, 10, "", "of the mean change of damping moment besides, quick and slow"),
    ]
    response_limit: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "wheels lift and stops are reached above")
    ]
    limit_share: Annotated[
        list[i32], 2, F(0, SHARE_MAX, Q_SHARE, "", "of inertia and moments besides above it")
    ]
    response_ticks: Annotated[i32, F(1, 1000, 0, "ticks", "without a break that count")]
    response_stroke: Annotated[
        list[i32], 2, F(0, COEFFICIENT, 10, "N·s/m", "damping moment over difference of strokes")
    ]
    response_rough: Annotated[
        list[i32], 2, F(0, COEFFICIENT, 10, "N·s/m", "of it by which rebound differs from bump")
    ]
    response_knee: Annotated[
        i32, F(0, STATE_MAX, Q_RATE, "m/s", "stroke rate beyond which dampers are not linear")
    ]
    response_fast: Annotated[
        list[i32], 2, F(0, COEFFICIENT, 10, "N·s/m", "by which they fall behind beyond it")
    ]
    response_stretch: Annotated[
        i32, F(0, ONE, Q_UNIT, "", "change of the springs' moment a tick over damping moment")
    ]
    response_lateral: Annotated[i32, F(0, COEFFICIENT, 10, "kg·m", "m h")]
    response_inertia: Annotated[
        i32, F(0, COEFFICIENT, 10, "N·m·s", "effective roll inertia over the low-pass's time")
    ]
    response_pass: Annotated[i32, F(0, ONE, Q_UNIT, "", "low-pass: its weight per tick")]
    response_mean: Annotated[i32, F(0, ONE, Q_UNIT, "", "mean of changes: its weight per tick")]
    response_wash: Annotated[
        list[i32],
        3,
        F(0, ONE // 2, Q_UNIT, "", "washout, quick, slow, of the axles: what goes per tick"),
    ]
    steady_min: Annotated[
        i32, F(0, STATE_MAX // 2, Q_MOMENT, "N·m", "slow balances: may always be left over")
    ]
    steady_share: Annotated[
        list[i32],
        3,
        F(0, SHARE_MAX, Q_SHARE, "", "of side force to its own side, to the other; of moments"),
    ]
    lateral_share: Annotated[
        list[i32],
        3,
        F(
            0,
            SHARE_MAX,
            Q_SHARE,
            "",
            "of what the body shows, to its side and other; of moments",
        ),
    ]

    # axles monitor, with the response monitor: the tyres of both axles carry what acts on them
    axles_ticks: Annotated[i32, F(1, 1000, 0, "ticks", "without a break that count")]
    axles_min: Annotated[
        i32, F(0, STATE_MAX // 2, Q_MOMENT, "N·m", "least moment left over that counts")
    ]
    axles_rest: Annotated[
        i32, F(0, STATE_MAX // 2, Q_MOMENT, "N·m", "no axle is judged where so much may be")
    ]
    axles_limit: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "wheels may leave the road above")
    ]
    axles_stretch: Annotated[
        list[i32], 2, F(0, COEFFICIENT, 10, "N·s/m", "moment of springs and tyres a tick")
    ]
    axles_damping: Annotated[list[i32], 2, F(0, COEFFICIENT, 10, "", "damping moment over that")]
    axles_side: Annotated[
        i32, F(0, COEFFICIENT, 10, "kg·m", "moment by a_y that may be left over besides")
    ]
    axles_rough: Annotated[
        i32, F(0, COEFFICIENT, 10, "", "moment that a rough road may make over that")
    ]
    axles_rear: Annotated[i32, F(0, 4 << 28, 28, "", "tyres' roll stiffness, front over rear")]
    axles_lateral: Annotated[
        i32, F(-COEFFICIENT, COEFFICIENT, 10, "kg·m", "by a_y at the roll centres, less the rear's")
    ]
    axles_yaw: Annotated[
        i32,
        F(
            -COEFFICIENT,
            COEFFICIENT,
            10,
            "N·m·s",
            "by yaw acceleration, over that of the low-pass",
        ),
    ]

    # heave monitor, with the response monitor: the springs carry the body's weight
    heave_min: Annotated[
        i32, F(0, STATE_MAX // 2, Q_MOMENT, "N", "least force more or less that counts, 0: off")
    ]
    heave_late: Annotated[
        i32, F(0, COEFFICIENT, 10, "", "of the mean change of the springs' force besides")
    ]
    heave_ticks: Annotated[i32, F(1, 10000, 0, "ticks", "more or less without a break that count")]
    heave_stretch: Annotated[
        list[i32], 2, F(0, COEFFICIENT, 10, "N·s/m", "force of an axle's springs a tick")
    ]

    # allocation
    arm_front: Annotated[i32, F(0, 4 << 28, 28, "1/m", "1 / (2 half track), front")]
    arm_rear: Annotated[i32, F(0, 4 << 28, 28, "1/m", "1 / (2 half track), rear")]
    track_front: Annotated[i32, F(1, 4 << 28, 28, "m", "2 half track, front")]
    track_rear: Annotated[i32, F(1, 4 << 28, 28, "m", "2 half track, rear")]
    force_max: Annotated[list[i32], 4, F(0, 4090 << Q_MOMENT, Q_MOMENT, "N", "of each corner")]
    share_slack: Annotated[
        i32, F(0, ONE, Q_UNIT, "", "largest shift of the front share by redistribution")
    ]
    bar_max: Annotated[list[i32], 2, F(0, 8191 << Q_MOMENT, Q_MOMENT, "N·m", "of each bar")]
    damper_speed: Annotated[list[i32], 2, F(1, STATE_MAX, Q_RATE, "m/s", "knee: soft, firm")]
    damper_force: Annotated[list[i32], 2, F(0, STATE_MAX, Q_MOMENT, "N", "at the knee")]
    damper_slope: Annotated[list[i32], 2, F(0, STATE_MAX, Q_MOMENT, "N·s/m", "beyond it")]
    current_max: Annotated[i32, F(0, 16382 << Q_MOMENT, Q_MOMENT, "mA", "damper or valve")]

    # seal
    crc: Annotated[i32, F(-LARGE - 1, LARGE, 0, "", "CRC-32 of the fields before it")]
