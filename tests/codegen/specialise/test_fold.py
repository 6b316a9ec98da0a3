"""A folded expression has the value of the one it was folded from, whatever its names stand for."""

import ast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.operations.relations import RELATIONS
from codegen.operations.table import INTRINSICS, OPERATORS
from codegen.specialise import fold
from firmware import subset

NAMES = ("a", "b")
SMALL = st.integers(-40, 40)
VALUES = st.fixed_dictionaries({name: st.integers(-(2**31), 2**31 - 1) for name in NAMES})


def leaf():
    return SMALL.map(fold.literal) | st.sampled_from(NAMES).map(ast.Name)


def inner(children):
    plain = [op for op in OPERATORS if op not in (ast.LShift, ast.RShift)]
    operators = st.sampled_from(plain)
    sums = st.tuples(operators, children, children).map(lambda t: ast.BinOp(t[1], t[0](), t[2]))
    shifts = st.tuples(st.sampled_from([ast.LShift, ast.RShift]), children, st.integers(0, 8)).map(
        lambda t: ast.BinOp(t[1], t[0](), ast.Constant(t[2]))
    )
    minus = children.map(lambda e: ast.UnaryOp(ast.USub(), e))
    rounded = st.tuples(st.sampled_from(["rsh", "scaled"]), children, st.integers(1, 12)).map(
        lambda t: ast.Call(ast.Name(t[0]), [t[1], ast.Constant(t[2])], [])
    )
    limited = st.tuples(st.sampled_from(["sat31", "sat32", "byte"]), children).map(
        lambda t: ast.Call(ast.Name(t[0]), [t[1]], [])
    )
    return sums | shifts | minus | rounded | limited


EXPRESSIONS = st.recursive(leaf(), inner, max_leaves=12)
CONDITIONS = st.recursive(
    st.tuples(st.sampled_from([*RELATIONS]), leaf(), leaf()).map(
        lambda t: ast.Compare(t[1], [t[0]()], [t[2]])
    ),
    lambda c: (
        st.tuples(st.sampled_from([ast.And, ast.Or]), st.lists(c, min_size=2, max_size=3)).map(
            lambda t: ast.BoolOp(t[0](), t[1])
        )
        | c.map(lambda e: ast.UnaryOp(ast.Not(), e))
    ),
    max_leaves=8,
)


def folded(node, values):
    """``node`` rebuilt by the rules, with what ``values`` say of its names known."""
    if isinstance(node, ast.Name):
        return fold.literal(values[node.id]) if node.id in values else node
    return fold.mapped(node, lambda inner: folded(inner, values))


def worth(node, values):
    words = {name: getattr(subset, name) for name in INTRINSICS if hasattr(subset, name)}
    return eval(ast.unparse(ast.fix_missing_locations(node)), words | values)


@given(EXPRESSIONS | CONDITIONS, VALUES, st.sets(st.sampled_from(NAMES)))
def test_folding_keeps_the_value(node, values, known):
    told = {name: values[name] for name in known}
    assert worth(folded(node, told), values) == worth(node, values)


@given(EXPRESSIONS, VALUES)
def test_what_is_known_is_one_number(node, values):
    assert fold.known(folded(node, values)) == worth(node, values)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0 * a + 1 * b", "b"),
        ("0 * a", "0"),
        ("rsh(4 * a + 8 * b, 2)", "a + b * 2"),
        ("scaled(8 * a, 3)", "sat31(a)"),
        ("scaled(8 * a + b, 3)", "scaled(a * 8 + b, 3)"),
        ("3 < a", "a > 3"),
        ("1 < 2 and a > 0", "a > 0"),
        ("1 > 2 or a > 0", "a > 0"),
        ("1 > 2 and a > 0", "False"),
    ],
)
def test_what_falls_away(text, expected):
    node = ast.parse(text, mode="eval").body
    assert ast.unparse(ast.fix_missing_locations(folded(node, {}))) == expected


def test_a_call_that_may_write_is_never_dropped():
    call = ast.Call(ast.Name("take"), [ast.Name("ecu")], [])
    kept = fold.operation(ast.Mult(), call, ast.Constant(0))
    assert "take(ecu)" in ast.unparse(kept)
