"""What partial evaluation leaves of small programs."""

import ast

import pytest

from codegen.specialise.evaluator import TURNS, Evaluator, steady
from codegen.specialise.reach import cut
from codegen.subset.parse import load

CALIBRATION = {("gain", (0,)): 0, ("gain", (1,)): 1, ("gain", (2,)): -5}
CALIBRATION |= {("shift", ()): 3, ("order", ()): 2}
STARTED = {("count", ()): 0, ("small", ()): 7} | {("x", (k,)): k for k in range(3)}
STARTED |= {("m", (i, j)): 0 for i in range(3) for j in range(2)}


@pytest.fixture
def source(sample):
    """Writes a program and returns the copies of its function ``run``, entry last, as text."""

    def written(text, steady=None):
        program = load("sample", sample.write(text))
        evaluator = Evaluator(program, CALIBRATION, steady or {}, {})
        evaluator.entry(program.modules["sample"].functions["run"])
        bodies = []
        for copy in evaluator.copies.values():
            head = f"{copy.name}({', '.join(arg.arg for arg in copy.node.args.args)})"
            lines = [ast.unparse(ast.fix_missing_locations(s)) for s in copy.node.body[1:]]
            bodies.append("\n".join([head, *lines]))
        written.tables = evaluator.tables
        return bodies

    return written


def test_loops_are_unrolled_and_zeros_dropped(source):
    assert source(
        """
        def run(ecu: Ecu, cal: Calibration) -> i64:
            acc: i64 = 0
            for k in range(N):
                acc += cal.gain[k] * ecu.x[k]
            return acc
        """
    ) == ["run(ecu, cal)\nacc: i64 = ecu.x[1]\nacc = acc + ecu.x[2] * -5\nreturn acc"]


def test_a_long_loop_stays_and_reads_a_table(source):
    (text,) = source(
        f"""
        def run(ecu: Ecu, cal: Calibration) -> i64:
            acc: i64 = 0
            for k in range({TURNS + 1}):
                acc += cal.gain[k & 1]
            return acc
        """
    )
    assert f"for k in range({TURNS + 1}):\n    acc = acc + GAIN[k & 1]" in text
    assert source.tables["GAIN"][1] == (0, 1, -5)


def test_a_dead_option_leaves_nothing(source):
    (text,) = source(
        """
        def run(ecu: Ecu, cal: Calibration) -> i32:
            if cal.shift == 4:
                ecu.count = 9
            elif cal.shift == 3 and ecu.count > 5:
                return 2
            return TABLE[cal.order]
        """
    )
    assert text == "run(ecu, cal)\nif ecu.count > 5:\n    return 2\nreturn 3"


def test_what_a_branch_may_change_is_not_known_after_it(source):
    (text,) = source(
        """
        def run(ecu: Ecu, cal: Calibration) -> i32:
            a: i32 = 1
            b: i32 = 1
            if ecu.count > 5:
                a = 2
            else:
                b = 1
            return a + b
        """
    )
    assert text.endswith("return a + 1")
    assert "a: i32 = 1" in text and "b" not in text.replace("ecu", "").split("return")[0]


def test_what_a_loop_changes_is_not_known_in_it(source):
    (text,) = source(
        f"""
        def run(ecu: Ecu, cal: Calibration) -> i32:
            a: i32 = 1
            b: i32 = 2
            c: i32 = 3
            for _ in range({TURNS + 1}):
                a = b
                b = c
                c = clamp(c + ecu.count, 0, 9)
            return a
        """
    )
    for part in ("a = b", "b = c", "c = clamp(c + ecu.count, 0, 9)", "return a"):
        assert part in text


def test_each_known_argument_has_its_copy(source):
    first, second, entry = source(
        """
        def put(ecu: Ecu, k: i32, v: i32) -> i32:
            ecu.x[k] = clamp(v, -9, 9)
            if v > 0:
                return k
            return 0

        def run(ecu: Ecu, cal: Calibration) -> i32:
            a: i32 = put(ecu, 0, ecu.count)
            b: i32 = put(ecu, 1, ecu.count)
            return a + b
        """
    )
    assert "ecu.x[0] = clamp(v, -9, 9)" in first and "(ecu, v)" in first
    assert "ecu.x[1] = clamp(v, -9, 9)" in second
    assert "sample_put(ecu, ecu.count)" in entry and "sample_put_2(ecu, ecu.count)" in entry


def test_one_expression_takes_the_place_of_its_call(source):
    *_, entry = source(
        """
        def dot(row: Annotated[list[i32], N], x: Annotated[list[i32], N]) -> i64:
            return row[0] * x[0] + row[1] * x[1] + row[2] * x[2]

        def run(ecu: Ecu, cal: Calibration) -> i64:
            return dot(cal.gain, ecu.x)
        """
    )
    assert entry == "run(ecu, cal)\nreturn ecu.x[1] + ecu.x[2] * -5"


def test_a_costly_argument_is_not_evaluated_twice(source):
    _, entry = source(
        """
        def square(a: i32) -> i64:
            return a * a

        def run(ecu: Ecu, cal: Calibration) -> i64:
            return square(ecu.count + 1)
        """
    )
    assert entry.endswith("return sample_square(ecu.count + 1)")


def test_a_place_at_an_unknown_index_is_passed_on(source):
    inner, entry = source(
        """
        def fill(row: Annotated[list[i32], 2]) -> None:
            for k in range(2):
                row[k] = k

        def run(ecu: Ecu, cal: Calibration) -> None:
            fill(ecu.m[clamp(ecu.count, 0, 2)])
        """
    )
    assert inner == "sample_fill(row)\nrow[0] = 0\nrow[1] = 1"
    assert entry.endswith("sample_fill(ecu.m[clamp(ecu.count, 0, 2)])")


def test_an_unread_call_keeps_its_effect(source):
    *_, entry = source(
        """
        def count(ecu: Ecu) -> i32:
            ecu.count = clamp(ecu.count + 1, 0, 100)
            return ecu.count

        def run(ecu: Ecu, cal: Calibration) -> None:
            last: i32 = count(ecu)
            if cal.order == 0:
                ecu.small = byte(clamp(last, 0, 9))
        """
    )
    assert entry.count("sample_count(ecu)") == 1 and "last" not in entry


def test_what_never_changes_is_steady_and_what_may_is_not(sample):
    program = load(
        "sample",
        sample.write(
            """
            def tick(ecu: Ecu, cal: Calibration) -> None:
                ecu.x[1] = ecu.x[1]
                if ecu.small == 6:
                    ecu.count = 5
                ecu.m[clamp(ecu.x[0], 0, 1)][0] = 3
                ecu.x[2] = clamp(ecu.x[2] + ecu.x[1], 0, 9)

            def receive(ecu: Ecu) -> None:
                ecu.bytes[0] = 1
            """
        ),
    )
    entries = program.modules["sample"].functions
    held = steady(program, entries, CALIBRATION, STARTED, {})
    # count is only written where small is 6, which it never becomes
    assert {("count", ()), ("small", ()), ("x", (0,)), ("x", (1,)), ("m", (0, 1))} <= set(held)
    assert not {("x", (2,)), ("m", (0, 0)), ("bytes", (0,))} & set(held)
    # x[0] is 0 for ever: the row is known
    assert ("m", (1, 0)) in held


def test_what_the_proof_never_reaches_is_cut(sample):
    program = load(
        "sample",
        sample.write(
            """
            def run(ecu: Ecu) -> i32:
                if ecu.count > 100:
                    return 7
                if ecu.count >= 0 and ecu.small > 3:
                    ecu.x[0] = clamp(ecu.count, -1000, 1000)
                ecu.small = ecu.small
                ecu.bytes[0] = ecu.bytes[0]
                return 0
            """
        ),
    )
    (node,) = cut(program, "sample")
    assert ast.unparse(ast.fix_missing_locations(node)).splitlines()[1:] == [
        "    if ecu.small > 3:",
        "        ecu.x[0] = ecu.count",
        "    ecu.bytes[0] = ecu.bytes[0]",
        "    return 0",
    ]


def test_a_local_is_declared_in_the_only_branch_that_needs_it(sample):
    program = load(
        "sample",
        sample.write(
            """
            def run(ecu: Ecu) -> i32:
                moved: i32 = 0
                if ecu.small > 3:
                    moved = clamp(ecu.count, 0, 7)
                    ecu.x[0] = moved + 1
                if ecu.count > 100:
                    ecu.x[1] = moved
                return 0
            """
        ),
    )
    (node,) = cut(program, "sample")
    assert ast.unparse(ast.fix_missing_locations(node)).splitlines()[1:] == [
        "    if ecu.small > 3:",
        "        moved: i32 = clamp(ecu.count, 0, 7)",
        "        ecu.x[0] = moved + 1",
        "    return 0",
    ]


def test_what_follows_a_call_in_a_condition_is_not_taken_for_certain(sample):
    program = load(
        "sample",
        sample.write(
            """
            def half(value: i32) -> i32:
                return rsh(value, 1)

            def run(ecu: Ecu) -> i32:
                bad: i32 = 0
                if half(ecu.count) > ecu.small:
                    bad = 1
                    ecu.x[0] = 1
                else:
                    ecu.x[0] = 2
                return bad + ecu.x[0]
            """
        ),
    )
    node = cut(program, "sample")[-1]
    assert ast.unparse(ast.fix_missing_locations(node)).splitlines()[1:] == [
        "    bad: i32 = 0",
        "    if half(ecu.count) > ecu.small:",
        "        bad = 1",
        "        ecu.x[0] = 1",
        "    else:",
        "        ecu.x[0] = 2",
        "    return bad + ecu.x[0]",
    ]
