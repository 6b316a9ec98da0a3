"""Nothing but the subset is executed, wherever it stands in a module that a file contains."""

import ast
import builtins
import copy

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from canroll.codegen.operations.table import INTRINSICS
from canroll.codegen.subset import grammar, rules
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import SubsetError
from canroll.errors import CanrollError

GOOD = '''"""Sample."""

from typing import Annotated

from canroll.firmware.subset import F, clamp, i32, i64, record, u8

__all__ = ["weighted"]

N = 3
A, B = 1, 2 * N
WEIGHTS: tuple[i32, ...] = (1, -3, 5)
ROWS: tuple[tuple[u8, ...], ...] = ((1, 2), (3, 4))


@record
class Own:
    """A record."""

    factor: Annotated[i32, F(0, 1 << 16, 16, "Nm", "a factor")]
    rows: Annotated[list[list[i32]], N, 2, F(-5, 5, 0, "", "rows", True)]


def weighted(payload: Annotated[list[u8], N], own: Own, identifier: i32) -> i64:
    """Return a sum."""
    total: i64 = identifier
    for k in range(N):
        total += (WEIGHTS[k] * payload[k]) << 2
        own.rows[k][0] = 1
    if total > 3 and not own.factor == 1:
        total = clamp(total, 0, A)
    elif total < -2:
        own.factor = 2
    else:
        clear_it(own)
    return spread(total) + ROWS[1][0]


def spread(value: i64) -> i64:
    return (value >> 1) ^ value


def clear_it(own: Own) -> None:
    own.factor = 0
'''
EXPRESSIONS = (
    *("1", "N", "-B", "clamp(1, 0, 2)", "spread(1)", "own.factor", "WEIGHTS[0]", "i32", "Own"),
    *("spring()", "spring", "[spring()]", "{spring()}", "{1: spring()}", "(spring(),)"),
    *("(lambda: spring())()", "lambda: spring()", "f'{spring()}'", "(x := spring())"),
    *("[spring() for _ in (0,)]", "spring() if 1 else 0", "spring()[0]", "spring().a"),
    *("-spring()", "not spring()", "1 + spring()", "0 or spring()", "spring() < 1"),
    *("'spring()'", "list['spring()']", "Annotated['spring()', 1]", "list[i32, 'spring()']"),
    *("tuple[spring(), ...]", "Annotated[i32, F(spring(), 1, 0, '', '')]", "F(0, 1, 0, '', '')"),
    *("__import__('builtins').spring()", "clamp.__globals__", "eval('spring()')", "own.__class__"),
    *("clamp(spring(), 0, 1)", "i32(spring())", "record(spring())", "1.5", "...", "True", "None"),
    *("'text'", "b''", "2 ** 2 ** 9", "1 << 64 << 64 << 64", "N[spring()]", "N[0:spring()]"),
)
STATEMENTS = (
    *("spring()", "import os", "from os import *", "from canroll.firmware.subset import *", "pass"),
    *("from canroll.firmware.subset import get_type_hints", "from canroll.firmware import subset"),
    "x = spring()",
    *("__all__ = [spring()]", "__all__ = x = ['a']", "__builtins__ = 1", "x: spring() = 1"),
    *("x: 'spring()' = 1", "x: tuple[i32, spring()] = 1", "x: i32 = spring()", "x.y = spring()"),
    *(
        "@spring\ndef g() -> None:\n    N",
        "@spring()\nclass G:\n    x: i32",
        "while spring(): pass",
    ),
    *("def g(a: i32 = spring()) -> i32:\n    return a", "def g(a: spring()) -> i32:\n    return a"),
    *("def g() -> spring():\n    return 1", "def g(a: 'spring()') -> None:\n    a = 1"),
    *("class G(spring()):\n    pass", "class G(metaclass=spring()):\n    pass", "del N"),
    *(
        "@record\nclass G(Own, metaclass=spring()):\n    pass",
        "@record\nclass G:\n    x: 'spring()'",
    ),
    *("@record\nclass G:\n    x: Annotated[i32, F(spring(), 1, 0, '', ''), F(0, 1, 0, '', '')]",),
    *(
        "@record\nclass G:\n    x: Annotated[i32, F(0, 1, 0, '', '')] = spring()",
        "def F() -> None: N",
    ),
    *("def __getattr__(name: i32) -> i32:\n    return spring()", "record = spring", "global N"),
    *("assert spring()", "with spring(): pass", "for i in spring(): pass", "raise spring()"),
    *(
        "try:\n    N\nfinally:\n    spring()",
        "match spring():\n    case 1: pass",
        "return spring()",
    ),
    *("async def g() -> None:\n    await spring()", "yield_ = (yield spring())", "x: i32 = 1"),
)
NAMES = ("spring", "eval", "__builtins__", "list", "N", "clamp", "payload", "F", "Own", "record")
ATTRIBUTES = ("__class__", "__globals__", "factor", "_x", "rows")
NODES = (
    *(ast.Module, ast.ImportFrom, ast.alias, ast.FunctionDef, ast.arguments, ast.arg),
    *(ast.ClassDef, ast.Assign, ast.AnnAssign, ast.AugAssign, ast.Expr, ast.If, ast.For),
    *(ast.Return, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Call, ast.Constant),
    *(ast.Name, ast.Attribute, ast.Subscript, ast.Tuple, ast.List, ast.expr_context),
    *(ast.operator, ast.unaryop, ast.boolop, ast.cmpop),
)


@pytest.fixture
def accepted(tmp_path, monkeypatch):
    """Return a function that says whether a module is accepted; one that is is executed."""
    sprung = []
    monkeypatch.setattr(builtins, "spring", lambda: sprung.append(1) or 1, raising=False)

    def judge(source):
        (tmp_path / "maker.py").write_text(source, encoding="utf-8")
        try:
            rules.check(load("maker", tmp_path))
        except CanrollError as error:
            assert "\n" not in str(error)
            return False
        tree = ast.parse(source)
        functions = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
        for node in ast.walk(tree):
            assert isinstance(node, NODES), ast.dump(node)
            if isinstance(node, ast.Call):
                assert ast.unparse(node.func) in {*functions, *INTRINSICS, "range", "F"}
            if isinstance(node, ast.Attribute):
                assert not node.attr.startswith("_")
        exec(compile(source, "maker", "exec"), {"__name__": "maker"})
        assert not sprung, source
        return True

    return judge


def mutated(data):
    """The good module with one to three places replaced, renamed or inserted into."""
    tree = ast.parse(GOOD)
    for _ in range(data.draw(st.integers(1, 3))):
        nodes = [node for node in ast.walk(tree) if not isinstance(node, ast.expr_context)]
        node = data.draw(st.sampled_from(nodes))
        kind = data.draw(st.integers(0, 2))
        fields = [name for name, value in ast.iter_fields(node) if isinstance(value, ast.expr)]
        lists = [name for name, value in ast.iter_fields(node) if isinstance(value, list)]
        if kind == 0 and isinstance(node, ast.Name | ast.Attribute):
            name = "id" if isinstance(node, ast.Name) else "attr"
            setattr(node, name, data.draw(st.sampled_from(NAMES if name == "id" else ATTRIBUTES)))
        elif kind == 1 and fields:
            text = data.draw(st.sampled_from(EXPRESSIONS))
            setattr(node, data.draw(st.sampled_from(fields)), ast.parse(text).body[0].value)
        elif lists:
            name = data.draw(st.sampled_from(lists))
            values = getattr(node, name)
            place = data.draw(st.integers(0, len(values)))
            if name in ("body", "orelse"):
                text = data.draw(st.sampled_from(STATEMENTS))
                values[place:place] = ast.parse(text).body
            elif values and data.draw(st.booleans()):
                values.insert(place, copy.deepcopy(data.draw(st.sampled_from(values))))
            elif name in (
                "elts",
                "args",
                "bases",
                "decorator_list",
                "defaults",
                "targets",
                "values",
            ):
                text = data.draw(st.sampled_from(EXPRESSIONS))
                values.insert(place, ast.parse(text).body[0].value)
    return ast.unparse(ast.fix_missing_locations(tree))


def fuzzed(accepted, examples):
    @settings(max_examples=examples)
    @given(st.data())
    def attempt(data):
        try:
            source = mutated(data)
            ast.parse(source)
        except (ValueError, TypeError, AttributeError, SyntaxError):
            return  # what no text says
        event(f"accepted: {accepted(source)}")

    attempt()


def test_the_sample_is_accepted(accepted):
    assert accepted(GOOD)


@pytest.mark.slow
def test_what_is_accepted_executes_nothing(accepted):
    fuzzed(accepted, 1000)


@pytest.mark.long
def test_of_many_none_that_is_accepted_executes_anything(accepted):
    fuzzed(accepted, 100_000)


@pytest.mark.parametrize("text", STATEMENTS)
def test_a_statement_that_executes_is_refused_at_the_top(accepted, text):
    assert accepted(f"{GOOD}\n\n{text}\n") == (text == "x: i32 = 1")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('["weighted"]', "[spring()]"),
        ("list[u8], N]", "list[u8], N, F(spring(), 1, 0, '', '')]"),
        ("list[u8], N]", "spring()[u8], N]"),
        ("tuple[i32, ...]", "tuple[i32, spring()]"),
        ("tuple[i32, ...]", "spring()[i32]"),
        ("list[list[i32]], N", "list[list[i32, 'spring()']], N"),
        ("[i32, F(0", "[i32, F(spring(), 1, 0, '', ''), F(0"),
        ('"a factor")]', '"a factor")] = spring()'),
        ("class Own:", "class Own(metaclass=spring):"),
    ],
)
def test_a_call_where_the_parser_did_not_look_is_refused(accepted, before, after):
    assert GOOD.count(before) >= 1
    assert not accepted(GOOD.replace(before, after, 1))


def test_no_other_encoding_says_anything_else(accepted):
    """CPython reads a file that it imports in the encoding that its first lines name."""
    assert not accepted("# coding: utf-7\n# +AAo-spring()\n" + GOOD)
    assert accepted("# coding: utf-8\n" + GOOD)


@pytest.mark.parametrize(
    "text",
    [
        "X = " + "-" * 90_000 + "1",
        "X = " + "1 + " * 20_000 + "1",
        "X = " + "(" * 150 + "1" + ")" * 150,
        "X = 0x" + "f" * 90_000,
        "X = " + "9" * 90_000,
        "X = " + "(" * 6 + "2" + " ** 64)" * 6,
        "def f() -> None:\n"
        + "".join(f"{' ' * k}if 1 > 0:\n" for k in range(1, 90))
        + " " * 90
        + "f()",
    ],
    ids=["signs", "sum", "brackets", "digits", "decimals", "power", "blocks"],
)
def test_depth_and_size_are_bounded(accepted, text):
    assert accepted(f"{GOOD}\n\n{text}\n") == text.startswith("X = (((((((")


def test_a_grammar_names_file_and_line(tmp_path):
    with pytest.raises(SubsetError, match=r"x\.py:2: 'spring\(\)' is not in the subset"):
        grammar.check(tmp_path / "x.py", ast.parse('"""Doc."""\nX = spring()\n'))
