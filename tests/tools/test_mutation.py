"""The mutation test itself: its mutants are what they say, and it tells dead from alive."""

import ast
import json
import re
import subprocess
import sys

import pytest

from codegen.subset.program import FIRMWARE
from tools.mutation import __main__ as mutation
from tools.mutation import equivalence, mutants
from tools.mutation.hunt import EQUIVALENT, KILLED, REFUSED, SURVIVED, Outcome

SOURCE = '''
N = 3
TABLE: tuple[i32, ...] = (1, -2)


def f(a: i32, b: i32) -> i32:
    """Say a + b."""
    c: i32 = a + b * 3  # a - b
    c -= 1
    if a < b and c != -2 or a >= b:
        return c << 4
    return tdiv(
        a & 15, b ^ a
    )
'''


def test_mutants_are_every_operator_and_constant_once():
    found = list(mutants.mutants("f", SOURCE))
    assert [f"{m.place} {m.first} {m.line}: {m.before} -> {m.after}" for m in found] == [
        "f 2 2: 3 -> 4",
        "f 3 3: 1 -> 2",
        "f 3 3: - -> ",
        "f 3 3: 2 -> 3",
        "f.f 8 8: + -> -",
        "f.f 8 8: * -> +",
        "f.f 8 8: 3 -> 4",
        "f.f 9 9: -= -> +=",
        "f.f 9 9: 1 -> 2",
        "f.f 10 10: < -> <=",
        "f.f 10 10: and -> or",
        "f.f 10 10: != -> ==",
        "f.f 10 10: - -> ",
        "f.f 10 10: 2 -> 3",
        "f.f 10 10: or -> and",
        "f.f 10 10: >= -> >",
        "f.f 11 11: << -> >>",
        "f.f 11 11: 4 -> 5",
        "f.f 12 13: & -> |",
        "f.f 12 13: 15 -> 16",
        "f.f 12 13: ^ -> |",
    ]
    for mutant in found:
        changed = mutant.apply(SOURCE)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(SOURCE))
        assert mutant.text == changed.splitlines()[mutant.line - 1].strip()


def test_every_hand_written_module_is_mutated():
    found = mutants.all_mutants(mutants.sources())
    modules = {mutant.module for mutant in found}
    assert {"observer", "plausibility", "allocation", "e2e", "covariance"} <= modules
    assert modules.isdisjoint(mutants.SKIPPED)
    assert len(found) > 500


def test_a_sample_spreads_over_all_modules():
    found = mutants.all_mutants(mutants.sources())
    chosen = mutation.sample(found, 160, seed=3)
    assert len(set(chosen)) == 160
    assert chosen == mutation.sample(found, 160, seed=3) != mutation.sample(found, 160, seed=5)
    assert len({mutant.module for mutant in chosen}) >= 0.8 * len({m.module for m in found})
    assert mutation.sample(found, len(found) + 5, seed=0) == found


PROGRAM = """
def magnitude(v: i32) -> i32:
    size: i32 = v
    if size < 0:
        size = -size
    return size


def tick(ecu: Ecu, cal: Calibration) -> None:
    a: i32 = ecu.count
    b: i32 = clamp(a + 1, 0, 100)
    if a >= 101:
        b = 3
    if b > 0:
        ecu.count = b
    ecu.small = byte(clamp(a, 0, 9))
    ecu.x[0] = clamp(a * 2, -5, 150)
    ecu.x[1] = magnitude(ecu.x[2])
"""
# function, what is changed in it to what, whether that can't be told
CHANGES = [
    ("magnitude", "< 0", "<= 0", True),
    ("tick", "0, 100)", "1, 100)", True),
    ("tick", "0, 100)", "2, 100)", False),
    ("tick", "b > 0", "b > 1", False),
    ("tick", "a >= 101", "a >= 100", False),
    ("tick", "a, 0, 9", "a, 1, 9", False),
    ("tick", "* 2", "* 3", False),
    ("tick", "-5", "5", False),
    ("tick", "-5", "-6", True),
    ("tick", "150", "151", False),
]


@pytest.mark.parametrize(("function", "before", "after", "equivalent"), CHANGES)
def test_what_can_not_differ_is_equivalent(sample, function, before, after, equivalent):
    ecu = sample.head + PROGRAM
    original = equivalence.Original({"state": sample.state, "ecu": ecu})
    place = ecu.index(before, ecu.index(f"def {function}"))
    changed = ecu[:place] + after + ecu[place + len(before) :]
    refused, same = original.examine("ecu", changed)
    assert not refused
    assert bool(same) == equivalent


UNTRANSLATED = [
    ("1, 0, 100", "1, 0, 101", "ecu.py:26: does not fit count is declared in [0, 100]: [1, 101]"),
    ("a * 2", "a // 2", "SubsetError: ecu.py:"),
    ("a: i32 = ecu.count", "a: i32 = ecu.count * ecu.x[0] * ecu.x[0] * ecu.x[0]", "may not fit"),
]


@pytest.mark.parametrize(("before", "after", "what"), UNTRANSLATED)
def test_what_the_translation_refuses_is_killed(sample, before, after, what):
    ecu = sample.head + PROGRAM
    original = equivalence.Original({"state": sample.state, "ecu": ecu})
    refused, same = original.examine("ecu", ecu.replace(before, after, 1))
    assert what in refused
    assert same == ""


def test_the_report_counts_survivors_and_gives_reasons(monkeypatch, tmp_path):
    reasons = tmp_path / "survivors.toml"
    reasons.write_text('[e2e]\n"N = 2" = "no"\n\n[e2e.checksum]\n"crc = 2" = "it is so"\n')
    monkeypatch.setattr(mutation, "REASONS", reasons)
    texts = {
        KILLED: "crc = 1",
        SURVIVED: "crc = 2",
        EQUIVALENT: "crc = 3",
    }
    outcomes = [
        Outcome(mutants.Mutant("e2e", "checksum", 7, 7, 0, "0", text[-1], text), verdict, by)
        for (verdict, text), by in zip(texts.items(), ("a test", "", "always 3"), strict=True)
    ]
    constant = mutants.Mutant("e2e", "", 3, 3, 0, "1", "2", "N = 2")
    outcomes.append(Outcome(constant, SURVIVED, ""))
    outcomes.append(Outcome(constant, KILLED, f"{REFUSED}overflows"))
    told = mutation.report(outcomes, 99)
    assert "2 of 4 mutants killed (50.0%), 1 equivalent ones left out; 99 exist" in told
    assert "1 of the killed by the translation or its proof, all others by tests" in told
    assert "e2e.py:3: 1 -> 2: N = 2\n    no" in told
    assert "e2e.py:7: 0 -> 2: crc = 2\n    it is so" in told
    assert "e2e.py:7: 0 -> 3: crc = 3\n    always 3" in told
    assert "a test" not in told
    assert mutation.share(outcomes) == 0.5


def test_reasons_are_for_places_that_exist():
    known = {(m.place, m.text) for m in mutants.all_mutants(mutants.sources())}
    assert {(place, text) for place, text, _ in mutation.reasons()} <= known


RUN = """
import json, sys
from tools.mutation import hunt, mutants
texts = mutants.sources()
changes = [
    ("protection", "protect_0", "counter & 15", "counter & 7"),
    ("protection", "protect_0", "counter & 15", "counter & 15"),
    ("protection", "protect_0", "counter & 15", "counter / 15"),
    ("e2e", "", "STEP_MAX = 15", "STEP_MAX = 3"),
    ("e2e", "", "NO_COUNTER = COUNTER_MAX", "NO_COUNTER = COUNTER_MAX + 0"),
]
chosen = []
for module, function, before, after in changes:
    text = texts[module]
    place = text.index(before, text.index(f"def {function}") if function else 0)
    row = text.count("\\n", 0, place) + 1
    chosen.append(mutants.Mutant(module, function, row, row, place, before, after, ""))
tests = [hunt.TESTS / "com" / "test_e2e.py"]
outcomes = hunt.run(chosen, texts, 2, tests=tests)
print(json.dumps([*(o.verdict for o in outcomes), hunt.fails_afresh(texts, tests)]))
"""


@pytest.mark.long
def test_a_faulty_loop_is_told_from_a_sound_one():
    command = [sys.executable, "-c", RUN]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=FIRMWARE.parent)
    assert json.loads(done.stdout) == [KILLED, EQUIVALENT, KILLED, KILLED, EQUIVALENT, False]


@pytest.mark.long
def test_a_sample_of_mutants_is_killed():
    """Fewer than the 95 % of the whole: of so few, one or two survivors more are chance."""
    command = [sys.executable, "-m", "tools.mutation", "--sample", "40", "--seed", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=FIRMWARE.parent)
    share = re.search(r"mutants killed \((.*)%\)", done.stdout)
    assert share, done.stderr
    assert float(share[1]) >= 90, done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--sample", "0"], "--sample and --jobs must be at least 1"),
        (["envelop"], "unknown module 'envelop': did you mean 'envelope'?"),
    ],
)
def test_a_wrong_choice_is_a_usage_error(arguments, message):
    command = [sys.executable, "-m", "tools.mutation", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=FIRMWARE.parent)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"mutate: {message}\n"
