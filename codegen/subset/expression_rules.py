"""The rules of the integer subset for expressions, each with the message of its refusal."""

import ast

from codegen.subset.program import (
    CONST_RECORD,
    INTRINSICS,
    KINDS,
    MEMORY,
    WRITERS,
    Function,
    Module,
    Program,
    SubsetError,
    evaluate,
)
from codegen.subset.walk import walk

ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)
COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.Eq, ast.NotEq)


class ExpressionRules:
    """Checks the expressions of one function; ``scope`` holds the locals visible to C here."""

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

    def refuse(self, node: ast.AST, rule: str) -> SubsetError:
        """The error that refuses ``node`` by ``rule``."""
        return SubsetError(self.module.path, node, rule)

    def known(self, name: str) -> str | None:
        """Kind of a local that is visible here, or None."""
        return next((level[name] for level in reversed(self.scope) if name in level), None)

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
                raise self.refuse(node, f"{words(node.ops[0])} is not a comparison of integers")
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
                raise self.refuse(node, f"operator {words(node.op)} is not in the subset: use tdiv")
            self.number(node.left)
            self.number(node.right)
            self.count(node.op, node.right)
        elif isinstance(node, ast.Call):
            self.arguments(node)
            called = self.program.function(self.module, node.func)
            if called is not None and called.result is None:
                raise self.refuse(node, f"{called.name} returns nothing")
            intrinsic = self.program.intrinsic(self.module, node.func)
            if intrinsic in WRITERS:
                raise self.refuse(node, f"{intrinsic} returns nothing")
        elif isinstance(node, ast.Compare | ast.BoolOp):
            raise self.refuse(node, "a comparison is not a number: use if")
        else:
            raise self.refuse(node, f"{words(node)} is not in the subset")

    def count(self, op: ast.operator, node: ast.expr) -> None:
        """The right operand of a shift."""
        if isinstance(op, ast.LShift | ast.RShift):
            try:
                count = evaluate(self.program, self.module, node)
            except SubsetError as error:
                rule = "a shift count is a constant: use rsh for a calibrated one"
                raise self.refuse(node, rule) from error
            if not isinstance(count, int) or not 0 <= count <= 62:
                raise self.refuse(node, "a shift count must be 0 to 62")

    def scalar(self, node: ast.expr) -> None:
        """A name, field or element with one value."""
        if isinstance(node, ast.Name):
            if self.known(node.id) in KINDS and node.id != "_":
                return
            if self.known(node.id) is not None:
                raise self.refuse(node, f"{node.id} is not a number")
        if isinstance(node, ast.Name | ast.Attribute):
            if self.program.limit(self.module, node) is not None:
                return
            constant = self.program.constant(self.module, node)
            if constant is not None:
                if constant.type.shape:
                    raise self.refuse(node, f"{constant.name} is a table: give its indices")
                return
            if isinstance(node, ast.Name):
                raise self.refuse(node, f"{node.id} is not defined here")
        self.place(node)
        if self.depth(node) != 0:
            raise self.refuse(node, f"{ast.unparse(node)} is an array: give its indices")

    def depth(self, node: ast.expr) -> int:
        """Number of indices that ``node`` still needs to be a scalar."""
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
                raise self.refuse(node, f"{ast.unparse(node.value)} is not an array")
            return base
        named = isinstance(node, ast.Name | ast.Attribute)
        if named and self.program.constant(self.module, node) is not None:
            return ""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            given = self.function.parameters.get(node.value.id)
            if given is None or given.kind != "record":
                raise self.refuse(node, f"{node.value.id} is not a record")
            if node.attr not in self.program.record(given.record).fields:
                raise self.refuse(node, f"{given.record} has no field {node.attr}")
            return node.value.id
        if isinstance(node, ast.Name) and node.id in self.function.parameters:
            return node.id
        raise self.refuse(node, f"{ast.unparse(node)} is not a field, array or table")

    def arguments(self, node: ast.Call) -> None:
        """Check the arguments of a call against its parameters."""
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise self.refuse(node, "arguments are positional")
        intrinsic = self.program.intrinsic(self.module, node.func)
        if intrinsic is not None:
            if len(node.args) != INTRINSICS[intrinsic]:
                raise self.refuse(node, f"{intrinsic} takes {INTRINSICS[intrinsic]} arguments")
            numbers = node.args
            if intrinsic in (*MEMORY, *WRITERS, "bytes_of"):
                self.record(node.args[0], intrinsic)
                numbers = node.args[1:]
            for argument in numbers:
                self.number(argument)
            return
        called = self.program.function(self.module, node.func)
        if called is None:
            raise self.refuse(node, f"{ast.unparse(node.func)} is not a function of the firmware")
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

    def record(self, node: ast.expr, reader: str) -> None:
        """Check the record argument of a function that reads memory."""
        given = self.function.parameters.get(node.id) if isinstance(node, ast.Name) else None
        if given is None or given.kind != "record":
            raise self.refuse(node, f"{reader} takes a record")
        if reader == "clear" and given.record == CONST_RECORD:
            raise self.refuse(node, "the calibration is constant")
        if reader in ("set_octet", "set_word") and given.record != CONST_RECORD:
            raise self.refuse(node, f"{reader} writes a calibration: assign the fields of others")

    def order(
        self, node: ast.expr, targets: tuple[ast.expr, ...], *, augmented: bool = False
    ) -> None:
        """Refuse a writing call among other reads: C does not define the order of operands."""
        effects = [inner for inner in walk(node) if self.writes(inner)]
        if not effects:
            return
        if len(effects) > 1:
            raise self.refuse(node, "two calls that write in one expression: C orders them freely")
        inside = set(walk(effects[0]))
        outside = [inner for inner in walk(node) if inner not in inside]
        for target in targets:
            outside += list(walk(target)) if augmented else list(walk(target))[1:]
        for inner in outside:
            if (
                isinstance(inner, ast.Attribute)
                and self.program.constant(self.module, inner) is None
                and inner not in self._owners(targets)
            ):
                raise self.refuse(node, "a call that writes beside a read: C orders them freely")

    def _owners(self, targets: tuple[ast.expr, ...]) -> set[ast.AST]:
        """The base of an assignment's target, which is written and not read."""
        found: set[ast.AST] = set()
        for target in targets:
            base = target
            while isinstance(base, ast.Subscript):
                base = base.value
            found.add(base)
        return found

    def writes(self, node: ast.AST) -> bool:
        """Whether ``node`` calls a function that writes its arguments."""
        if not isinstance(node, ast.Call):
            return False
        if self.program.intrinsic(self.module, node.func) in WRITERS:
            return True
        called = self.program.function(self.module, node.func)
        return called is not None and called.key in self.written


def words(node: ast.AST) -> str:
    """The name of a construct in messages."""
    told = {
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
    return told.get(name, name.lower())
