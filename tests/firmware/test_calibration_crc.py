"""A calibration that is not what was written: init refuses it, the loop finds it and stays SAFE."""

import random
import zlib

import pytest
import rig

from canroll.firmware import calibration as fw
from canroll.firmware import ecu as loop
from canroll.firmware import plausibility as sv
from canroll.firmware.check import RULE_CRC
from canroll.firmware.limits import LAST_WORD
from canroll.firmware.state import ACTIVE, SAFE, Ecu
from canroll.firmware.subset import fields, octet, word

CODE = 1 << sv.FAULT_CALIBRATION_CRC


def flip(cal, name, bit=0, index=()):
    """Turn one bit of a field over."""
    holder, at = vars(cal), name
    for next_at in index:
        holder, at = holder[at], next_at
    value = holder[at] ^ (1 << bit)
    holder[at] = value if -(2**31) <= value < 2**31 else value - (2**32 if value > 0 else -(2**32))


def test_the_crc_is_that_of_zip_over_the_memory():
    """CRC-32 of the nine digits is 0xCBF43926; ours is over the bytes that memory has."""
    assert zlib.crc32(b"123456789") == 0xCBF43926
    cal = rig.sealed(rig.calibration())
    data = b"".join((word(cal, k) & 0xFFFFFFFF).to_bytes(4, "little") for k in range(LAST_WORD))
    assert data[:2] == bytes([octet(cal, 0), octet(cal, 1)])
    assert zlib.crc32(data) == cal.crc & 0xFFFFFFFF


def test_init_refuses_a_crc_that_is_not_there():
    cal = rig.calibration()
    cal.crc = 0
    ecu = Ecu()
    assert loop.init(ecu, cal) == RULE_CRC == ecu.refused
    assert (ecu.mode, ecu.fault_active, ecu.fault_count[18]) == (SAFE, CODE, 1)
    before = dict(vars(ecu))
    loop.tick(ecu, cal, 1)
    assert vars(ecu) == before


def test_init_refuses_every_flipped_bit():
    rng = random.Random(3)
    for field in fields(fw.Calibration):
        cal = rig.sealed(rig.calibration())
        index = tuple(rng.randrange(n) for n in field.shape)
        flip(cal, field.name, rng.randrange(8 if field.kind == "u8" else 31), index)
        assert loop.init(Ecu(), cal) == RULE_CRC, field.name


@pytest.mark.parametrize("driving", [True, False])
def test_a_bit_that_flips_while_it_runs_ends_in_safe_for_good(driving):
    bench = rig.Bench(rig.calibration(), reference=False)
    if driving:
        bench.active()
        assert bench.ecu.mode == ACTIVE
    flip(bench.cal, "feedback", 20, (0,))
    ticks = 0
    while bench.ecu.fault_active & CODE == 0:
        bench.step(2.0)
        ticks += 1
        assert ticks <= 2 * LAST_WORD
    assert bench.ecu.mode == SAFE
    assert bench.ecu.fault_count[sv.FAULT_CALIBRATION_CRC] == 1
    bench.run(0.4)
    assert bench.ecu.moment == 0
    # the word is back as it was, the fault stays, and the heartbeat goes on
    flip(bench.cal, "feedback", 20, (0,))
    sent = 0
    for _ in range(2 * LAST_WORD):
        bench.step(2.0)
        sent += 0 in bench.frames
    assert bench.ecu.mode == SAFE
    assert bench.ecu.fault_active & CODE
    assert sent > 0
    assert loop.init(bench.ecu, bench.cal) == 0


def test_a_whole_round_takes_a_tick_a_word_and_finds_nothing_in_a_good_calibration():
    bench = rig.Bench(rig.calibration()).active()
    for _ in range(LAST_WORD + 5):
        bench.step(0.0)
    assert bench.ecu.fault_latched == 0
    assert bench.ecu.calibration_word == bench.k % LAST_WORD


def test_missed_ticks_check_one_word():
    bench = rig.Bench(rig.calibration()).active()
    before = bench.ecu.calibration_word
    bench.step(elapsed=9)
    assert bench.ecu.calibration_word == before + 1
