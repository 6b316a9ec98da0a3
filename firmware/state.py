"""The state record of the ECU: everything the loop remembers from one tick to the next.

Bounds are narrower than 32 bits and hold at every store, so that sums of products stay inside
64 bits; ``canroll.codegen.proof.prove`` shows that a tick keeps them from any state inside them.
"""

from typing import Annotated

from canroll.firmware.calibration import (
    COEFFICIENT,
    N_ORDER,
    N_RING,
    N_RX,
    N_STATES,
    ONE,
    Q_ACCELERATION,
    Q_ANGLE,
    Q_MOMENT,
    Q_RATE,
    Q_SLIDE,
    Q_SPEED,
    Q_UNIT,
    STATE_MAX,
    STATE_MIN,
)
from canroll.firmware.com.frames import COUNTER_MAX, N_FRAMES, RX_BYTES, TX_BYTES
from canroll.firmware.subset import I32_MAX, I32_MIN, F, i32, record, u8

# modes
INIT = 0
ACTIVE = 1
DEGRADED = 2
SAFE = 3

# received messages
RX_IMU = 0
RX_VEHICLE_MOTION = 1
RX_SUSPENSION_RATE = 2
RX_ACTUATOR_STATE = 3
RX_ROLL_REFERENCE = 4

# transmitted messages
N_TX = 6
TX_SUSPENSION_FORCE = 0
TX_ANTI_ROLL_BAR = 1
TX_DAMPER = 2
TX_VALVE = 3
TX_STATUS = 4
TX_DIAGNOSTICS = 5

# observer states
ROLL = 0
ROLL_RATE = 1
LATERAL = 2
LATERAL_RATE = 3
GYRO_BIAS = 4

N_FAULT_CODES = 28
# commands whose time of sending is kept; a power of two
N_SENT = 16
AGE_MAX = 1 << 20
STROKE_MAX = 1 << 29
WINDOW_MAX = 1 << 26
# ecu.calibration_word where the calibration has not the CRC it carries
CORRUPT = 1 << 12
# bit of ecu.fresh: the first frame of the message brought a new sample
FIRST_FRAME = 64
# bit of both: what a further frame carries that has no bit of its own
REST = 32
# ecu.last_sample of a frame not yet received
NO_SAMPLE = 16
# bit of ecu.valid: a signal of the message and its redundant or inverted one disagree
DISAGREES = 128


@record
class Ecu:
    """State and mailboxes of one ECU; the caller owns it, ``init`` fills it.

    Words first, then bytes, each in the groups of the loop's stages: so nothing is lost to padding.
    """

    # inputs: the last valid ones, in internal formats
    age: Annotated[list[i32], N_FRAMES, F(0, AGE_MAX, 0, "ticks", "since the last valid frame")]
    roll_rate: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "gyro, as received")]
    lateral_acceleration: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "accelerometer, as received")
    ]
    yaw_rate: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "as received")]
    speed: Annotated[i32, F(0, 200 << Q_SPEED, Q_SPEED, "m/s", "vehicle speed")]
    speed_kept: Annotated[i32, F(0, 200 << Q_SPEED, Q_SPEED, "m/s", "the last believed one")]
    speed_ticks: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "since then")]
    steering: Annotated[i32, F(STATE_MIN, STATE_MAX, 24, "rad", "steering-wheel angle")]
    stroke_rate: Annotated[
        list[i32], 4, F(-STROKE_MAX, STROKE_MAX, Q_RATE, "m/s", "of each corner, extension +")
    ]
    delivered: Annotated[
        list[i32], 2, F(STATE_MIN // 2, STATE_MAX // 2, Q_MOMENT, "N·m", "front, rear moment")
    ]
    reference_roll: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_ANGLE, "rad", "true roll angle")]
    reference_rate: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "true roll rate")]
    reference_acceleration: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "true lateral acceleration")
    ]

    # supervision
    unchanged: Annotated[list[i32], N_FRAMES, F(0, AGE_MAX, 0, "ticks", "sample counter unchanged")]
    bad_ticks: Annotated[
        list[i32], 6, F(0, AGE_MAX, 0, "ticks", "time since a monitored value became bad")
    ]
    calibration_crc: Annotated[i32, F(I32_MIN, I32_MAX, 0, "", "CRC of its words so far")]
    calibration_word: Annotated[
        i32, F(0, CORRUPT, 0, "", "to be checked next, 4096: it is corrupt")
    ]
    refused: Annotated[i32, F(0, 1000, 0, "", "rule by which the calibration was refused, 0: none")]
    rate_good: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "last plausible gyro")]
    acceleration_good: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "last plausible accelerometer")
    ]
    acceleration_ticks: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "since then")]
    lateral_good: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "lateral acceleration is good since")]
    good_ticks: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "all needed inputs good since")]
    authority: Annotated[i32, F(0, ONE, Q_UNIT, "", "ramp of the law, 0 in INIT and SAFE")]
    released: Annotated[i32, F(0, ONE, Q_UNIT, "", "what is left of the held moment, fading")]
    trust: Annotated[list[i32], 4, F(0, ONE, Q_UNIT, "", "what a corner may give of its limit")]
    feedforward: Annotated[i32, F(0, ONE, Q_UNIT, "", "ramp of the feedforward, 0 without a_y")]
    detected: Annotated[i32, F(0, (1 << 28) - 1, 0, "", "bit i: this tick has detected fault i")]
    foreign_ticks: Annotated[
        i32, F(0, AGE_MAX, 0, "ticks", "left of the report that an own identifier was heard")
    ]
    fault_active: Annotated[i32, F(0, (1 << 28) - 1, 0, "", "bit i: code i is active")]
    fault_latched: Annotated[i32, F(0, (1 << 28) - 1, 0, "", "bit i: code i has occurred")]
    time: Annotated[i32, F(I32_MIN, I32_MAX, 0, "ticks", "since init, wraps")]

    # redundancy monitor
    motion_peak: Annotated[
        i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "largest by yaw rate or steering, fading")
    ]
    motion_now: Annotated[i32, F(0, STATE_MAX, Q_ACCELERATION, "m/s2", "likewise, fading fast")]
    slide: Annotated[
        i32, F(0, STATE_MAX, Q_SLIDE, "m/s2", "yaw rate opposite to a_y: sum of how far apart")
    ]
    frozen_lateral: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "last change of lateral acceleration")
    ]
    frozen_turning: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "yaw rate times speed then")
    ]
    unit_side: Annotated[i32, F(-1, 1, 0, "", "side that the inertial unit turned to, 1: left")]

    # samples monitor, by message: inertial unit, motion; and by signal: roll rate, lateral
    # acceleration, yaw rate, speed, steering angle
    sample_gap: Annotated[list[i32], 2, F(0, AGE_MAX, 0, "ticks", "since the last sample")]
    clock_ticks: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "of the present window")]
    clock_error: Annotated[
        i32, F(STATE_MIN, STATE_MAX, 0, "us", "the inertial unit has counted more in it")
    ]
    erratic_last: Annotated[list[i32], 5, F(STATE_MIN, STATE_MAX, 0, "", "last sample")]
    erratic_step: Annotated[list[i32], 5, F(STATE_MIN, STATE_MAX, 0, "", "step to it")]
    erratic_sum: Annotated[
        list[i32], 5, F(-1 << 23, 1 << 23, 12, "", "squares of second differences, fading")
    ]

    # delivery monitor
    commanded: Annotated[
        list[i32], 2, F(STATE_MIN, STATE_MAX, Q_MOMENT, "N·m", "front, rear, as sent last")
    ]
    band_high: Annotated[
        list[i32],
        4,
        F(STATE_MIN, STATE_MAX, Q_MOMENT, "N·m", "largest command: this window, the one before"),
    ]
    band_low: Annotated[
        list[i32], 4, F(STATE_MIN, STATE_MAX, Q_MOMENT, "N·m", "least command, likewise")
    ]
    window_samples: Annotated[i32, F(0, 1000, 0, "", "samples of the present window")]

    # rolling monitor
    standing_rate: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "last change of gyro")]
    standing_front: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "the front suspension's rate then")
    ]
    standing_rear: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "the rear suspension's rate then")
    ]

    # residuals, by the rows that firmware.monitors.residual names
    past: Annotated[
        list[i32], 15, F(STATE_MIN, STATE_MAX, 0, "", "of an input, what is washed out")
    ]
    passed: Annotated[list[i32], 15, F(STATE_MIN, STATE_MAX, 0, "", "what is low-passed")]
    bound: Annotated[
        list[i32], 10, F(0, STATE_MAX, 0, "", "what the model may be wrong by, fading; mean steps")
    ]
    evidence: Annotated[list[i32], 16, F(0, 10000, 0, "", "samples beyond it without a break")]

    # observer
    x: Annotated[list[i32], N_STATES, F(STATE_MIN, STATE_MAX, 0, "", "corrected estimate")]
    work: Annotated[list[i32], N_ORDER, F(STATE_MIN, STATE_MAX, 0, "", "scratch")]
    ahead: Annotated[list[i32], N_STATES, F(STATE_MIN, STATE_MAX, 0, "", "predicted estimate")]
    covariance: Annotated[
        list[list[i32]], N_STATES, N_STATES, F(STATE_MIN, STATE_MAX, 24, "", "symmetric")
    ]
    ring: Annotated[
        list[i32],
        N_RING,
        F(STATE_MIN, STATE_MAX, Q_MOMENT, "N·m", "moments of the sent commands"),
    ]
    offset_rate: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_RATE, "rad/s", "learnt, roll rate")]
    offset_acceleration: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "learnt, lateral acceleration")
    ]
    steering_acceleration: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "a_y from speed and steering")
    ]
    gain_factor: Annotated[i32, F(0, ONE, 28, "", "of the schedule at this speed, with fading")]
    front_share: Annotated[i32, F(0, ONE, Q_UNIT, "", "of the schedule at this speed")]

    # identification
    theta: Annotated[list[i32], 2, F(0, STATE_MAX, 28, "", "stiffness, damping over nominal")]
    rls_covariance: Annotated[list[i32], 3, F(STATE_MIN, STATE_MAX, 20, "", "11, 12, 22")]
    rls_integrals: Annotated[list[i32], 2, F(STATE_MIN, STATE_MAX, 20, "", "over the window")]
    rls_history: Annotated[
        list[list[i32]],
        2,
        10,
        F(-WINDOW_MAX, WINDOW_MAX, 20, "", "stiffness; impulse less change of momentum"),
    ]
    rls_last: Annotated[list[i32], 2, F(STATE_MIN, STATE_MAX, 0, "", "rate Q27, impulse Q20")]
    rls_washed: Annotated[
        list[i32], 5, F(STATE_MIN, STATE_MAX, 0, "", "rate, impulse; twice: and roll")
    ]
    model: Annotated[
        list[list[i32]],
        2,
        4,
        F(-COEFFICIENT, COEFFICIENT, 0, "", "roll, rate, a_y, moment: identified phi, gamma"),
    ]

    # control
    compensator_x: Annotated[list[i32], N_ORDER, F(STATE_MIN, STATE_MAX, 24, "", "state")]
    moment: Annotated[i32, F(STATE_MIN, STATE_MAX, Q_MOMENT, "N·m", "before trigger and split")]
    outputs: Annotated[
        list[i32], 2, F(STATE_MIN, STATE_MAX, Q_MOMENT, "", "of a law with two outputs")
    ]
    held: Annotated[
        list[i32], 2, F(STATE_MIN, STATE_MAX, Q_MOMENT, "", "outputs when the law left or came")
    ]

    # trigger
    sent: Annotated[list[i32], 2, F(STATE_MIN, STATE_MAX, Q_MOMENT, "", "last command sent")]
    unacknowledged: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "waiting without a new echo since")]
    since_sent: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "since the last command")]
    commands_sent: Annotated[i32, F(0, I32_MAX, 0, "", "commands sent, saturates")]
    since_status: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "since the last status frame")]

    # safety envelope
    guarded: Annotated[
        list[i32], 2, F(STATE_MIN, STATE_MAX, Q_MOMENT, "", "outputs within the envelope")
    ]
    lateral_slow: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_ACCELERATION, "m/s2", "lateral acceleration, low-passed")
    ]
    outward_ticks: Annotated[i32, F(0, AGE_MAX, 0, "ticks", "the body has been pushed outward")]

    # allocation
    given: Annotated[
        i32, F(STATE_MIN, STATE_MAX, Q_MOMENT, "N·m", "moment within the actuators' limits")
    ]
    force: Annotated[
        list[i32], 4, F(-4090 << Q_MOMENT, 4090 << Q_MOMENT, Q_MOMENT, "N", "of each corner")
    ]
    bar: Annotated[
        list[i32], 2, F(-8191 << Q_MOMENT, 8191 << Q_MOMENT, Q_MOMENT, "N·m", "of each bar")
    ]
    current: Annotated[
        list[i32], 4, F(-16382 << Q_MOMENT, 16382 << Q_MOMENT, Q_MOMENT, "mA", "dampers, valves")
    ]

    # mailboxes: receive() writes one side of a slot, tick() reads the other
    rx_payload: Annotated[
        list[list[u8]], 2 * N_FRAMES, RX_BYTES, F(0, 255, 0, "", "slot 2 m + side", True)
    ]
    rx_fresh: Annotated[list[u8], 2 * N_FRAMES, F(0, 1, 0, "", "1: not read yet", True)]
    rx_side: Annotated[list[u8], N_FRAMES, F(0, 1, 0, "", "side that receive() writes", True)]
    rx_own: Annotated[u8, F(0, N_TX, 0, "", "1 + slot of ours that somebody else has sent", True)]
    tx_payload: Annotated[list[list[u8]], N_TX, TX_BYTES, F(0, 255, 0, "", "bytes to send")]
    tx_pending: Annotated[list[u8], N_TX, F(0, 1, 0, "", "1: to be sent; the sender clears it")]
    tx_counter: Annotated[list[u8], N_TX, F(0, COUNTER_MAX, 0, "", "E2E counter of the last frame")]

    # E2E receivers
    e2e_last: Annotated[
        list[u8], N_FRAMES, F(0, COUNTER_MAX, 0, "", "last valid counter, all bits set: none yet")
    ]
    e2e_delta: Annotated[list[u8], N_FRAMES, F(0, 15, 0, "", "counter step accepted now")]
    e2e_repeated: Annotated[list[u8], N_FRAMES, F(0, 14, 0, "", "checks without new data")]
    e2e_resync: Annotated[
        list[u8], N_FRAMES, F(0, 14, 0, "", "good frames still needed to resynchronise")
    ]

    # inputs: the last valid ones, in internal formats
    fresh: Annotated[
        list[u8], N_RX, F(0, 127, 0, "", "bit i: a new sample of signal i; 6: the first frame")
    ]
    valid: Annotated[
        list[u8], N_RX, F(0, 255, 0, "", "bit i: signal i has a value; 7: disagreement")
    ]
    imu_sample: Annotated[u8, F(0, 15, 0, "", "sample counter of the Imu frame")]
    motion_sample: Annotated[u8, F(0, 15, 0, "", "sample counter of VehicleMotion")]
    rate_sample: Annotated[u8, F(0, 15, 0, "", "sample counter of SuspensionRate")]
    status: Annotated[list[u8], 4, F(0, 3, 0, "", "corner: 0 ok 1 limited 2 stuck 3 floating")]
    enabled: Annotated[u8, F(0, 1, 0, "", "1: the actuators follow commands")]
    command_held: Annotated[u8, F(0, 1, 0, "", "1: the actuators hold a command")]
    accepted_counter: Annotated[u8, F(0, 255, 0, "", "echo of the accepted command")]
    actuator_sample: Annotated[u8, F(0, 15, 0, "", "sample counter of ActuatorState")]
    reference_sample: Annotated[u8, F(0, 15, 0, "", "sample counter of RollReference")]

    # supervision
    last_sample: Annotated[list[u8], N_FRAMES, F(0, 16, 0, "", "sample counter, 16: none yet")]
    mode: Annotated[u8, F(0, 3, 0, "", "0 INIT 1 ACTIVE 2 DEGRADED 3 SAFE")]
    lateral_lost: Annotated[u8, F(0, 1, 0, "", "1: do without the lateral acceleration")]
    motion_lost: Annotated[u8, F(0, 1, 0, "", "1: do without speed and steering")]
    speed_fell: Annotated[u8, F(0, 1, 0, "", "1: faster than brakes can; the last one is kept")]
    moment_unknown: Annotated[u8, F(0, 1, 0, "", "1: do without the delivered moment")]
    failed: Annotated[list[u8], 4, F(0, 1, 0, "", "1: stuck, floating or contradicting commands")]
    fault_count: Annotated[list[u8], N_FAULT_CODES, F(0, 255, 0, "", "occurrences")]
    fault_number: Annotated[u8, F(0, 15, 0, "", "active codes, 15 for more")]
    law: Annotated[u8, F(0, 2, 0, "", "of the calibration, for the status frame")]

    # redundancy monitor
    unit_away: Annotated[u8, F(0, 1, 0, "", "1: it turned away from where the car was steered")]

    # samples monitor
    clock_off: Annotated[u8, F(0, 1, 0, "", "1: the inertial unit's rate is off")]
    erratic_known: Annotated[list[u8], 5, F(0, 3, 0, "", "samples in a row")]
    sample_count: Annotated[list[u8], 2, F(0, 15, 0, "", "sample counter of the last sample")]

    # residuals
    contradicted: Annotated[
        u8,
        F(0, 31, 0, "", "bits: roll rate, a_y, inertial unit, front, rear axle"),
    ]
    side: Annotated[list[u8], 5, F(0, 1, 0, "", "of a balance of moments, 1: negative")]
    rolling_known: Annotated[u8, F(0, 1, 0, "", "1: the rates were measured in the last tick")]
    response_known: Annotated[
        u8, F(0, 2, 0, "", "all that acts was known in the last tick; 2: and since calm running")
    ]
    axles_known: Annotated[u8, F(0, 1, 0, "", "1: the axles were compared in the last tick")]

    # observer
    ring_head: Annotated[u8, F(0, N_RING - 1, 0, "", "newest entry of the ring")]

    # identification
    rls_index: Annotated[u8, F(0, 9, 0, "", "oldest entry of the history")]
    rls_count: Annotated[u8, F(0, 20, 0, "ticks", "since the last identification step")]
    rls_filled: Annotated[u8, F(0, 200, 0, "", "steps since the start of window and filters")]

    # safety envelope
    outward_cut: Annotated[u8, F(0, 1, 0, "", "1: no moment outward")]
    envelope_acted: Annotated[u8, F(0, 1, 0, "", "1: the command was changed in the last tick")]

    # trigger
    sent_time: Annotated[list[u8], N_SENT, F(0, 255, 0, "ticks", "when the last commands went out")]
    sent_last: Annotated[u8, F(0, N_SENT - 1, 0, "", "the newest of them")]
    waiting: Annotated[u8, F(0, 1, 0, "", "1: the last command is not acknowledged yet")]
    echo: Annotated[u8, F(0, 255, 0, "", "counter acknowledged last, 255: none")]
    triggered: Annotated[u8, F(0, 2, 0, "", "this tick: 0 nothing, 1 trigger, 2 heartbeat")]
    diagnostics_page: Annotated[u8, F(0, 255, 0, "", "number of the next page to send")]
