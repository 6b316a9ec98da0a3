"""Frame lengths and bits against an encoder written from the standard, one bit at a time."""

from fractions import Fraction

import numpy as np
import pytest

from canroll.plant_sim.can_bus.wire.bits import wire_bits
from canroll.plant_sim.can_bus.wire.frame import (
    BIT_RATE_SWITCH,
    ERROR_STATE,
    EXTENDED,
    FD,
    FD_LENGTHS,
    REMOTE,
    arbitration_key,
    best_case_bits,
    frame_bits,
    length_code,
    length_of,
    transmission_ns,
    worst_case_bits,
)


def divide(bits, generator, start):
    """Remainder of the bit string by shift register, as the standard's pseudo code has it."""
    width = len(generator) - 1
    register = [int(c) for c in start]
    taps = [int(c) for c in generator[1:]]
    for bit in bits:
        feedback = int(bit) ^ register[0]
        register = [*register[1:], 0]
        if feedback:
            register = [r ^ t for r, t in zip(register, taps, strict=True)]
    assert len(register) == width
    return "".join(map(str, register))


def stuffed(bits, *, leave_last=False):
    """Insert the complement behind five equal bits, the inserted ones counted as well."""
    out = ""
    for place, bit in enumerate(bits):
        out += bit
        if len(out) >= 5 and len(set(out[-5:])) == 1 and (since(out) >= 5):
            if leave_last and place == len(bits) - 1:
                break
            out += "01"[bit == "0"]
    return out


def since(text):
    """Length of the run of equal characters at the end."""
    return len(text) - len(text.rstrip(text[-1]))


def encode(ident, flags, payload):
    """Bits of a frame, SOF to EOF, as a string; places of BRS and CRC delimiter if it switches."""
    fd, extended, remote = flags & FD, flags & EXTENDED, bool(flags & REMOTE)
    dlc = format(FD_LENGTHS.index(len(payload)), "04b")
    text = format(ident, "029b") if extended else format(ident, "011b")
    sof = "0"
    if extended:
        arbitration = text[:11] + "11" + text[11:] + ("1" if remote else "0")
    else:
        arbitration = text + ("1" if remote else "0")
    data = "" if remote else "".join(format(byte, "08b") for byte in payload)
    if not fd:
        # two reserved or format bits, dominant: r1 and r0, or IDE and r0
        body = sof + arbitration + "00" + dlc + data
        crc = divide(body, "1100010110011001", "0" * 15)
        return stuffed(body + crc) + "1" + "0" + "1" + "1" * 7, None
    switch = "1" if flags & BIT_RATE_SWITCH else "0"
    slow = sof + arbitration + ("" if extended else "0") + "10" + switch
    fast = ("1" if flags & ERROR_STATE else "0") + dlc + data
    dynamic = stuffed(slow + fast, leave_last=True)
    count = len(dynamic) - len(slow + fast)
    gray = {0: "000", 1: "001", 2: "011", 3: "010", 4: "110", 5: "111", 6: "101", 7: "100"}
    code = gray[count % 8]
    code += str(code.count("1") % 2)
    if len(payload) <= 16:
        crc = divide(dynamic + code, format(0x3685B, "018b"), "1" + "0" * 16)
    else:
        crc = divide(dynamic + code, format(0x302899, "022b"), "1" + "0" * 20)
    tail = dynamic
    field = code + crc
    for start in range(0, len(field), 4):
        tail += "10"[tail[-1] == "1"] + field[start : start + 4]
    # BRS follows a dominant bit, behind its stuff bit if that is the fifth
    places = (len(stuffed(slow[:-1])), len(tail)) if switch == "1" else None
    return tail + "1" + "0" + "1" + "1" * 7, places


def timeline(bits, places, times, samples):
    """Time of a frame from its SOF to the end of the interframe space, bit by bit.

    ``times``: of a nominal and a data bit; ``samples``: where in it each is sampled. The rate
    changes at the sample points of BRS and of the CRC delimiter, within the bit (ISO 11898-1).
    """
    now, rate = Fraction(0), 0
    for place in range(len(bits) + 3):
        now += samples[rate] * times[rate]
        if places is not None and place in places:
            rate = 1 - rate
        now += (1 - samples[rate]) * times[rate]
    return now


def random_frame(rng, kinds):
    flags = int(rng.choice(kinds))
    sizes = FD_LENGTHS if flags & FD else FD_LENGTHS[:9]
    length = int(rng.choice(sizes))
    ident = int(rng.integers(1 << 29 if flags & EXTENDED else 1 << 11))
    style = rng.integers(4)
    if style == 0:
        payload = rng.integers(256, size=length)
    elif style == 1:
        payload = rng.choice([0, 255], size=length)
    elif style == 2:
        payload = rng.choice([0x0F, 0xF0, 0x1F, 0x78, 0x87, 0x00, 0xFF], size=length)
    else:
        payload = np.zeros(length)
    if rng.integers(8) == 0:
        ident &= int(rng.choice([0, 0x1F, 0x1FFFFFFF, 0x3FFFF, 0x78F]))
    return ident, flags, payload.astype(np.uint8)


CLASSIC = [0, EXTENDED, REMOTE, EXTENDED | REMOTE]
FLEXIBLE = [
    FD,
    FD | EXTENDED,
    FD | BIT_RATE_SWITCH,
    FD | EXTENDED | BIT_RATE_SWITCH,
    FD | BIT_RATE_SWITCH | ERROR_STATE,
]


def compare(count, kinds, seed):
    rng = np.random.default_rng(seed)
    buffer, out = np.zeros(64, np.uint8), np.zeros(800, np.uint8)
    for _ in range(count):
        ident, flags, payload = random_frame(rng, kinds)
        buffer[: len(payload)] = payload
        expected, places = encode(ident, flags, payload)
        bits, first, last = wire_bits(ident, flags, len(payload), buffer, out)
        assert "".join(map(str, out[:bits])) == expected
        nominal, data = frame_bits(ident, flags, len(payload), buffer)
        assert nominal + data == len(expected) + 3
        assert data == last - first
        times = [Fraction(1), Fraction(1, int(rng.integers(1, 17)))]
        samples = [Fraction(int(n), 100) for n in rng.integers(50, 100, size=2)]
        exact = timeline(expected, places, times, samples)
        assert nominal * times[0] + data * times[1] == exact
        low, high = best_case_bits(len(payload), flags), worst_case_bits(len(payload), flags)
        assert low[0] <= nominal <= high[0]
        assert low[1] <= data
        assert nominal + data <= sum(high)


@pytest.mark.parametrize("kinds", [CLASSIC, FLEXIBLE])
def test_bits_and_lengths_equal_an_independent_encoder(kinds):
    compare(1000, kinds, seed=5)


@pytest.mark.long
@pytest.mark.parametrize(("kinds", "count"), [(CLASSIC, 70_000), (FLEXIBLE, 30_000)])
def test_a_hundred_thousand_frames_equal_an_independent_encoder(kinds, count):
    compare(count, kinds, seed=6)


@pytest.mark.parametrize(
    ("bitrate", "data_bitrate", "us"),
    [(500_000, 2_000_000, 113.0), (500_000, 5_000_000, 80.0), (1_000_000, 8_000_000, 42.75)],
)
def test_times_of_a_frame_that_switches_its_rate(bitrate, data_bitrate, us):
    bits = length_of(0x123, bytes(8), FD | BIT_RATE_SWITCH)
    assert transmission_ns(bits, bitrate=bitrate, data_bitrate=data_bitrate) == 1e3 * us


@pytest.mark.parametrize("length", range(9))
def test_closed_forms_of_classic_frames(length):
    assert worst_case_bits(length) == (55 + 10 * length, 0)
    assert worst_case_bits(length, EXTENDED) == (80 + 10 * length, 0)
    assert best_case_bits(length) == (47 + 8 * length, 0)
    assert best_case_bits(length, EXTENDED) == (67 + 8 * length, 0)


def test_length_codes():
    assert [length_code(n) for n in FD_LENGTHS] == list(range(16))
    assert [length_code(n) for n in (9, 13, 33, 49)] == [9, 10, 14, 15]


def test_standard_beats_extended_and_data_beats_remote():
    base = 0x123
    keys = [
        arbitration_key(base, 0),
        arbitration_key(base, REMOTE),
        arbitration_key(base << 18, EXTENDED),
        arbitration_key(base << 18, EXTENDED | REMOTE),
        arbitration_key(base << 18 | 1, EXTENDED),
        arbitration_key(base + 1, 0),
    ]
    assert keys == sorted(keys)
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("flags", [*CLASSIC, *FLEXIBLE])
def test_keys_follow_the_bits_on_the_wire(flags):
    """Two frames arbitrate as their unstuffed bits compare: the first dominant bit wins."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        wide = bool(flags & EXTENDED)
        one, two = (int(n) for n in rng.integers(1 << (29 if wide else 11), size=2))
        if one == two:
            continue
        texts = [format(i, "029b" if wide else "011b") for i in (one, two)]
        assert (arbitration_key(one, flags) < arbitration_key(two, flags)) == (texts[0] < texts[1])
