"""The monitors' balances against their equations in float64, on samples that follow no car."""

from dataclasses import dataclass, field

import numpy as np
import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware.monitors import axles, response, rolling
from canroll.firmware.monitors import residual as rows
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_IMU, RX_SUSPENSION_RATE, Ecu

PASS, QUICK, SLOW, OF_AXLES = 0.2, 0.05, 0.0008, 0.0126
FADING = PASS / 8.0
STROKE, STRETCH, ARM, INERTIA = (1800.0, 1300.0), 0.05, 595.0, 10_000.0
SHARES = 0.4, 0.2, 0.15, 0.1, 0.3
"""Of side force, springs, dampers, moments and inertia that may be wrong."""
OF_AXLE = 0.35
"""Of an axle's moment."""
LIMIT_SHARES = 0.75, 0.25
OF_FORCE, OF_MOMENTS, OF_SHOWN = (0.875, 0.01), 0.25, (0.625, 0.5, 0.3)
ROUGH = 900.0, 500.0
KNEE, FAST = 0.1, (1200.0, 800.0)
AXLES_STRETCH, AXLES_DAMPING, AXLES_ROUGH = (900.0, 700.0), (2.5, 2.0), 2.0
AXLES_SIDE = 40.0
REAR, AT_CENTRES, YAW = 1.2, -150.0, 4000.0
HEAVE_STRETCH = (300.0, 250.0)
TRACK, ROLLING_SHARE, TYRES = (0.6, 0.65), 0.25, 4e-5
FILTERS = tuple(row for row in range(10) if row not in (rows.STEADY, rows.ROLLING))
WASHED = (rows.STEADY, rows.FRONT, rows.REAR, rows.CENTRES, rows.DAMPER_STEPS, rows.HEAVE_STEPS)
TICKS = 300
LEAST = 1.0
"""What a balance may always have left over, N·m."""
CALM, CALM_TICKS = 16_000.0, 20
"""The slow balances are judged once less is left for so many ticks, N·m."""
NEVER = 1000
"""Ticks after which a monitor accuses: more than there are samples."""


def watched() -> fw.Calibration:
    """A calibration with all balances on, which finds no axle in time."""
    cal = rig.calibration(actuator=fw.BARS)
    cal.timeout_ticks[RX_SUSPENSION_RATE] = 5
    cal.response_min, cal.response_limit = round(LEAST * 2**fw.Q_MOMENT), 3 << fw.Q_ACCELERATION
    cal.response_ticks, cal.axles_ticks = CALM_TICKS, NEVER
    cal.rolling_ticks = cal.heave_ticks = NEVER
    cal.steady_min = round(2.0 * CALM * 2**fw.Q_MOMENT)
    cal.response_share = shares(*SHARES, OF_AXLE)
    cal.limit_share = shares(*LIMIT_SHARES)
    cal.steady_share, cal.lateral_share = shares(*OF_FORCE, OF_MOMENTS), shares(*OF_SHOWN)
    cal.response_rough = [round(value * 2**10) for value in ROUGH]
    cal.response_knee = round(KNEE * 2**fw.Q_RATE)
    cal.response_fast = [round(value * 2**10) for value in FAST]
    cal.response_stroke = [round(value * 2**10) for value in STROKE]
    cal.response_stretch = round(STRETCH * 2**30)
    cal.response_lateral, cal.response_inertia = round(ARM * 2**10), round(INERTIA * 2**10)
    cal.response_pass = round(PASS * 2**30)
    cal.response_wash = [round(wash * 2**30) for wash in (QUICK, SLOW, OF_AXLES)]
    cal.axles_min, cal.axles_rest = 1 << fw.Q_MOMENT, 10_000 << fw.Q_MOMENT
    cal.axles_limit = 7 << fw.Q_ACCELERATION
    cal.axles_stretch = [round(value * 2**10) for value in AXLES_STRETCH]
    cal.axles_damping = [round(value * 2**10) for value in AXLES_DAMPING]
    cal.axles_rough = round(AXLES_ROUGH * 2**10)
    cal.axles_side = round(AXLES_SIDE * 2**10)
    cal.axles_rear = round(REAR * 2**28)
    cal.axles_lateral, cal.axles_yaw = round(AT_CENTRES * 2**10), round(YAW * 2**10)
    cal.heave_min = 1 << fw.Q_MOMENT
    cal.heave_stretch = [round(value * 2**10) for value in HEAVE_STRETCH]
    cal.rolling_min = 1 << fw.Q_RATE - 4
    cal.rolling_track = [round(value * 2**28) for value in TRACK]
    cal.rolling_tyres = round(TYRES * 2**30)
    cal.rolling_share = shares(ROLLING_SHARE)[0]
    return cal


def shares(*values: float) -> list[int]:
    return [round(value * 2**fw.Q_SHARE) for value in values]


@dataclass(slots=True)
class Sample:
    """What is measured in a tick, SI units."""

    strokes: np.ndarray
    delivered: np.ndarray
    lateral: float
    roll_rate: float
    yaw_rate: float
    at_the_limit: bool

    def put(self, ecu: Ecu) -> None:
        """Give it to the ECU."""
        ecu.stroke_rate = [round(value * 2**fw.Q_RATE) for value in self.strokes]
        ecu.delivered = [round(value * 2**fw.Q_MOMENT) for value in self.delivered]
        ecu.lateral_acceleration = round(self.lateral * 2**fw.Q_ACCELERATION)
        ecu.roll_rate = round(self.roll_rate * 2**fw.Q_RATE)
        ecu.yaw_rate = round(self.yaw_rate * 2**fw.Q_RATE)
        ecu.motion_peak = (4 if self.at_the_limit else 2) << fw.Q_ACCELERATION


def samples() -> list[Sample]:
    """Slow and fast parts of all signals, from rest; the second half is at the tyres' limit."""
    rng = np.random.default_rng(11)
    slow = np.cumsum(rng.standard_normal((TICKS, 9)), axis=0) / np.sqrt(TICKS)
    values = slow + 0.3 * rng.standard_normal((TICKS, 9))
    values[0] = 0.0
    return [
        Sample(0.3 * row[:4], 1500.0 * row[4:6], 3.0 * row[6], *(0.3 * row[7:9]), 2 * tick > TICKS)
        for tick, row in enumerate(values)
    ]


@dataclass(slots=True)
class Balance:
    """A balance in float64."""

    wash: float = QUICK
    spring: float = 0.0
    slow: float = 0.0
    past: float = 0.0
    uncertainty: float = 0.0

    def start(self, acting: float, momentum: float) -> None:
        self.spring, self.slow, self.past, self.uncertainty = -acting, -momentum, 0.0, 0.0

    def residual(self, acting: float, momentum: float) -> float:
        washed = self.spring + acting
        self.spring -= washed * self.wash
        self.slow += (washed - momentum - self.slow) * PASS
        return self.slow + momentum

    def new(self, value: float, fading: float = FADING) -> float:
        fresh = value - self.past
        self.past += fresh * fading
        return fresh

    def raise_threshold(self, size: float, fading: float) -> None:
        self.uncertainty = max(size, self.uncertainty * (1.0 - fading))


@dataclass(slots=True)
class Floats:
    """All balances in float64."""

    balances: list[Balance] = field(
        default_factory=lambda: [
            Balance({rows.HEAVE: SLOW, rows.AXLES: OF_AXLES}.get(which, QUICK))
            for which in range(15)
        ]
    )
    known: bool = False
    judged: bool = False
    calm: int = 0
    size: float = 0.0
    changing: float = 0.0
    rates: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def response(self, it: Sample) -> None:
        b, strokes = self.balances, it.strokes
        axle = np.array([strokes[0] - strokes[1], strokes[2] - strokes[3]])
        damping, moment = float(axle @ STROKE), float(it.delivered.sum())
        side, momentum = ARM * it.lateral, INERTIA * it.roll_rate
        acting = damping - moment - side
        if not self.known:
            b[rows.SIDE_FORCE].start(side, 0.0)
            b[rows.SPRINGS].start(0.0, 0.0)
            b[rows.DAMPERS].start(damping, 0.0)
            b[rows.ACTUATORS].start(moment, 0.0)
            b[rows.BODY].start(0.0, momentum)
            b[rows.LATERAL].start(acting, momentum)
            b[rows.STEADY].start(0.0, 0.0)
            b[rows.DAMPER_STEPS].past = damping
            b[rows.SPRINGS].uncertainty = 3.0 * ARM
        stretched = STRETCH * damping
        bumps = [abs(abs(strokes[2 * n]) - abs(strokes[2 * n + 1])) * ROUGH[n] for n in range(2)]
        fast = [max(abs(stroke) - KNEE, 0.0) for stroke in strokes]
        bumps += [(fast[2 * n] + fast[2 * n + 1]) * FAST[n] for n in range(2)]
        changed = b[rows.DAMPER_STEPS].new(damping, 1.0)
        b[rows.DAMPERS].uncertainty += (abs(changed) - b[rows.DAMPERS].uncertainty) / 1024.0
        slowly = b[rows.LATERAL].residual(acting, momentum)
        b[rows.LATERAL].spring += stretched
        by_force = b[rows.STEADY].new(side, b[rows.STEADY].wash)
        if self.judged:
            shown = slowly + by_force
            share = OF_SHOWN[0] if slowly * shown > 0.0 else OF_SHOWN[1]
            share += LIMIT_SHARES[1] if it.at_the_limit else 0.0
            by_moment = OF_SHOWN[2] * abs(moment)
            b[rows.LATERAL].raise_threshold(share * abs(shown) + by_moment, FADING)
            share = OF_FORCE[0] if slowly * by_force > 0.0 else OF_FORCE[1]
            wrong = share * abs(by_force) + OF_MOMENTS * abs(moment) + sum(bumps)
            b[rows.STEADY].raise_threshold(wrong, FADING)
        names = [rows.SIDE_FORCE, rows.SPRINGS, rows.DAMPERS, rows.ACTUATORS]
        inputs = [side, 0.0, damping, moment]
        parts = [b[name].residual(by, 0.0) for name, by in zip(names, inputs, strict=True)]
        inertia = b[rows.BODY].residual(0.0, momentum)
        b[rows.SPRINGS].spring += stretched
        wrong = float(np.abs([*parts, inertia]) @ SHARES) + sum(bumps)
        if it.at_the_limit:
            wrong += float(np.abs([inertia, parts[3]]) @ LIMIT_SHARES)
        b[rows.BODY].raise_threshold(wrong, FADING)
        b[rows.SPRINGS].raise_threshold(0.0, QUICK)
        left = inertia + parts[1] + parts[2] - parts[0] - parts[3]
        calm = b[rows.BODY].uncertainty + abs(left) < CALM
        self.calm = self.calm + 1 if calm else 0
        if self.calm == CALM_TICKS and not self.judged:
            self.judged = True
            b[rows.LATERAL].wash = b[rows.STEADY].wash = SLOW

    def axles(self, it: Sample) -> None:
        of_axles, strokes = self.balances[rows.AXLES], it.strokes
        front = AXLES_STRETCH[0] * (strokes[0] - strokes[1])
        behind = AXLES_STRETCH[1] * (strokes[2] - strokes[3])
        stretched = front - behind
        rear = REAR * it.delivered[1]
        acting = AXLES_DAMPING[0] * front - AXLES_DAMPING[1] * behind
        acting += AT_CENTRES * it.lateral + rear - it.delivered[0]
        momentum = YAW * it.yaw_rate
        judged = {
            rows.CENTRES: (AXLES_SIDE * it.lateral, 1.0),
            rows.FRONT: (it.delivered[0], OF_AXLE),
            rows.REAR: (rear, OF_AXLE),
        }
        if not self.known:
            of_axles.start(acting, momentum)
            for which, (value, _) in judged.items():
                self.balances[which].past = value
        of_axles.residual(acting, momentum)
        of_axles.spring += stretched
        wrong = AXLES_ROUGH * abs(stretched)
        for which, (value, share) in judged.items():
            wrong += share * abs(self.balances[which].new(value, OF_AXLES))
        of_axles.raise_threshold(wrong, OF_AXLES / 2.0)

    def heave(self, it: Sample) -> None:
        of_springs, strokes = self.balances[rows.HEAVE], it.strokes
        of_springs.residual(0.0, 0.0)
        moved = HEAVE_STRETCH[0] * (strokes[0] + strokes[1])
        moved += HEAVE_STRETCH[1] * (strokes[2] + strokes[3])
        of_springs.spring += moved
        step = abs(self.balances[rows.HEAVE_STEPS].new(moved, 1.0))
        of_springs.uncertainty += (step - of_springs.uncertainty) / 1024.0

    def rolling(self, it: Sample) -> None:
        front = TRACK[0] * (it.strokes[0] - it.strokes[1])
        rates = np.array([it.roll_rate, front, TRACK[1] * (it.strokes[2] - it.strokes[3])])
        moment = it.delivered.sum()
        if not self.known:
            self.rates, self.changing, self.size = rates.copy(), moment, 0.0
        self.rates += PASS * (rates - self.rates)
        changed = moment - self.changing
        self.changing += PASS * changed
        faded = self.size * (1.0 - FADING)
        now = ROLLING_SHARE * np.abs(self.rates[1:]).max() + abs(changed) * TYRES
        self.size = max(faded, now)


def in_newton_metres(values: list[int]) -> np.ndarray:
    return np.array(values) / 2**fw.Q_MOMENT


@pytest.fixture(scope="module")
def compared() -> list[tuple[np.ndarray, np.ndarray]]:
    """The monitors' states and those in float64, tick by tick."""
    cal = watched()
    ecu = rig.started(cal)
    ecu.gain_factor, ecu.motion_lost, ecu.moment_unknown = 1 << 28, 0, 0
    ecu.enabled = ecu.command_held = 1
    ecu.valid[RX_IMU], ecu.valid[RX_SUSPENSION_RATE], ecu.valid[RX_ACTUATOR_STATE] = 7, 15, 3
    floats = Floats()
    states = []
    for it in samples():
        it.put(ecu)
        rolling.watch_rolling(ecu, cal)
        response.watch_response(ecu, cal, 1)
        axles.watch_axles(ecu, cal)
        axles.watch_heave(ecu, cal)
        floats.rolling(it)
        floats.response(it)
        floats.axles(it)
        floats.heave(it)
        floats.known = True
        rolled = np.array(ecu.passed)[[rows.ROLLING, rows.FRONT, rows.REAR]]
        b = floats.balances
        ours = [ecu.past[row] for row in WASHED]
        momentum = {rows.LATERAL: rows.BODY, rows.AXLES: rows.YAW}
        left = {row: ecu.passed[row] for row in FILTERS} | {rows.BODY: -ecu.passed[rows.BODY]}
        left |= {row: left[row] - ecu.passed[by] for row, by in momentum.items()}
        ours += [part for row in FILTERS for part in (-ecu.past[row], left[row])]
        ours += [bound for row, bound in enumerate(ecu.bound) if row != rows.ROLLING]
        theirs = [b[row].past for row in WASHED]
        theirs += [part for row in FILTERS for part in (b[row].spring, b[row].slow)]
        theirs += [b[row].uncertainty for row in range(10) if row != rows.ROLLING]
        rates = np.array([*rolled, ecu.bound[rows.ROLLING]]) / 2**fw.Q_RATE
        states.append(
            (
                in_newton_metres(ours),
                np.array(theirs),
                np.array([*rates, ecu.past[rows.ROLLING] / 2**fw.Q_MOMENT]),
                np.array([*floats.rates, floats.size, floats.changing]),
            )
        )
    assert ecu.response_known == response.BOTH
    assert ecu.axles_known == ecu.rolling_known == 1
    return states


def test_balances_are_those_of_their_equations(compared):
    ours, floats = (np.array(part) for part in list(zip(*compared, strict=True))[:2])
    np.testing.assert_allclose(ours, floats, atol=2.0, rtol=1e-3)


def test_rates_are_those_of_their_equations(compared):
    ours, floats = (np.array(part) for part in list(zip(*compared, strict=True))[2:])
    np.testing.assert_allclose(ours, floats, atol=1e-4, rtol=1e-3)
