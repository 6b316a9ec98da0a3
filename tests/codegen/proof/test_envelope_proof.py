"""The envelope alone, proved for every state and calibration: its limits hold whatever comes in.

Its source is run on symbols: z3 finds no outputs of a law, no state and no limits for which what
leaves the envelope exceeds the moment limit, or changes faster than the slew allows.
"""

import ast

import pytest

from canroll.codegen.operations.intervals import BITS_31, KINDS
from canroll.codegen.operations.relations import RELATIONS
from canroll.codegen.operations.table import OPERATORS
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import Constant, FieldReference, Function
from canroll.firmware.calibration import Calibration
from canroll.firmware.state import Ecu
from canroll.firmware.subset import fields

z3 = pytest.importorskip("z3", reason="needs z3-solver: the extra judges")

PROGRAM = load()
LIMITS = {field.name: field.f for record in (Ecu, Calibration) for field in fields(record)}


class Symbolic:
    """Runs functions of the subset on z3's integers; both branches of an ``if`` are merged."""

    def __init__(self):
        self.fields = {}
        self.known = []

    def field(self, name, index=0):
        if (name, index) not in self.fields:
            its = self.fields[name, index] = z3.Int(f"{name}_{index}")
            self.known += [its >= LIMITS[name].lo, its <= LIMITS[name].hi]
        return self.fields[name, index]

    def call(self, module, name, *arguments):
        function = PROGRAM.modules[module].functions[name]
        names = dict(zip(function.parameters, arguments, strict=True))
        return self.block(function.node.body, names)

    def block(self, statements, names):
        """Run statements; the value returned, or None. An early return takes the rest as else."""
        for k, node in enumerate(statements):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                continue
            if isinstance(node, ast.Return):
                return self.value(node.value, names)
            if isinstance(node, ast.If):
                return self.branches(node, statements[k + 1 :], names)
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            names[target.id] = self.value(node.value, names)
        return None

    def branches(self, node, rest, names):
        """An ``if`` and what follows it, once for each way."""
        test = self.value(node.test, names)
        yes = self.block([*node.body, *rest], dict(names))
        no = self.block([*node.orelse, *rest], dict(names))
        return z3.If(test, yes, no)

    def value(self, node, names):
        if isinstance(node, ast.Constant):
            return z3.IntVal(node.value)
        if isinstance(node, ast.UnaryOp):
            return -self.value(node.operand, names)
        if isinstance(node, ast.BoolOp):
            join = z3.And if isinstance(node.op, ast.And) else z3.Or
            return join(*(self.value(each, names) for each in node.values))
        if isinstance(node, ast.BinOp):
            sides = (self.value(each, names) for each in (node.left, node.right))
            return OPERATORS[type(node.op)].fold(*sides)
        if isinstance(node, ast.Compare):
            sides = (self.value(each, names) for each in (node.left, node.comparators[0]))
            return RELATIONS[type(node.ops[0])].holds(*sides)
        ref = PROGRAM.refs[node]
        if isinstance(node, ast.Call):
            return self.called(ref, [self.value(each, names) for each in node.args])
        if isinstance(ref, Constant):
            return z3.IntVal(ref.value)
        return self.field(ref.field.name) if isinstance(ref, FieldReference) else names[node.id]

    def called(self, ref, arguments):
        """A function, or an intrinsic that limits its first argument."""
        if isinstance(ref, Function):
            return self.call(ref.module, ref.name, *arguments)
        limits = {"clamp": arguments[1:], "sat31": (-(1 << 30), (1 << 30) - 1)}
        low, high = limits[ref.name]
        return z3.If(arguments[0] > high, high, z3.If(arguments[0] < low, low, arguments[0]))


@pytest.fixture
def leaves():
    """What leaves the envelope, and the symbols it is made of; a solver that knows their ranges."""
    run = Symbolic()
    wanted, last, elapsed = z3.Ints("wanted last elapsed")
    out = run.call("envelope", "enveloped", None, wanted, last, elapsed)
    most, slew = run.field("envelope_moment"), run.field("envelope_slew")
    solver = z3.Solver()
    solver.set("timeout", 60_000)
    low, high = KINDS["i32"]
    solver.add(*run.known, wanted >= BITS_31[0], wanted <= BITS_31[1], elapsed >= 1)
    solver.add(elapsed <= high, last >= low)
    # it left the envelope a tick ago
    solver.add(last >= -most, last <= most)
    return solver, out, (wanted, last, elapsed, most, slew)


def proved(solver, claim):
    solver.push()
    solver.add(z3.Not(claim))
    found = solver.check()
    solver.pop()
    return found == z3.unsat


def test_no_output_exceeds_the_moment_limit(leaves):
    solver, out, (_, _, _, most, _) = leaves
    assert proved(solver, z3.And(out <= most, out >= -most))
    assert not proved(solver, z3.And(out < most, out >= -most))


def test_no_output_changes_faster_than_the_slew(leaves):
    solver, out, (_, last, elapsed, _, slew) = leaves
    assert proved(solver, z3.And(out - last <= elapsed * slew, last - out <= elapsed * slew))
    assert not proved(solver, out - last < elapsed * slew)


def test_what_is_within_both_is_left_alone(leaves):
    solver, out, (wanted, last, elapsed, most, slew) = leaves
    # a step of more than 31 bits, 65 kN·m, is not taken at once
    step = z3.If(elapsed * slew > BITS_31[1], BITS_31[1], elapsed * slew)
    solver.add(wanted <= most, wanted >= -most, wanted - last <= step, last - wanted <= step)
    assert proved(solver, out == wanted)


def test_a_law_may_have_pushed_outward_only_where_the_acceleration_exceeds_its_threshold():
    run = Symbolic()
    moment, acceleration, slow = z3.Ints("moment acceleration slow")
    fallen = z3.Int("fallen")
    solver = z3.Solver()
    threshold, lateral = run.field("envelope_outward"), run.field("envelope_lateral")
    rounded = z3.And(8 * fallen >= lateral - 4, 8 * fallen <= lateral + 4)
    run.value = _with_shift(run.value, fallen)
    pushed = run.call("envelope", "outward", None, moment, acceleration, slow)
    solver.add(*run.known, rounded)
    same = z3.Or(
        z3.And(moment > threshold, acceleration > lateral),
        z3.And(moment < -threshold, acceleration < -lateral),
    )
    assert proved(solver, z3.Implies(pushed == 1, same))
    assert not proved(solver, z3.Implies(same, pushed == 1))


def _with_shift(value, fallen):
    """``rsh`` of the threshold is a symbol, whose rounding is stated."""

    def of(node, names):
        if isinstance(node, ast.Call) and PROGRAM.refs[node].name == "rsh":
            return fallen
        return value(node, names)

    return of
