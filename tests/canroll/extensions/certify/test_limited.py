"""The loop with its limit of moment: judged by simulation, and what the checker must refuse."""

import copy
from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("flint")

from flint import fmpq
from scipy.linalg import expm
from support.certificates import DELAY, RESOLUTION, TICK, floats, integers_of, roll_model

from canroll.extensions.certify import checker
from canroll.extensions.certify.certificate import EVERY_TICK, LIMITED, LIMITED_TRIGGER
from canroll.extensions.certify.claim import Wish, prove


def wish(name, resolution=RESOLUTION):
    return Wish(name, DELAY, resolution, name == LIMITED_TRIGGER, name != EVERY_TICK)


@pytest.fixture(scope="module")
def claims(integers):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("canroll.extensions.certify.claim.CELLS", 64)
        found = {
            name: prove(integers, roll_model(), wish(name))
            for name in (EVERY_TICK, LIMITED, LIMITED_TRIGGER)
        }
    assert all(found.values())
    return found


class Loop:
    """The sampled loop written anew, without roundings: car, command before, cut, what it left."""

    def __init__(self, c, condition):
        flow = floats(condition["flow"])
        self.n, self.tick = len(flow), float(TICK)
        self.a, self.b = flow[:, : self.n], flow[:, self.n]
        gains = np.array(c["output_gain"][:2]) / 2.0 ** c["output_gain_shift"]
        points = slice(c["schedule_points"])
        factor = np.interp(
            condition["speed"], c["schedule_speed"][points], c["schedule_gain"][points]
        )
        self.law = factor / 2.0**28 * gains @ floats(condition["readings"])[:2]
        self.most, self.share = float(c["moment_max"]), c["trigger_epsilon_squared"] / 2.0**20
        self._held = {}

    def held(self, seconds):
        if seconds not in self._held:
            block = np.zeros((self.n + 1, self.n + 1))
            block[: self.n, : self.n], block[: self.n, self.n] = self.a, self.b
            self._held[seconds] = expm(block * seconds)
        return self._held[seconds]

    def after(self, state, delay, *, hold):
        """Return the state a tick later; a command that the trigger may hold is held if wished."""
        x, before = state[: self.n], state[self.n]
        wanted = self.law @ x
        left = np.clip(wanted, -self.most, self.most)
        kept = hold and (before - left) ** 2 <= self.share * before**2
        sent = before if kept else left
        for seconds, acting in ((delay, before), (self.tick - delay, sent)):
            x = (self.held(seconds) @ np.append(x, acting))[: self.n]
        return np.concatenate([x, [sent, left - wanted, left]])

    def started(self, draw, scale):
        """Return a state that limit and trigger can have led to."""
        x = draw.normal(size=self.n) * scale
        before = self.after(np.concatenate([x, np.zeros(3)]), 0.006, hold=False)
        return self.after(before, draw.uniform(0.004, 0.008), hold=draw.random() < 0.5)


def largest_growth(loop, p, *, trigger, states=slice(None), seed=1):
    """Return the largest V⁺/V along random and along greedily worst sequences, and the limited."""
    draw, worst, limited = np.random.default_rng(seed), 0.0, 0
    covariance = np.linalg.inv(p)[: loop.n, : loop.n]
    sizes = np.sqrt(np.diag(covariance))
    sizes *= loop.most / np.sqrt(loop.law @ covariance @ loop.law)

    def value(state):
        return state[states] @ p @ state[states]

    for number in range(60):
        state = loop.started(draw, sizes * 10.0 ** draw.uniform(-1.0, 2.0))
        for _ in range(40):
            tried = [
                loop.after(state, delay, hold=hold)
                for delay in (0.004, 0.006, 0.008)
                for hold in ((False, True) if trigger else (False,))
            ]
            growth = [value(each) / value(state) for each in tried]
            worst = max(worst, *growth)
            limited += abs(tried[0][-2]) > 0.0
            state = tried[int(np.argmax(growth)) if number % 2 else draw.integers(len(tried))]
    return worst, limited


@pytest.mark.parametrize("name", [LIMITED, LIMITED_TRIGGER])
def test_v_falls_as_proved_along_every_sequence(claims, integers, name):
    loop, claim = Loop(integers, roll_model()), claims[name]
    decay = float(Fraction(claim["decay"]))
    growth, limited = largest_growth(loop, floats(claim["p"]), trigger=name == LIMITED_TRIGGER)
    assert limited > 300
    assert 0.9 * decay < growth <= decay * (1.0 + 1e-9)


def test_without_the_multipliers_of_the_limit_v_need_not_fall_so_fast(claims, integers):
    """The judge above finds what is no proof: the matrix of the loop without the limit."""
    loop, claim = Loop(integers, roll_model()), claims[EVERY_TICK]
    growth, _ = largest_growth(loop, floats(claim["p"]), trigger=False, states=slice(0, loop.n + 1))
    assert growth > 1.005 * float(Fraction(claim["decay"]))


def refused(c, claim, condition=None, **about):
    """Whether the checker refuses a claim."""
    try:
        checker.proved(c, condition or roll_model(), claim | about, fmpq(1, 100))
    except (ValueError, IndexError):
        return True
    return False


@pytest.mark.parametrize("name", [LIMITED, LIMITED_TRIGGER])
def test_a_changed_multiplier_of_the_limit_is_refused(claims, integers, name):
    claim = claims[name]
    assert not refused(integers, claim)
    limit, p = claim["limit"], claim["p"]
    heaviest = max(range(len(limit)), key=lambda i: Fraction(limit[i]))

    def other(factor):
        new = copy.copy(limit)
        new[heaviest] = str(Fraction(limit[heaviest]) * factor)
        return new

    for changed in (other(-1), other(0), other(1000), limit[:-1], [*limit, "0"], [], ["0"] * 99):
        assert refused(integers, claim, limit=changed), changed
    for number in range(len(limit)):
        new = [*limit[:number], "-1/1000000000000000000000000000000", *limit[number + 1 :]]
        assert refused(integers, claim, limit=new), number
    # a matrix of fewer states: without what the limit cut off before, and what it left
    for left in (1, 2):
        assert refused(integers, claim, p=[row[:-left] for row in p[:-left]])
    without = {key: value for key, value in claim.items() if key != "limit"}
    with pytest.raises(KeyError):
        checker.proved(integers, roll_model(), without, fmpq(1, 100))


def test_other_claims_are_no_proof_of_the_limit(claims, integers):
    every = claims[EVERY_TICK]
    assert refused(integers, every | {"limit": ["0"] * 6}, limited=True)
    assert refused(integers, claims[LIMITED], trigger=True)
    assert refused(integers | {"moment_max": -1}, claims[LIMITED])
    assert refused(integers | {"compensator_outputs": 2}, claims[LIMITED])


def test_of_a_limit_of_nothing_the_car_alone_is_proved(integers):
    """Nothing is ever commanded: true of a car that is stable by itself, and of no other."""
    nothing = integers | {"moment_max": 0}
    claim = prove(nothing, roll_model(), wish(LIMITED))
    assert claim is not None
    assert refused(nothing, claim, roll_model(damping=-0.5))
    assert prove(nothing, roll_model(damping=-0.5), wish(LIMITED)) is None


def test_a_car_that_only_control_makes_stable_is_not_proved(claims, integers):
    """Negative damping: stable in the linear range, and from a large angle it grows without end."""
    condition = roll_model(damping=-0.3)
    assert prove(integers, condition, wish(EVERY_TICK)) is not None
    loop = Loop(integers, condition)

    roll = np.array([float(Fraction(text)) for text in condition["roll"]])

    def last(angle):
        state = np.append(angle * roll, np.zeros(3))
        for _ in range(1500):
            state = loop.after(state, 0.006, hold=False)
        return abs(loop.law @ state[: loop.n]) / loop.most

    assert last(0.01) < 1e-3
    assert last(100.0) > 100.0
    for name in (LIMITED, LIMITED_TRIGGER):
        assert prove(integers, condition, wish(name)) is None
        assert refused(integers, claims[name], condition)


def test_what_the_limit_leaves_of_the_output_drives_the_compensator(calibrated):
    """The firmware's own compensator against the checker's forms, far beyond the limit."""
    from canroll.codegen.run.memory_image import sealed
    from canroll.firmware.control_law import control
    from canroll.firmware.ecu import init
    from canroll.firmware.state import ACTIVE, Ecu

    record = copy.deepcopy(calibrated("steering_lead").record)
    record.slew_max = (1 << 30) - 1
    order = record.compensator_order
    y, past, cut = (checker.variables(kind, size) for kind, size in (("y", 3), ("u", 2), ("a", 1)))
    integers = integers_of(calibrated("steering_lead"))
    command, inner = checker.controller(integers, 1 << 28, y, past, [], cut=cut)
    ecu = Ecu()
    init(ecu, sealed(record))
    ecu.mode, ecu.lateral_lost, ecu.motion_lost = ACTIVE, 0, 0
    ecu.authority = ecu.feedforward = 1 << 30
    ecu.gain_factor = 1 << 28
    draw, limited = np.random.default_rng(2), 0
    for k in range(200):
        values = {("c", len(inner) - order + i): ecu.compensator_x[i] for i in range(order)}
        ecu.rate_good = round(2.0**27 * 0.3 * np.sin(0.05 * k))
        ecu.acceleration_good = round(2.0**24 * draw.normal())
        values |= {("y", 0): ecu.rate_good, ("y", 1): ecu.acceleration_good}

        def of(form, values=values):
            return sum(float(int(v.p) / int(v.q)) * values.get(k, 0.0) for k, v in form.items())

        wanted = of(command)
        left = float(np.clip(wanted, -record.moment_max, record.moment_max))
        values[("a", 0)] = left - wanted
        limited += left != wanted
        control(ecu, record, 1)
        assert abs(ecu.moment - left) <= float(str(command.rounding()).partition("/")[0]) + 2
        states = [of(form) for form in inner[len(inner) - order :]]
        assert states == pytest.approx(ecu.compensator_x[:order], rel=1e-6, abs=64)
    assert 20 < limited < 180


def test_the_judge_finds_a_multiplier_that_is_not_true(integers, monkeypatch):
    """Were never more than half of a command cut off, a car of negative damping would be stable."""
    init = checker.Sampled.__init__

    def wrong(self, *arguments):
        init(self, *arguments)
        self.opposed += [(cut, cut + self.within) for cut in self.cut]

    monkeypatch.setattr(checker.Sampled, "__init__", wrong)
    condition = roll_model(damping=-0.3)
    claim = prove(integers, condition, wish(LIMITED))
    assert claim is not None
    growth, _ = largest_growth(Loop(integers, condition), floats(claim["p"]), trigger=False)
    assert growth > 1.0 > float(Fraction(claim["decay"]))
