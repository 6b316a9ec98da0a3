"""A checksum by a function of the user's own: read, proved, translated, and in the plant."""

import numpy as np
import pytest
from cantools.database import load_string

from canroll.codegen.frame.frame_protection import protection
from canroll.errors import CanrollError
from canroll.plant_sim.nodes import e2e

DBC = 'VERSION ""\nBO_ 1313 Frame: 9 Car\n SG_ Sum : 7|12@0+ (1,0) [0|0] "" Ecu\n'
HEAD = """from typing import Annotated

from canroll.firmware.subset import i32, i64, u8, u32

"""
GOOD = (
    HEAD
    + '''
WEIGHTS: tuple[i32, ...] = (1, 3, 5, 7, 11, 13, 17)


def weighted(payload: Annotated[list[u8], 9], identifier: i32) -> i64:
    """Return a weighted sum, which a narrow integer would not hold."""
    total: i64 = identifier
    for k in range(7):
        total += (WEIGHTS[k] * payload[k + 2]) << 20
    return spread(total)


def spread(value: i64) -> i64:
    return (value >> 19) ^ value
'''
)


def of_text(tmp_path, text, name="weighted", **table):
    if text is not None:
        (tmp_path / "maker.py").write_text(text)
    message = load_string(DBC, "dbc").messages[0]
    table = {"signal": "Sum", "function": f"maker.py:{name}"} | table
    return protection(message, {"profile": "own", "checksum": table}, (), "car.toml", tmp_path)


def expected(payload):
    total = 1313 + sum(
        w * b << 20 for w, b in zip((1, 3, 5, 7, 11, 13, 17), payload[2:9], strict=True)
    )
    return ((total >> 19) ^ total) & 0xFFF


def test_a_function_gives_the_lowest_bits_of_its_result(tmp_path):
    its = of_text(tmp_path, GOOD)
    payload = bytearray(range(200, 209))
    its.apply(payload, 0)
    assert its.checksum.place.read(payload) == expected(payload)


def test_the_plant_calls_the_same_function(tmp_path):
    its = of_text(tmp_path, GOOD)
    rows = np.zeros(1, e2e.PROTECTION)[0]
    e2e.put(rows, its)
    rng = np.random.default_rng(1)
    for _ in range(20):
        payload = rng.integers(0, 256, 64).astype(np.uint8)
        e2e.protect(rows, 0, payload)
        assert its.checksum.place.read(payload.tobytes()) == expected(payload.tolist())
        assert e2e.intact(rows, payload)
        payload[5] ^= 1
        assert not e2e.intact(rows, payload)


def body(*lines, result="i32", size=9):
    head = f"def weighted(payload: Annotated[list[u8], {size}], identifier: i32) -> {result}:\n"
    return HEAD + "\n" + head + "".join(f"    {line}\n" for line in lines)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "checksum.function: cannot read"),
        (body("return payload[8"), "maker.py:7: "),
        (body("return payload[9]"), "maker.py:7: not proved: index"),
        (body("return payload[8] << 24"), "maker.py:7: "),
        (body("while True:", "    return 0"), "maker.py:7: while is not in the subset"),
        (body("payload[3] = 1", "return 0"), "maker.py:6: weighted must not change the frame"),
        (body("return payload[0]"), "depends on the checksum's own bits of Frame"),
        (body("return payload[3]", result="u8"), "must be: def weighted(payload: "),
        (body("return payload[3]", size=12), "reads 12 bytes, Frame has 9"),
        (GOOD.replace("weighted", "weighed"), "did you mean 'weighed'"),
        ("import os\n" + GOOD, "only canroll.firmware is imported, not os"),
        ("from canroll.firmware.state import Ecu\n" + GOOD, "maker.py:1: a checksum imports from"),
        (GOOD.replace("u8, u32", "u8, u23"), "firmware.subset has no u23"),
        (GOOD.replace("i64 = identifier", "i64 = weighted(payload, 1)"), "calls itself"),
    ],
)
def test_what_is_wrong_with_a_function_is_named(tmp_path, text, words):
    with pytest.raises(CanrollError) as caught:
        of_text(tmp_path, text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"function": "maker.py"}, "must be file.py:function"),
        ({"function": "My Maker.py:weighted"}, "lower-case letters, digits and _"),
        ({"method": "sum"}, "method is for the function to decide"),
        ({"signal": "Summ"}, "did you mean 'Sum'"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path, table, words):
    with pytest.raises(CanrollError) as caught:
        of_text(tmp_path, GOOD, **table)
    assert words in str(caught.value) and str(caught.value).count("car.toml") == 1
