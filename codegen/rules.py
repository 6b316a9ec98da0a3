"""The rules of the integer subset for function bodies, each with the words a refusal says.

C and Python disagree about scope, about when an operand is read and about what a condition is
worth; a construct where they could is refused rather than translated with care. What remains means
the same in both.
"""

import ast
import re
from collections.abc import Callable

from codegen.effects import writers
from codegen.program import (
    CONST_RECORD,
    INTRINSICS,
    KINDS,
    Function,
    Module,
    Program,
    SubsetError,
    evaluate,
)

C_WORDS = frozenset(
    re.findall(
        r"\w+",
        "auto break case char const continue default do double else enum extern float for goto if "
        "inline int long register restrict return short signed sizeof static struct switch "
        "typedef union unsigned void volatile while asm main",
    )
)
ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)
COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)


def check(program: Program) -> None:
    """Raise SubsetError for the first construct of any function that is outside the subset."""
    written = writers(program)
    for function in program.functions():
        _Checker(program, function, written).run()


class _Checker:
    """Checks one function; ``scope`` holds the locals that C would see here."""

    def __init__(
        self,
        program: Program,
        function: Function,
        written: dict[tuple[str, str], frozenset[str]],
    ) -> None:
        self.program = program
        self.function = function
        self.module: Module = program.modules[function.module]
        self.written = written
        self.scope: list[dict[str, str]] = [{}]
        self.loops: list[str] = []

    def refuse(self, node: ast.AST, rule: str) -> SubsetError:
        return SubsetError(self.module.path, node, rule)

    def run(self) -> None:
        for name, its in self.function.parameters.items():
            self.name(self.function.node, name)
            self.scope[0][name] = its.kind if not its.shape else "array"
        self.block(self.function.node.body, documented=True)
        if self.function.result is not None and not _returns(self.function.node.body):
            raise self.refuse(self.function.node, f"{self.function.name} must end in a return")

    def name(self, node: ast.AST, name: str) -> None:
        if name in C_WORDS or name.startswith("__") or name.endswith("_t"):
            raise self.refuse(node, f"'{name}' has another meaning in C")
        if name in KINDS or name in INTRINSICS:
            raise self.refuse(node, f"'{name}' is a word of the subset")

    def known(self, name: str) -> str | None:
        return next((level[name] for level in reversed(self.scope) if name in level), None)

    # statements

    def block(self, statements: list[ast.stmt], *, documented: bool = False) -> None:
        self.scope.append({})
        for i, statement in enumerate(statements):
            text = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
            if text and documented and i == 0:
                continue
            self.statement(statement)
        self.scope.pop()

    def statement(self, node: ast.stmt) -> None:
        handler: dict[type[ast.stmt], Callable[..., None]] = {
            ast.AnnAssign: self.declaration,
            ast.Assign: self.assignment,
            ast.AugAssign: self.augmented,
            ast.If: self.condition,
            ast.For: self.loop,
            ast.Return: self.end,
            ast.Expr: self.call,
        }
        if type(node) not in handler:
            raise self.refuse(node, f"{_words(node)} is not in the subset")
        handler[type(node)](node)

    def declaration(self, node: ast.AnnAssign) -> None:
        if not isinstance(node.target, ast.Name) or ast.unparse(node.annotation) not in KINDS:
            raise self.refuse(node, "a local is declared as name: i32, i64 or u8 = value")
        if node.value is None:
            raise self.refuse(node, f"{node.target.id} needs a value where it is declared")
        name = node.target.id
        self.name(node, name)
        if self.known(name) is not None:
            raise self.refuse(node, f"{name} is declared twice")
        self.number(node.value)
        self.order(node.value, ())
        self.scope[-1][name] = ast.unparse(node.annotation)

    def assignment(self, node: ast.Assign) -> None:
        if len(node.targets) != 1:
            raise self.refuse(node, "one assignment at a time")
        self.target(node.targets[0])
        self.number(node.value)
        self.order(node.value, (node.targets[0],))

    def augmented(self, node: ast.AugAssign) -> None:
        if not isinstance(node.op, ARITHMETIC):
            raise self.refuse(node, f"operator {_words(node.op)} is not in the subset: use tdiv")
        self.target(node.target)
        self.number(node.value)
        self.count(node.op, node.value)
        self.order(node.value, (node.target,), augmented=True)

    def target(self, node: ast.expr) -> None:
        if isinstance(node, ast.Name):
            if node.id in self.loops:
                raise self.refuse(node, f"the loop counter {node.id} belongs to its loop")
            if self.known(node.id) is None:
                raise self.refuse(node, f"{node.id} is not declared here: name: type = value")
            if self.known(node.id) not in KINDS:
                raise self.refuse(node, f"{node.id} is no scalar")
            return
        if not isinstance(node, ast.Attribute | ast.Subscript):
            raise self.refuse(node, f"{_words(node)} can't be assigned")
        base = self.place(node)
        if self.function.parameters[base].record == CONST_RECORD:
            raise self.refuse(node, "the calibration is constant")

    def condition(self, node: ast.If) -> None:
        self.truth(node.test)
        self.block(node.body)
        if node.orelse:
            self.block(node.orelse)

    def loop(self, node: ast.For) -> None:
        call = node.iter
        if not isinstance(call, ast.Call) or ast.unparse(call.func) != "range" or call.keywords:
            raise self.refuse(node, "a loop is: for name in range(…)")
        if not isinstance(node.target, ast.Name) or node.orelse:
            raise self.refuse(node, "a loop has one counter and no else")
        if not 1 <= len(call.args) <= 3:
            raise self.refuse(node, "range takes one to three bounds")
        if len(call.args) == 3:
            step = evaluate(self.program, self.module, call.args[2])
            if step == 0:
                raise self.refuse(node, "a loop's step is not 0")
        for bound in call.args:
            self.number(bound)
            self.steady(bound, node)
        name = node.target.id
        if name != "_":
            self.name(node, name)
            if self.known(name) is not None:
                raise self.refuse(node, f"{name} is declared twice")
        self.scope.append({name: "i32"})
        self.loops.append(name)
        self.block(node.body)
        self.loops.pop()
        self.scope.pop()

    def steady(self, bound: ast.expr, loop: ast.For) -> None:
        """Python reads a bound once, C every round: it must not change in the loop."""
        inside = {
            target.id
            for node in ast.walk(loop)
            for target in (node.targets if isinstance(node, ast.Assign) else [])
            + ([node.target] if isinstance(node, ast.AugAssign) else [])
            if isinstance(target, ast.Name)
        }
        for node in ast.walk(bound):
            if isinstance(node, ast.Name) and node.id in inside:
                raise self.refuse(bound, f"the loop changes its bound {node.id}")
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                given = self.function.parameters.get(node.value.id)
                if given is not None and given.record != CONST_RECORD:
                    raise self.refuse(bound, "a loop's bound is a constant, a local or calibrated")
            if isinstance(node, ast.Call):
                raise self.refuse(bound, "a loop's bound calls nothing")

    def end(self, node: ast.Return) -> None:
        if (node.value is None) != (self.function.result is None):
            raise self.refuse(node, f"{self.function.name} is declared to return otherwise")
        if node.value is not None:
            self.number(node.value)
            self.order(node.value, ())

    def call(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Call):
            raise self.refuse(node, "an expression without effect")
        self.arguments(node.value)
        self.order(node.value, ())

    # expressions

    def truth(self, node: ast.expr) -> None:
        """A condition: comparisons joined by and, or, not."""
        if isinstance(node, ast.BoolOp):
            for part in node.values:
                self.truth(part)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self.truth(node.operand)
        elif isinstance(node, ast.Compare):
            if len(node.ops) != 1:
                raise self.refuse(node, "one comparison at a time: join them by 'and'")
            if not isinstance(node.ops[0], COMPARISONS):
                raise self.refuse(node, f"{_words(node.ops[0])} is no comparison of integers")
            self.number(node.left)
            self.number(node.comparators[0])
            self.order(node, ())
        else:
            raise self.refuse(node, "a condition is a comparison: write '!= 0'")

    def number(self, node: ast.expr) -> None:
        """An expression with an integer value."""
        if isinstance(node, ast.Constant):
            if type(node.value) is not int:
                raise self.refuse(node, f"{node.value!r}: only integers")
        elif isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
            self.scalar(node)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            self.number(node.operand)
        elif isinstance(node, ast.BinOp):
            if not isinstance(node.op, ARITHMETIC):
                raise self.refuse(
                    node, f"operator {_words(node.op)} is not in the subset: use tdiv"
                )
            self.number(node.left)
            self.number(node.right)
            self.count(node.op, node.right)
        elif isinstance(node, ast.Call):
            self.arguments(node)
            called = self.program.function(self.module, node.func)
            if called is not None and called.result is None:
                raise self.refuse(node, f"{called.name} returns nothing")
        elif isinstance(node, ast.Compare | ast.BoolOp):
            raise self.refuse(node, "a comparison is no number: use if")
        else:
            raise self.refuse(node, f"{_words(node)} is not in the subset")

    def count(self, op: ast.operator, node: ast.expr) -> None:
        if isinstance(op, ast.LShift | ast.RShift):
            try:
                count = evaluate(self.program, self.module, node)
            except SubsetError as error:
                rule = "a shift count is a constant: use rsh for a calibrated one"
                raise self.refuse(node, rule) from error
            if not isinstance(count, int) or not 0 <= count <= 62:
                raise self.refuse(node, "a shift count lies in 0 … 62")

    def scalar(self, node: ast.expr) -> None:
        if isinstance(node, ast.Name):
            if self.known(node.id) in KINDS and node.id != "_":
                return
            if self.known(node.id) is not None:
                raise self.refuse(node, f"{node.id} is no number")
        if isinstance(node, ast.Name | ast.Attribute):
            if self.program.limit(self.module, node) is not None:
                return
            constant = self.program.constant(self.module, node)
            if constant is not None:
                if constant.type.shape:
                    raise self.refuse(node, f"{constant.name} is a table: give its indices")
                return
            if isinstance(node, ast.Name):
                raise self.refuse(node, f"{node.id} is not known here")
        self.place(node)
        if self.depth(node) != 0:
            raise self.refuse(node, f"{ast.unparse(node)} is an array: give its indices")

    def depth(self, node: ast.expr) -> int:
        """Indices that ``node`` still lacks to be a scalar."""
        if isinstance(node, ast.Subscript):
            return self.depth(node.value) - 1
        constant = self.program.constant(self.module, node)
        if constant is not None:
            return len(constant.type.shape)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            given = self.function.parameters[node.value.id]
            return len(self.program.record(given.record).fields[node.attr].type.shape)
        assert isinstance(node, ast.Name)
        return len(self.function.parameters[node.id].shape)

    def place(self, node: ast.expr) -> str:
        """Check a field, an element or a parameter array; return the parameter it belongs to."""
        if isinstance(node, ast.Subscript):
            if isinstance(node.slice, ast.Slice | ast.Tuple):
                raise self.refuse(node, "an index is one number: a[i][j], no slices")
            self.number(node.slice)
            base = self.place(node.value)
            if self.depth(node) < 0:
                raise self.refuse(node, f"{ast.unparse(node.value)} is no array")
            return base
        named = isinstance(node, ast.Name | ast.Attribute)
        if named and self.program.constant(self.module, node) is not None:
            return ""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            given = self.function.parameters.get(node.value.id)
            if given is None or given.kind != "record":
                raise self.refuse(node, f"{node.value.id} is no record")
            if node.attr not in self.program.record(given.record).fields:
                raise self.refuse(node, f"{given.record} has no field {node.attr}")
            return node.value.id
        if isinstance(node, ast.Name) and node.id in self.function.parameters:
            return node.id
        raise self.refuse(node, f"{ast.unparse(node)} is no field, array or table")

    def arguments(self, node: ast.Call) -> None:
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise self.refuse(node, "arguments are positional")
        intrinsic = self.program.intrinsic(self.module, node.func)
        if intrinsic is not None:
            if len(node.args) != INTRINSICS[intrinsic]:
                raise self.refuse(node, f"{intrinsic} takes {INTRINSICS[intrinsic]} arguments")
            for argument in node.args:
                self.number(argument)
            return
        called = self.program.function(self.module, node.func)
        if called is None:
            raise self.refuse(node, f"{ast.unparse(node.func)} is no function of the firmware")
        if len(node.args) != len(called.parameters):
            raise self.refuse(node, f"{called.name} takes {len(called.parameters)} arguments")
        for argument, its in zip(node.args, called.parameters.values(), strict=True):
            if its.kind == "record":
                given = argument.id if isinstance(argument, ast.Name) else ""
                if given not in self.function.parameters:
                    raise self.refuse(argument, f"{called.name} needs a {its.record}")
                if self.function.parameters[given] != its:
                    raise self.refuse(argument, f"{called.name} needs a {its.record}")
            elif its.shape:
                self.place(argument)
                if self.depth(argument) != len(its.shape):
                    raise self.refuse(argument, f"{called.name} needs an array of {its.shape}")
            else:
                self.number(argument)

    def order(
        self, node: ast.expr, targets: tuple[ast.expr, ...], *, augmented: bool = False
    ) -> None:
        """C leaves the order of operands open: a call that writes must not meet other reads."""
        effects = [inner for inner in ast.walk(node) if self.writes(inner)]
        if not effects:
            return
        if len(effects) > 1:
            raise self.refuse(node, "two calls that write in one expression: C orders them freely")
        inside = set(ast.walk(effects[0]))
        outside = [inner for inner in ast.walk(node) if inner not in inside]
        for target in targets:
            outside += list(ast.walk(target)) if augmented else list(ast.walk(target))[1:]
        for inner in outside:
            if (
                isinstance(inner, ast.Attribute)
                and self.program.constant(self.module, inner) is None
                and inner not in self._owners(targets)
            ):
                raise self.refuse(node, "a call that writes beside a read: C orders them freely")

    def _owners(self, targets: tuple[ast.expr, ...]) -> set[ast.AST]:
        """The field an assignment writes is no read of it."""
        found: set[ast.AST] = set()
        for target in targets:
            base = target
            while isinstance(base, ast.Subscript):
                base = base.value
            found.add(base)
        return found

    def writes(self, node: ast.AST) -> bool:
        if not isinstance(node, ast.Call):
            return False
        called = self.program.function(self.module, node.func)
        return called is not None and called.key in self.written


def _returns(statements: list[ast.stmt]) -> bool:
    last = statements[-1]
    if isinstance(last, ast.If):
        return bool(last.orelse) and _returns(last.body) and _returns(last.orelse)
    return isinstance(last, ast.Return)


def _words(node: ast.AST) -> str:
    words = {
        "While": "while",
        "FloorDiv": "//",
        "Mod": "%",
        "Div": "/",
        "Pow": "**",
        "With": "with",
        "Try": "try",
        "FunctionDef": "a function in a function",
        "Lambda": "lambda",
        "IfExp": "a conditional expression",
        "ListComp": "a comprehension",
        "List": "a list",
        "Tuple": "a tuple",
        "Pass": "pass",
        "Invert": "~",
    }
    name = type(node).__name__
    return words.get(name, name.lower())
