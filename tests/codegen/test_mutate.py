"""The mutation test itself: its mutants are what they say, and it tells dead from alive."""

import ast
import random
from dataclasses import replace

import pytest

from codegen import mutate

SOURCE = '''
def f(a: i32, b: i32) -> i32:
    """Say a + b."""
    c: i32 = a + b * 3  # a - b
    c -= 1
    if a < b and c != -2 or a >= b:
        return c << 4
    return tdiv(a & 15, b)
'''


def test_mutants_are_every_operator_and_constant_once():
    found = [f"{m.line}: {m.before} -> {m.after}" for m in mutate.mutants("f", SOURCE)]
    assert sorted(found) == sorted(
        [
            "4: + -> -",
            "4: * -> +",
            "4: 3 -> 4",
            "5: -= -> +=",
            "5: 1 -> 2",
            "6: < -> <=",
            "6: and -> or",
            "6: != -> ==",
            "6: - -> +",
            "6: 2 -> 3",
            "6: or -> and",
            "6: >= -> >",
            "7: << -> >>",
            "7: 4 -> 5",
            "8: & -> |",
            "8: 15 -> 16",
        ]
    )
    for mutant in mutate.mutants("f", SOURCE):
        changed = mutant.apply(SOURCE)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(SOURCE))


def test_every_hand_written_module_is_mutated():
    found = mutate.all_mutants()
    modules = {mutant.module for mutant in found}
    assert {"observer", "plausibility", "allocation", "e2e", "covariance"} <= modules
    assert len(found) > 500
    assert str(found[0]).startswith("allocation.py:")


@pytest.mark.slow
def test_a_faulty_loop_is_told_from_a_sound_one():
    source = (mutate.FIRMWARE / "e2e.py").read_text()
    line = "crc = CRC_TABLE[crc ^ payload[k]]"
    place = source.index(line)
    fault = mutate.Mutant("e2e", 1, place, line, line.replace("^", "|"))
    tests = [mutate.TESTS / "test_e2e.py"]
    assert mutate.is_killed(fault, tests)
    assert not mutate.is_killed(replace(fault, after=line), tests)


@pytest.mark.slow
def test_a_sample_of_mutants_is_killed():
    chosen = random.Random(1).sample(mutate.all_mutants(), 20)
    left = mutate.survivors(chosen, jobs=2)
    assert len(left) <= 2, [str(mutant) for mutant in left]
