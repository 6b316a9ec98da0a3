"""Any calibration that check accepts, any bytes in the mailboxes: every field stays in range."""

import random
from itertools import product

import pytest
import rig
from hypothesis import given, settings
from hypothesis import strategies as st

from canroll import dbc
from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware.calibration import N_RX, Calibration
from canroll.firmware.check import check
from canroll.firmware.com import protection, signals
from canroll.firmware.state import RX_ACTUATOR_STATE, RX_ROLL_REFERENCE, RX_SUSPENSION_RATE, Ecu
from canroll.firmware.subset import fields

CALIBRATION, STATE = fields(Calibration), fields(Ecu)


def elements(value, shape):
    if not shape:
        yield value
        return
    assert len(value) == shape[0]
    for item in value:
        yield from elements(item, shape[1:])


def assert_in_range(ecu: Ecu) -> None:
    for field in STATE:
        for value in elements(getattr(ecu, field.name), field.shape):
            assert isinstance(value, int)
            assert field.f.lo <= value <= field.f.hi, (field.name, value)


def pick(rng: random.Random, lo: int, hi: int) -> int:
    """Ends, neighbours of zero and one, powers of two, anything: each about as often."""
    kind = rng.randrange(6)
    if kind == 0:
        return lo
    if kind == 1:
        return hi
    if kind == 2:
        return min(max(rng.choice((-1, 0, 1)), lo), hi)
    if kind == 3:
        return min(max(rng.choice((-1, 1)) << rng.randrange(31), lo), hi)
    return rng.randint(lo, hi)


def filled(rng: random.Random, shape, lo: int, hi: int):
    if not shape:
        return pick(rng, lo, hi)
    return [filled(rng, shape[1:], lo, hi) for _ in range(shape[0])]


def random_calibration(seed: int, base: Calibration | None = None) -> Calibration:
    """Any calibration within the declared ranges, made to obey the rules that relate fields.

    With a ``base`` only a tenth of its fields are replaced: paths that need sense stay open.
    """
    rng = random.Random(seed)
    cal = base or Calibration()
    for field in CALIBRATION:
        if base is None or rng.random() < 0.1:
            setattr(cal, field.name, filled(rng, field.shape, field.f.lo, field.f.hi))
    cal.schedule_speed = sorted(rng.sample(range(200 << 20), 8))
    if cal.fade_low >= cal.fade_high:
        cal.fade_low, cal.fade_high = cal.fade_high - 1, max(cal.fade_low, 1)
        cal.fade_low = max(cal.fade_low, 0)
        cal.fade_high = max(cal.fade_high, cal.fade_low + 1)
    for k in range(2):
        lo, hi = sorted((cal.rls_lo[k], cal.rls_hi[k]))
        cal.rls_lo[k], cal.rls_hi[k] = lo, hi
    if cal.actuator == fw.VALVES:
        cal.law, cal.compensator_outputs = fw.COMPENSATOR, 2
    elif cal.law != fw.COMPENSATOR or cal.actuator != fw.BARS:
        cal.compensator_outputs = 1
    cal.timeout_ticks = [max(1, min(ticks, 30)) for ticks in cal.timeout_ticks]
    # a calibration that never gets out of INIT shows little
    cal.init_ticks = min(cal.init_ticks, 5)
    cal.recovery_ticks = min(cal.recovery_ticks, 8)
    cal.ramp_ticks = min(cal.ramp_ticks, 10)
    assert check(cal) == 0
    return cal


class Storm:
    """Frames of random content, most of them with the right checksum and the next counter."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.counter = [0] * N_RX
        self.calm = self.rng.random() < 0.5
        self.last = [[self.rng.randrange(256) for _ in range(8)] for _ in range(N_RX)]
        names = [m.name for m in rig.DATABASE.messages if m.frame_id in signals.RX_IDS]
        self.data_ids = {
            signals.RX_IDS.index(rig.DATABASE.get_message_by_name(n).frame_id): dbc.data_id(
                rig.DATABASE.get_message_by_name(n)
            )
            for n in names
        }

    def blow(self, ecu: Ecu) -> None:
        rng = self.rng
        for message in range(N_RX):
            if rng.random() < 0.1:
                continue
            payload = self.last[message]
            if not self.calm or rng.random() < 0.2:
                payload = [rng.choice((0, 127, 128, 255, rng.randrange(256))) for _ in range(8)]
            payload[7] = (payload[7] + 16) & 255
            if message == RX_ACTUATOR_STATE:
                payload[7] = (payload[7] + 4) & 255
            self.counter[message] = (self.counter[message] + 1) % 15
            protection.protect_0(payload, self.counter[message], self.data_ids[message])
            if rng.random() < 0.05:
                payload[rng.randrange(8)] ^= 1 << rng.randrange(8)
            self.last[message] = list(payload)
            loop.receive(ecu, message, payload, rng.choice((8, 8, 8, 8, 8, 8, 3, 300)))


def storm(cal: Calibration, seed: int, ticks: int) -> set[int]:
    ecu = rig.started(cal)
    assert_in_range(ecu)
    weather = Storm(seed)
    modes = set()
    for k in range(ticks):
        weather.blow(ecu)
        loop.tick(ecu, cal, weather.rng.choice((1, 1, 1, 1, 2, 16, 17, 2**31 - 1, -5)))
        modes.add(ecu.mode)
        if k % 4 == 0:
            assert_in_range(ecu)
        for slot in range(6):
            ecu.tx_pending[slot] = 0
    assert_in_range(ecu)
    return modes


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32))
def test_any_accepted_calibration_in_any_weather(seed):
    storm(random_calibration(seed), seed, 25)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32))
def test_sensible_calibrations_in_any_weather(seed):
    base = rig.calibration(identification=1, offset_learning=1, event_trigger=1)
    storm(random_calibration(seed, base), seed, 40)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32))
def test_one_tick_from_any_state(seed):
    rng = random.Random(seed)
    cal = random_calibration(seed)
    ecu = rig.started(cal)
    for field in STATE:
        if field.name != "refused":
            setattr(ecu, field.name, filled(rng, field.shape, field.f.lo, field.f.hi))
    loop.tick(ecu, cal, rng.choice((1, 2, 16, 100)))
    assert_in_range(ecu)


@pytest.mark.parametrize(
    ("first", "count"),
    [pytest.param(0, 100, marks=pytest.mark.slow)]
    + [pytest.param(1000 * part, 300, marks=pytest.mark.long) for part in range(4)],
)
def test_many_calibrations_in_any_weather(first, count):
    modes = set()
    for seed in range(first, first + count):
        modes |= storm(random_calibration(seed), seed, 60)
        base = rig.calibration(identification=seed & 1, offset_learning=1, event_trigger=1)
        modes |= storm(random_calibration(seed, base), seed, 120)
    assert modes == {0, 1, 2, 3}


OPTIONS = list(product(range(3), range(4), range(3), (1, 3), (0, 1), (0, 1), (0, 1)))


@pytest.mark.parametrize("observer", range(3))
def test_every_option_is_selected_by_calibration(observer):
    """Law × actuator × sensors × identification × trigger × protection: each runs to ACTIVE."""
    for law, actuator, chosen, measurements, identification, trigger, protected in OPTIONS:
        if chosen != observer or (law != fw.COMPENSATOR and actuator == fw.VALVES):
            continue
        cal = rig.calibration(
            law=law,
            actuator=actuator,
            observer=observer,
            measurements=measurements,
            identification=identification,
            event_trigger=trigger,
            e2e=protected,
            trigger_floor=20 << 14,
            compensator_order=2,
            compensator_outputs=2 if actuator == fw.VALVES else 1,
        )
        cal.compensator_shift, cal.compensator_output_shift = [20] * 8, [20] * 2
        cal.compensator_d[0][1] = -(1 << 21)
        cal.init_ticks, cal.ramp_ticks = 4, 4
        cal.timeout_ticks[RX_SUSPENSION_RATE] = 5
        cal.timeout_ticks[RX_ROLL_REFERENCE] = 5
        bench = rig.Bench(cal, reference=True)
        strokes = {f"Rate{c}": 80.0 for c in ("FrontLeft", "FrontRight", "RearLeft", "RearRight")}
        commands = 0
        for _ in range(16):
            frame = bench.sender.frame("SuspensionRate", **strokes)
            rig.deliver(bench.ecu, "SuspensionRate", frame)
            if protected:
                bench.step(3.0)
            else:
                step_unprotected(bench)
            commands += bench.ecu.triggered > 0
        where = (law, actuator, observer, measurements, identification, trigger, protected)
        assert bench.ecu.mode == 1, where
        assert bench.ecu.fault_latched == 0, where
        assert bench.ecu.moment != 0, where
        assert commands >= 2, where
        assert_in_range(bench.ecu)


def step_unprotected(bench: rig.Bench) -> None:
    """As Bench.step, but what the ECU sends carries no checksum for the actuators to accept."""
    for name, values in bench.inputs(3.0).items():
        rig.deliver(bench.ecu, name, bench.sender.frame(name, **values))
    loop.tick(bench.ecu, bench.cal, 1)
    for slot in range(6):
        bench.ecu.tx_pending[slot] = 0
    bench.x = bench.phi @ bench.x + bench.gamma @ [3.0, 0.0]
    bench.k += 1
