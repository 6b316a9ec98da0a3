"""The rules of the integer subset for expressions, each with the message of its refusal."""

import ast

from canroll.codegen.operations.relations import RELATIONS
from canroll.codegen.operations.table import OPERATORS, Access, Operation
from canroll.codegen.subset.program import (
    CONST_RECORD,
    Constant,
    FieldReference,
    Function,
    Local,
    Module,
    Parameter,
    Program,
    RecordField,
    SubsetError,
    base,
    evaluate,
    is_scalar,
)
from canroll.codegen.subset.walk import walk


class ExpressionRules:
    """Checks the expressions of one function; ``scope`` holds the locals visible to C here."""

    def __init__(self, program: Program, function: Function) -> None:
        self.program = program
        self.function = function
        self.module: Module = program.modules[function.module]
        self.scope: list[set[str]] = [set()]

    def refuse(self, node: ast.AST, rule: str) -> SubsetError:
        """The error that refuses ``node`` by ``rule``."""
        return SubsetError(self.module.path, node, rule)

    def visible(self, name: str) -> bool:
        """Whether a scalar parameter or local of this name is declared here."""
        return any(name in level for level in self.scope)

    def declare(self, node: ast.AST, name: str, kind: str) -> None:
        """Refuse a local with the name of a parameter or another local, but one of its kind."""
        if self.visible(name) or name in self.function.parameters:
            raise self.refuse(node, f"{name} is declared twice")
        other = self.function.kinds[name]
        if other != kind:
            rule = f"{name} is {kind} here and {other} elsewhere: give one another name"
            raise self.refuse(node, rule)

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
            if type(node.ops[0]) not in RELATIONS:
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
            if type(node.op) not in OPERATORS:
                raise self.refuse(node, f"operator {words(node.op)} is not in the subset: use tdiv")
            self.number(node.left)
            self.number(node.right)
            self.count(node.op, node.right)
        elif isinstance(node, ast.Call):
            self.arguments(node)
            match self.program.refs[node]:
                case Function(name=name, result=None) | Access(name=name, writes=True):
                    raise self.refuse(node, f"{name} returns nothing")
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
        ref = self.program.refs.get(node)
        if isinstance(node, ast.Name):
            if isinstance(ref, Local) and self.visible(node.id) and node.id != "_":
                return
            if isinstance(ref, Parameter) or (isinstance(ref, Local) and node.id == "_"):
                raise self.refuse(node, f"{node.id} is not a number")
            if not isinstance(ref, Constant):
                raise self.refuse(node, f"{node.id} is not defined here")
        if isinstance(ref, Constant) and ref.type.shape and not isinstance(node, ast.Subscript):
            raise self.refuse(node, f"{ref.name} is a table: give its indices")
        if self.place(node) != 0:
            raise self.refuse(node, f"{ast.unparse(node)} is an array: give its indices")

    def place(self, node: ast.expr) -> int:
        """Check a constant, a field, an element or an array; return how many indices it lacks."""
        if isinstance(node, ast.Subscript):
            if isinstance(node.slice, ast.Slice | ast.Tuple):
                raise self.refuse(node, "an index is one number: a[i][j], no slices")
            self.number(node.slice)
            lacking = self.place(node.value)
            if lacking == 0:
                raise self.refuse(node, f"{ast.unparse(node.value)} is not an array")
            return lacking - 1
        match self.program.refs.get(node):
            case (
                Constant(type=its)
                | Parameter(type=its)
                | FieldReference(field=RecordField(type=its))
            ):
                return len(its.shape)
            case Local(name=name) if name in self.function.parameters:
                return 0
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            record = self.record_of(node.value)
            if not record:
                raise self.refuse(node, f"{node.value.id} is not a record")
            raise self.refuse(node, f"{record} has no field {node.attr}")
        raise self.refuse(node, f"{ast.unparse(node)} is not a field, array or table")

    def arguments(self, node: ast.Call) -> None:
        """Check the arguments of a call against its parameters."""
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise self.refuse(node, "arguments are positional")
        called = self.program.refs.get(node)
        if not isinstance(called, Function | Operation | Access):
            raise self.refuse(node, f"{ast.unparse(node.func)} is not a function of the firmware")
        count = len(called.parameters if isinstance(called, Function) else called.operands)
        count += isinstance(called, Access)
        if len(node.args) != count:
            raise self.refuse(node, f"{called.name} takes {count} arguments")
        if isinstance(called, Function):
            self.passed(node, called)
            return
        if isinstance(called, Access):
            self.record(node.args[0], called)
        for argument in node.args[isinstance(called, Access) :]:
            self.number(argument)

    def passed(self, node: ast.Call, called: Function) -> None:
        """Check the arguments of a call of a function of the firmware."""
        for argument, its in zip(node.args, called.parameters.values(), strict=True):
            if is_scalar(its):
                self.number(argument)
            elif its.shape:
                if self.place(argument) != len(its.shape):
                    raise self.refuse(argument, f"{called.name} needs an array of {its.shape}")
            elif self.record_of(argument) != its.record:
                raise self.refuse(argument, f"{called.name} needs a {its.record}")

    def record(self, node: ast.expr, access: Access) -> None:
        """Check the record argument of an intrinsic."""
        record = self.record_of(node)
        if not record:
            raise self.refuse(node, f"{access.name} takes a record")
        fields = self.program.record(record).fields.values()
        words = access.element == "i32" and access.effect != "size"
        if words and all(row.type.kind != "i32" for row in fields):
            raise self.refuse(node, f"{access.name} takes a record of words: {record} has none")
        constant = record == CONST_RECORD
        if access.effect == "clear" and constant:
            raise self.refuse(node, "the calibration is constant")
        if access.effect == "write" and not constant:
            rule = f"{access.name} writes a calibration: assign the fields of others"
            raise self.refuse(node, rule)

    def record_of(self, node: ast.expr) -> str:
        """The record class of a parameter named as an argument, or ""."""
        match self.program.refs.get(node) if isinstance(node, ast.Name) else None:
            case Parameter(type=its):
                return its.record
        return ""

    def order(
        self, node: ast.expr, targets: tuple[ast.expr, ...], *, augmented: bool = False
    ) -> None:
        """Refuse a writing call among other reads: C does not define the order of operands."""
        effects = [n for part in (node, *targets) for n in walk(part) if self.writes(n)]
        if not effects:
            return
        if len(effects) > 1:
            raise self.refuse(node, "two calls that write in one expression: C orders them freely")
        inside = set(walk(effects[0]))
        outside = [inner for inner in walk(node) if inner not in inside]
        for target in targets:
            outside += list(walk(target)) if augmented else list(walk(target))[1:]
        written = set() if augmented else set(map(base, targets))
        for inner in outside:
            # what is called with the result of the call comes after it
            if self.reads(inner) and inner not in written and effects[0] not in walk(inner):
                raise self.refuse(node, "a call that writes beside a read: C orders them freely")

    def reads(self, node: ast.AST) -> bool:
        """Whether ``node`` reads a record or an array, itself or in the function that it calls."""
        match self.program.refs.get(node):
            case FieldReference():
                return isinstance(node, ast.Attribute)
            case Parameter(type=kind):
                return bool(kind.shape) and isinstance(node, ast.Name)
            case Function(parameters=parameters):
                return isinstance(node, ast.Call) and not all(map(is_scalar, parameters.values()))
            case Access():
                return isinstance(node, ast.Call)
        return False

    def writes(self, node: ast.AST) -> bool:
        """Whether ``node`` calls a function that writes its arguments."""
        match self.program.refs.get(node) if isinstance(node, ast.Call) else None:
            case Function(key=key):
                return key in self.program.writers
            case Access(writes=writes):
                return writes
        return False


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
