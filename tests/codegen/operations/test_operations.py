"""Every row of the table: its interval holds what it computes, and its C computes the same."""

import random
import subprocess
from itertools import product

import pytest

from canroll.codegen.c99.text import RUNTIME
from canroll.codegen.operations.c_expression import C_TYPES, PRIMARY, Expression, fits, literal
from canroll.codegen.operations.intervals import KINDS, Value
from canroll.codegen.operations.table import INTRINSICS, OPERATORS, Operation
from canroll.codegen.run import native
from canroll.firmware import subset

ROWS = [*OPERATORS.values(), *(row for row in INTRINSICS.values() if isinstance(row, Operation))]
CASES = 60
LIMITS = (0, 1, 9, 255, 40_000, 2**30 - 1, 2**30, 2**31 - 1, 2**31, 2**33, 2**46, 2**62)


def interval(rng, kind):
    ends = (rng.choice(LIMITS) * rng.choice((1, -1)) + rng.randint(-2, 2) for _ in range(2))
    lo, hi = sorted(min(max(end, KINDS[kind][0]), KINDS[kind][1]) for end in ends)
    return Value(lo, hi)


def operand(rng, kind, name):
    value = interval(rng, kind)
    kinds = [k for k in C_TYPES if fits(value, k)]
    return Expression(name, PRIMARY, rng.choice(kinds), value)


def operands(rng, row):
    """Operands of which some are literals: counts of shifts, of operators all of them."""
    given = [operand(rng, kind, name) for kind, name in zip(row.operands, "abc", strict=False)]
    if row.name in ("<<", ">>"):
        given[1] = literal(rng.randint(0, 40))
    if row.name in ("rsh", "scaled"):
        low = rng.randint(1, 62)
        given[1] = rng.choice(
            (literal(low), Expression("b", PRIMARY, "i32", Value(low, rng.randint(low, 62))))
        )
    return given


def met(row, values):
    return all(met for met, *_ in row.obligations(*values)) and row.interval(*values).within(
        *KINDS["i64"]
    )


def cases(row):
    rng = random.Random(row.name)
    found = []
    for _ in range(40 * CASES):
        given = operands(rng, row)
        if met(row, [e.value for e in given]) and len(found) < CASES:
            found.append(given)
    return found


def samples(given):
    """Numbers for each operand: the ends of its interval, its middle, 0."""
    found = []
    for e in given:
        numbers = {e.value.lo, e.value.hi, (e.value.lo + e.value.hi) // 2, 0}
        found.append(sorted(n for n in numbers if e.value.lo <= n <= e.value.hi))
    return list(product(*found))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_the_interval_holds_every_result(row):
    found = cases(row)
    assert len(found) > 9
    for given in found:
        values = [e.value for e in given]
        result = row.interval(*values)
        for numbers in samples(given):
            assert result.lo <= row.fold(*numbers) <= result.hi, (values, numbers)


@pytest.mark.skipif(native.compiler() is None, reason="needs a C compiler")
def test_c_computes_the_same_without_undefined_behaviour(tmp_path):
    functions, calls = ['#include "canroll_runtime.h"', "#include <stdio.h>"], []
    rng = random.Random(1)
    chosen = [(row, given) for row in ROWS for given in cases(row)[:25]]
    for k, (row, given) in enumerate(chosen):
        kinds = [C_TYPES.get(e.kind, "int64_t") for e in given]
        parameters = ", ".join(f"{kind} {name}" for kind, name in zip(kinds, "abc", strict=False))
        text = row.c(row.interval(*(e.value for e in given)), *given).text
        functions.append(f"static int64_t f{k}({parameters}) {{ return (int64_t)({text}); }}")
        tried = samples(given)
        for numbers in rng.sample(tried, min(len(tried), 12)):
            arguments = ", ".join(c_number(n) for n in numbers)
            call = f"f{k}({arguments}) != {c_number(row.fold(*numbers))}"
            calls.append(f'    if ({call}) return puts("{row.name}: {text} of {numbers}");')
    lines = [*functions, "int main(void) {", *calls, "    return 0;", "}", ""]
    (tmp_path / RUNTIME.name).write_bytes(RUNTIME.read_bytes())
    (tmp_path / "rows.c").write_text("\n".join(lines))
    command = [native.compiler(), "-std=c99", "-w", "-fsanitize=undefined"]
    command += ["-fno-sanitize-recover=all", "rows.c", "-o", "rows"]
    subprocess.run(command, cwd=tmp_path, check=True)
    run = subprocess.run(["./rows"], check=False, cwd=tmp_path, capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


def c_number(number):
    """A literal that no C compiler takes for another number."""
    return "INT64_MIN" if number == -(2**63) else f"INT64_C({number})"


def test_every_intrinsic_is_python_too():
    assert all(callable(getattr(subset, name)) for name in INTRINSICS)
