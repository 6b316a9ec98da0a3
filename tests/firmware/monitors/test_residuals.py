"""The bank of residuals: its filters in float64, its thresholds, counts and signatures."""

from dataclasses import dataclass, field

import numpy as np
import pytest
import rig
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware import calibration as fw
from firmware.monitors import residuals
from firmware.monitors.residuals import (
    GYRO,
    LATERAL,
    LINEAR,
    MOMENT,
    MOTION,
    OFF_STOPS,
    ON_ROAD,
    ROUND,
    STROKE,
    YAW,
    watch_residuals,
)
from firmware.state import (
    FIRST_FRAME,
    GYRO_BIAS,
    RX_ACTUATOR_STATE,
    RX_IMU,
    RX_SUSPENSION_RATE,
    Ecu,
)

NEWTON = 2**fw.Q_MOMENT
DIRECT, INTEGRAL, DERIVATIVE, STEP = range(4)
LATERAL_INPUT, TURNING_INPUT = 6, 7
TICKS = 7
FLOOR = 50.0
FADE = 0.025
EVERY = GYRO | LATERAL | YAW | MOTION | STROKE | MOMENT


@dataclass(frozen=True)
class Part:
    """A part in plain numbers: N·m per m/s², shares a round."""

    kind: int
    gain: float = 100.0
    wash: float = 0.0
    low: float = 1.0


@dataclass(frozen=True)
class Row:
    """A residual of (part, sign, weight)."""

    terms: tuple[tuple[int, int, float], ...]
    needs: int = LATERAL
    bit: int = 1
    floor: float = FLOOR


@dataclass(frozen=True)
class Pattern:
    """A signature."""

    same: int
    wrong: int
    opposite: int = 0
    absent: int = 0
    ticks: int = 1


def bank(
    parts: list[Part], rows: list[Row], patterns: tuple[Pattern, ...] = (), *, inputs=LATERAL_INPUT
) -> fw.Calibration:
    """A calibration with these residuals alone, all of the lateral acceleration."""
    cal = rig.calibration(actuator=fw.BARS)
    cal.timeout_ticks[RX_SUSPENSION_RATE] = 5
    kinds = [part.kind for part in parts]
    assert kinds == sorted(kinds)
    cal.part_end = [sum(kind <= k for kind in kinds) for k in range(4)]
    for k, part in enumerate(parts):
        cal.part_input[k] = [inputs, inputs]
        cal.part_gain[k] = [round(part.gain * 2**10), 0]
        cal.part_wash[k], cal.part_pass[k] = round(part.wash * 2**30), round(part.low * 2**30)
    cal.residual_linear = cal.residual_on_road = cal.residual_off_stops = fw.STATE_MAX
    cal.residual_fade = [round(FADE * 2**30)] * fw.N_RESIDUALS
    end = 0
    for k, row in enumerate(rows):
        for part, sign, weight in row.terms:
            cal.term_part[end], cal.term_sign[end] = part, sign + 1
            cal.term_weight[end] = round(weight * 64)
            end += 1
        cal.residual_end[k:] = [end] * (fw.N_RESIDUALS - k)
        cal.residual_needs[k], cal.residual_bit[k] = row.needs, row.bit
        cal.residual_floor[k] = round(row.floor * NEWTON)
        cal.residual_ticks[k] = TICKS
    for k, pattern in enumerate(patterns):
        cal.signature_same[k], cal.signature_opposite[k] = pattern.same, pattern.opposite
        cal.signature_absent[k], cal.signature_ticks[k] = pattern.absent, pattern.ticks
        cal.signature_wrong[k] = pattern.wrong
    return cal


def moving(cal: fw.Calibration) -> Ecu:
    """An ECU of a moving car with every input, whose actuators follow commands."""
    ecu = rig.started(cal)
    ecu.gain_factor, ecu.motion_lost, ecu.moment_unknown = 1 << 28, 0, 0
    ecu.enabled = ecu.command_held = 1
    ecu.valid[RX_IMU], ecu.valid[RX_SUSPENSION_RATE], ecu.valid[RX_ACTUATOR_STATE] = 7, 15, 3
    return ecu


def feed(ecu: Ecu, cal: fw.Calibration, *lateral: float) -> None:
    """Rounds with these lateral accelerations, m/s²."""
    for value in lateral:
        ecu.lateral_acceleration = round(value * 2**fw.Q_ACCELERATION)
        for _ in range(ROUND):
            watch_residuals(ecu, cal, 1)


@dataclass
class Floats:
    """The parts and one threshold in float64, written from their equations."""

    parts: list[Part]
    terms: tuple[tuple[int, int, float], ...]
    memory: np.ndarray = field(init=False)
    slow: np.ndarray = field(init=False)
    value: np.ndarray = field(init=False)
    started: bool = False
    quick: float = 0.25
    room: float = 0.0

    def __post_init__(self) -> None:
        self.memory = np.zeros(len(self.parts))
        self.slow = np.zeros(len(self.parts))
        self.value = np.zeros(len(self.parts))

    def round(self, lateral: float) -> None:
        if not self.started:
            self.started = True
            for k, part in enumerate(self.parts):
                first = part.gain * lateral
                if part.wash and part.kind in (DIRECT, DERIVATIVE):
                    self.memory[k] = -first
                elif part.kind == DERIVATIVE:
                    self.slow[k] = first
                elif part.kind == STEP:
                    self.memory[k] = first
            return
        self.quick *= 7.0 / 8.0
        for k, part in enumerate(self.parts):
            x = part.gain * lateral
            wash = max(part.wash, self.quick) if part.wash else 0.0
            if part.kind == INTEGRAL:
                self.slow[k] += part.low * (self.memory[k] - self.slow[k])
                self.memory[k] += x - wash * self.memory[k]
                self.value[k] = self.slow[k]
            elif part.kind != STEP:
                seen = self.memory[k] + x
                self.memory[k] -= wash * seen
                self.slow[k] += part.low * (seen - self.slow[k])
                self.value[k] = self.slow[k] if part.kind == DIRECT else seen - self.slow[k]
            else:
                step = abs(x - self.memory[k])
                self.memory[k] = x
                self.value[k] += max(part.low, self.quick) * (step - self.value[k])
        size = sum(weight * abs(self.value[part]) for part, _, weight in self.terms)
        self.room = max(size, self.room * (1.0 - FADE))

    @property
    def left(self) -> float:
        return sum(sign * self.value[part] for part, sign, _ in self.terms)


PARTS = [
    Part(DIRECT, 100.0, 0.05, 0.2),
    Part(DIRECT, -80.0, 0.0, 0.3),
    Part(INTEGRAL, 5.0, 0.01, 0.2),
    Part(DERIVATIVE, 300.0, 0.0, 0.2),
    Part(DERIVATIVE, 250.0, 0.03, 0.2),
    Part(STEP, 100.0, 0.0, 0.01),
]
TERMS = ((0, 1, 0.5), (1, -1, 0.25), (2, 1, 0.25), (3, -1, 1.0), (4, 1, 0.5), (5, 0, 2.0))


def test_parts_and_thresholds_are_those_of_their_equations():
    rng = np.random.default_rng(5)
    lateral = 2.0 * np.cumsum(rng.standard_normal(400)) / 20.0 + 0.3 * rng.standard_normal(400)
    cal = bank(PARTS, [Row(TERMS)])
    ecu, floats = moving(cal), Floats(PARTS, TERMS)
    for value in lateral:
        feed(ecu, cal, value)
        floats.round(value)
        values = np.array(ecu.part[: len(PARTS)]) / NEWTON
        np.testing.assert_allclose(values, floats.value, atol=0.1, rtol=1e-4)
        assert ecu.residual_room[0] / NEWTON == pytest.approx(floats.room, abs=2.0, rel=0.01)


def test_a_constant_is_washed_out_and_no_step_of_the_start():
    cal = bank([Part(DIRECT, wash=0.05, low=0.2)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    feed(ecu, cal, *[9.0] * 200)
    assert ecu.part[0] == 0
    feed(ecu, cal, *[12.0] * 3)
    assert ecu.part[0] > 0


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("lateral", "ticks"), [(0.49, None), (0.51, TICKS), (0.99, TICKS), (1.01, (TICKS + 1) // 2)]
)
def test_beyond_its_threshold_to_one_side_for_its_time_it_is_raised(side, lateral, ticks):
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    raised = None
    feed(ecu, cal, 0.0)
    for number in range(1, 3 * TICKS):
        feed(ecu, cal, side * lateral)
        if raised is None and ecu.residual_count[0] == side * TICKS:
            raised = number
    assert raised == ticks


def test_what_bounces_counts_anew():
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    feed(ecu, cal, 0.0)
    for _ in range(5):
        feed(ecu, cal, *[0.6] * (TICKS - 1), *[-0.6] * (TICKS - 1))
        assert abs(ecu.residual_count[0]) == TICKS - 1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=40), st.integers(0, 2**30))
def test_a_mirrored_car_is_judged_as_its_image(values, seed):
    rng = np.random.default_rng(seed)
    parts = [Part(part.kind, float(rng.uniform(-500, 500)), part.wash, part.low) for part in PARTS]
    cal = bank(parts, [Row(TERMS)], (Pattern(1, residuals.WRONG_RATE),))
    # exact mirrors: fields round halves upwards, so that images may differ by their last bits
    one, other = moving(cal), moving(cal)
    feed(one, cal, *values)
    feed(other, cal, *[-value for value in values])
    size = max(1, *(abs(part) for part in one.part))
    for mine, its in zip(one.part[:5], other.part[:5], strict=True):
        assert abs(mine + its) <= 16 + size * 2**-20
    assert abs(one.residual_room[0] - other.residual_room[0]) <= 2**13


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=60),
    st.floats(-0.19, 0.19),
)
def test_a_gain_within_its_weight_is_never_raised(values, error):
    """Two measurements of one motion, whose gain is off by less than the stated share."""
    parts = [Part(DIRECT, 100.0 * (1.0 + error), 0.05, 0.2), Part(DIRECT, 100.0, 0.05, 0.2)]
    cal = bank(parts, [Row(((0, 1, 0.0), (1, -1, 0.2)), floor=2.0)])
    ecu = moving(cal)
    for value in values:
        feed(ecu, cal, value)
        assert ecu.residual_count[0] == 0


@pytest.mark.parametrize(
    ("raised", "found"),
    [
        ((0.6, 0.6), (1, 0)),
        ((0.6, -0.6), (0, 1)),
        ((-0.6, -0.6), (1, 0)),
        ((-0.6, 0.6), (0, 1)),
        ((0.6, 0.0), (1, 1)),
        ((0.0, 0.6), (0, 0)),
    ],
)
def test_two_residuals_and_their_sides_name_the_axle(raised, found):
    patterns = (
        Pattern(1 | 2, residuals.WRONG_FRONT),
        Pattern(1, residuals.WRONG_REAR, opposite=2),
        Pattern(1, residuals.WRONG_FRONT | residuals.WRONG_REAR, ticks=3),
    )
    parts = [Part(DIRECT), Part(DIRECT)]
    rows = [Row(((0, 1, 0.0),), MOMENT, bit=1), Row(((1, 1, 0.0),), MOMENT, bit=2)]
    cal = bank(parts, rows, patterns)
    cal.part_input[1] = [10, 10]
    cal.part_gain[1] = [round(100.0 * 2**7), 0]
    ecu = moving(cal)
    ecu.yaw_rate = round(raised[1] * 2**fw.Q_RATE)
    feed(ecu, cal, *[raised[0]] * (TICKS + 4))
    assert tuple(ecu.contradicted) == found


def test_what_is_raised_to_the_same_side_may_exclude_a_signature():
    rows = [Row(((0, 1, 0.0),), bit=1), Row(((0, 1, 0.0),), bit=2, floor=70.0)]
    cal = bank([Part(DIRECT)], rows, (Pattern(1, residuals.WRONG_RATE, absent=2),))
    ecu = moving(cal)
    feed(ecu, cal, *[0.8] * 3 * TICKS)
    assert ecu.rate_contradicted == 0
    feed(ecu, cal, *[0.6] * 3 * TICKS)
    assert ecu.rate_contradicted == 1


def test_a_finding_ends_the_trust_in_what_is_wrong():
    row = Row(((0, 1, 0.0),), needs=MOMENT)
    cal = bank([Part(DIRECT)], [row], (Pattern(1, residuals.WRONG_FRONT),))
    ecu = moving(cal)
    feed(ecu, cal, 0.0, *[0.6] * TICKS)
    assert ecu.contradicted == [1, 0]
    feed(ecu, cal, 0.6)
    assert ecu.residual_count[0] == 0
    feed(ecu, cal, *[0.0] * 50)
    assert ecu.contradicted == [1, 0]


@pytest.mark.parametrize(
    ("state", "missing"),
    [
        ({"gain_factor": 0}, EVERY),
        ({"unchanged": [6, 0, 0, 0, 0]}, EVERY),
        ({"valid": [5, 3, 15, 3, 7]}, LATERAL),
        ({"lateral_lost": 1}, LATERAL),
        ({"motion_lost": 1}, MOTION),
        ({"valid": [7, 3, 7, 3, 7]}, STROKE),
        ({"unchanged": [0, 0, 6, 0, 0]}, STROKE),
        ({"valid": [7, 3, 15, 1, 7]}, MOMENT),
        ({"moment_unknown": 1}, MOMENT),
        ({"enabled": 0}, MOMENT),
        ({"command_held": 0}, MOMENT),
        ({"contradicted": [0, 1]}, MOMENT),
    ],
)
def test_only_what_is_known_new_and_not_found_wrong_is_trusted(state, missing):
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    feed(ecu, cal, 0.0)
    assert ecu.residual_trust == EVERY
    for name, value in state.items():
        setattr(ecu, name, value)
    feed(ecu, cal, 0.0)
    assert ecu.residual_trust == EVERY & ~missing


@pytest.mark.parametrize(
    "interrupted", [lambda ecu: setattr(ecu, "lateral_lost", 1), None], ids=["input", "tick"]
)
def test_a_missed_tick_or_a_returning_input_starts_anew(interrupted):
    cal = bank([Part(DIRECT, wash=0.001)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    feed(ecu, cal, *[0.0] * 100, *[0.6] * (TICKS - 1))
    assert ecu.residual_count[0] == TICKS - 1
    if interrupted is not None:
        interrupted(ecu)
        feed(ecu, cal, 0.6)
        ecu.lateral_lost = 0
        feed(ecu, cal, 0.6)
    else:
        watch_residuals(ecu, cal, 2)
        feed(ecu, cal, 0.6)
    assert ecu.residual_count[0] == 0
    assert ecu.part[0] == 0


@pytest.mark.parametrize(
    ("name", "bit"), [("linear", LINEAR), ("on_road", ON_ROAD), ("off_stops", OFF_STOPS)]
)
def test_beyond_its_range_it_rests(name, bit):
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),), needs=LATERAL | bit)])
    setattr(cal, f"residual_{name}", 5 << fw.Q_ACCELERATION)
    cal.lean_max = fw.STATE_MAX
    ecu = moving(cal)
    ecu.motion_peak = (5 << fw.Q_ACCELERATION) + 1
    feed(ecu, cal, *[9.0] * 20)
    assert ecu.residual_count[0] == 0
    ecu.motion_peak -= 1
    feed(ecu, cal, 9.0)
    assert ecu.residual_count[0] == 2


def test_a_body_seen_on_its_stops_is_off_them_where_none_would_be():
    parts = [Part(DIRECT), Part(DIRECT, gain=1.0)]
    cal = bank(parts, [Row(((0, 1, 0.0),), needs=LATERAL | OFF_STOPS)])
    cal.lean_part, cal.lean_max = 1, round(5.0 * NEWTON)
    cal.residual_off_stops = 3 << fw.Q_ACCELERATION
    ecu = moving(cal)
    feed(ecu, cal, 0.0)
    # curves that a stiff body takes without leaning as far
    ecu.motion_peak = 6 << fw.Q_ACCELERATION
    feed(ecu, cal, *[4.9] * 3)
    assert ecu.residual_count[0] == 6
    feed(ecu, cal, 5.1)
    assert ecu.residual_count[0] == 0
    feed(ecu, cal, *[4.9] * 50)
    assert ecu.residual_count[0] == 0
    ecu.motion_peak = 3 << fw.Q_ACCELERATION
    feed(ecu, cal, 4.9)
    assert ecu.residual_count[0] == 2


def test_a_start_in_a_curve_may_be_on_the_stops():
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),), needs=LATERAL | OFF_STOPS)])
    cal.lean_max, cal.residual_off_stops = fw.STATE_MAX, 3 << fw.Q_ACCELERATION
    ecu = moving(cal)
    ecu.motion_peak = 4 << fw.Q_ACCELERATION
    feed(ecu, cal, *[9.0] * 20)
    assert ecu.residual_count[0] == 0


def test_parts_advance_in_one_tick_and_are_judged_in_the_next():
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    feed(ecu, cal, 0.0)
    ecu.lateral_acceleration = round(0.6 * 2**fw.Q_ACCELERATION)
    watch_residuals(ecu, cal, 1)
    assert (ecu.part[0] > 0, ecu.residual_count[0]) == (True, 0)
    ecu.lateral_acceleration = 0
    watch_residuals(ecu, cal, 1)
    assert (ecu.part[0] > 0, ecu.residual_count[0]) == (True, 1)


def test_inputs_are_what_they_are_called():
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    ecu.stroke_rate = [1, 20, 300, 4000]
    ecu.fresh[RX_SUSPENSION_RATE], ecu.rate_sample = FIRST_FRAME, 1
    ecu.delivered = [5, 6]
    ecu.lateral_acceleration, ecu.steering_acceleration = 7, 8
    ecu.roll_rate, ecu.yaw_rate = 9, 10 << 20
    ecu.speed, ecu.x[GYRO_BIAS] = 3 << fw.Q_SPEED, 11
    watch_residuals(ecu, cal, 1)
    turning = (10 << 20) * 3 >> 3
    expected = [-19, -3700, 21, 4300, 5, 6, 7, turning, 8, 9, 10 << 20, 11]
    assert ecu.residual_input[:12] == expected
    assert ecu.residual_input[TURNING_INPUT] == turning


@pytest.mark.parametrize("steps", [[1] * 8, [0, 2, 1, 1, 0, 2, 1, 1], [0, 0, 3, 0, 1, 2, 0, 2]])
def test_a_stroke_is_the_sum_of_its_samples_whenever_they_come(steps):
    """Of a rate that changes evenly nothing is lost with its samples."""
    cal = bank([Part(DIRECT)], [Row(((0, 1, 0.0),))])
    ecu = moving(cal)
    rates = [1000 * (k + 1) for k in range(9)]
    cal.part_end, cal.part_input[0] = [0, 1, 1, 1], [residuals.SUMMED, residuals.SUMMED]
    cal.part_gain[0] = [1 << residuals.GAIN_BITS, 0]
    sample = 0
    ecu.stroke_rate[0], ecu.rate_sample, ecu.fresh[RX_SUSPENSION_RATE] = rates[0], 0, FIRST_FRAME
    ecu.residual_input[0] = rates[0]
    for _ in range(2 * ROUND):
        watch_residuals(ecu, cal, 1)
    for step in (*steps, 0):
        sample += step
        ecu.fresh[RX_SUSPENSION_RATE] = FIRST_FRAME if step else 0
        ecu.stroke_rate[0], ecu.rate_sample = rates[sample], sample
        watch_residuals(ecu, cal, 1)
    assert ecu.part_memory[0] == sum(rates[1:])


def test_a_calibration_without_residuals_costs_nothing_and_finds_nothing():
    cal = rig.calibration()
    ecu = moving(cal)
    feed(ecu, cal, *[9.0] * 20)
    assert ecu.residual_trust == 0
    assert ecu.part == [0] * fw.N_PARTS
