"""Rules for a user's stage beyond those of the subset and the proof.

It writes only its own fields and the estimate, does not access fields written by interrupts, and
its loops end after a proved number of iterations.
"""

import ast

from canroll.codegen.proof.interpreter import UNROLLED
from canroll.codegen.proof.prove import Proof
from canroll.codegen.proof.service_rules import STATE, foreign_stores
from canroll.codegen.subset.parse import load
from canroll.codegen.subset.program import (
    Constant,
    FieldReference,
    Function,
    Program,
    SubsetError,
)
from canroll.codegen.subset.walk import walk

NAME = "stage"
ESTIMATE = "x"
"""The field of the loop that a stage may change."""


def check(program: Program, proof: Proof) -> None:
    """Raise SubsetError, with file and line, for a violated rule or a failed proof."""
    if NAME not in program.modules:
        return
    module = program.modules[NAME]
    own = set(program.record(STATE).fields) - set(load("state").record(STATE).fields)
    for function in module.functions.values():
        for place in foreign_stores(program, function, allowed={*own, ESTIMATE}, own={NAME}):
            rule = f"a stage stores in its own fields and in ecu.{ESTIMATE} only"
            raise SubsetError(module.path, place, rule)
        for node in walk(function.node):
            match program.refs.get(node):
                case FieldReference(owner, record, field) if record == STATE and field.volatile:
                    name = f"{owner}.{field.name}"
                    rule = f"an interrupt writes {name}: use the inputs, such as roll_rate"
                    raise SubsetError(module.path, node, rule)
            if isinstance(node, ast.For) and proof.turns.get(node, 0) > UNROLLED:
                rule = f"a loop of up to {proof.turns[node]} rounds"
                rule = f"{rule}: limit it to {UNROLLED}, by a constant or clamp"
                raise SubsetError(module.path, node, rule)
            if isinstance(node, ast.Compare):
                _refuse_unscaled(program, function, node)
    for finding in proof.findings:
        rule = f"not proved: {finding.what}: [{finding.lo}, {finding.hi}]"
        where = module.path if finding.path == str(module.path) else finding.path
        raise SubsetError(where, finding.line, rule)  # type: ignore[arg-type]


def _refuse_unscaled(program: Program, function: Function, node: ast.Compare) -> None:
    """Refuse a field with fractional bits compared with a bare integer: a slip of units.

    The same where one is subtracted from the other first, as in ``ecu.speed - 30 > 0``.
    """
    pairs = [(node.left, node.comparators[0])]
    for side in pairs[0]:
        if isinstance(side, ast.BinOp) and isinstance(side.op, ast.Add | ast.Sub):
            pairs.append((side.left, side.right))
    module = program.modules[function.module]
    for pair in pairs:
        for side, other in (pair, pair[::-1]):
            ref = program.refs.get(side)
            field = ref.field if isinstance(ref, FieldReference) else None
            if field is not None and field.q and _bare(program, other, field.q):
                value, unit = ast.unparse(other), f" {field.unit}" if field.unit else ""
                rule = (
                    f"{ast.unparse(side)} has {field.q} fractional bits: {value}{unit} is "
                    f"'{value} << {field.q}'"
                )
                raise SubsetError(module.path, node, rule)


def _bare(program: Program, node: ast.expr, q: int) -> bool:
    """Whether a number lacks ``q`` fractional bits: a literal, or a small constant of the stage.

    A constant is taken as scaled from 2^(q/2) on: in a field of 20 bits, from a thousandth of the
    unit.
    """
    literal = node.operand if isinstance(node, ast.UnaryOp) else node
    if isinstance(literal, ast.Constant):
        return literal.value != 0
    match program.refs.get(literal):
        case Constant(module=module, value=int(value)) if module == NAME:
            return 0 < abs(value) < 1 << (q // 2)
    return False
