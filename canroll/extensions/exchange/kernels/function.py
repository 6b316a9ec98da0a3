"""One kernel for one set of argument kinds: inference of its variables' kinds, then its C."""

import ast
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from canroll.extensions.exchange.kernels.expressions import KernelScope, KernelValue, Static
from canroll.extensions.exchange.kernels.kinds import (
    INT,
    ArrayKind,
    Kind,
    NumberKind,
    RecordKind,
    Several,
    Structs,
    unified,
)

INDENT = "    "


class KernelWriter:
    """The statements of one function.

    ``result`` is the kind of what it returns, None for nothing.
    """

    def __init__(self, node: ast.FunctionDef, scope: KernelScope, structs: Structs) -> None:
        self.node = node
        self.scope = scope
        scope.make = self.make
        self.structs = structs
        self.result: Kind | None = None
        self.parameters = set(scope.variables)
        self.local: dict[str, ArrayKind] = {}
        self.loops = 0
        self.lines: list[str] = []

    def translate(self) -> list[str]:
        """Return the lines of the body."""
        for _ in range(10):
            before = (dict(self.scope.variables), self.result)
            self.lines, self.loops = [], 0
            self.block(self.node.body, 1)
            if before == (dict(self.scope.variables), self.result):
                break
        else:
            raise self.scope.refuse(self.node, "the kinds of its variables do not settle")
        return [*self._declared(), *self.lines]

    def _declared(self) -> Iterator[str]:
        for name, kind in self.scope.variables.items():
            if name in self.parameters:
                continue
            start = " = 0" if isinstance(kind, NumberKind) else ""
            yield f"{INDENT}{self.structs.c(kind)} {name}_{start};"
        for name, array in self.local.items():
            yield f"{INDENT}{self.structs.stored(array.dtype)} {name}[{array.count}];"

    def block(self, statements: Sequence[ast.stmt], depth: int) -> None:
        """Translate statements."""
        for statement in statements:
            method = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if method is None:
                raise self.scope.refuse(statement, "no statement of the kernels' subset")
            method(statement, depth)

    def put(self, depth: int, text: str) -> None:
        """Add a line."""
        self.lines.append(INDENT * depth + text)

    def _define(self, name: str, kind: Kind) -> None:
        known = self.scope.variables.get(name)
        self.scope.variables[name] = unified(known, kind)

    # statements

    def _expr(self, node: ast.Expr, depth: int) -> None:
        if isinstance(node.value, ast.Constant):
            return
        self.put(depth, f"{self.scope.value(node.value).c};")

    def _pass(self, node: ast.Pass, depth: int) -> None:
        pass

    def _break(self, node: ast.Break, depth: int) -> None:
        self.put(depth, "break;")

    def _continue(self, node: ast.Continue, depth: int) -> None:
        self.put(depth, "continue;")

    def _raise(self, node: ast.Raise, depth: int) -> None:
        assert isinstance(node.exc, ast.Call)
        message = self.scope.static(node.exc.args[0])
        assert message is not None
        self.put(depth, f'kernel_error = "{message.value}";')
        if self.result is None:
            self.put(depth, "return;")
        elif isinstance(self.result, Several):
            name = self.structs.c(self.result)
            self.put(depth, f"return ({name}){{0}};")
        else:
            self.put(depth, "return 0;")

    def _return(self, node: ast.Return, depth: int) -> None:
        if node.value is None:
            self.put(depth, "return;")
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.scope.number(its) for its in node.value.elts]
            kinds = tuple(v.kind for v in values if isinstance(v.kind, NumberKind))
            self.result = unified(self.result, Several(kinds))
            text = ", ".join(value.c for value in values)
            self.put(depth, f"return ({self.structs.c(self.result)}){{ {text} }};")
            return
        value = self.scope.value(node.value)
        self.result = unified(self.result, value.kind)
        self.put(depth, f"return {value.c};")

    def _annassign(self, node: ast.AnnAssign, depth: int) -> None:
        assert node.value is not None
        self._assign_to(node.target, node.value, depth)

    def _assign(self, node: ast.Assign, depth: int) -> None:
        if len(node.targets) == 1:
            self._assign_to(node.targets[0], node.value, depth)
            return
        self.put(depth, "{")
        held = self._held(self.scope.value(node.value), depth + 1)
        for target in node.targets:
            self._store(target, held, depth + 1)
        self.put(depth, "}")

    def _held(self, value: KernelValue, depth: int) -> KernelValue:
        """A value in a name of its own, so that C computes it once."""
        self.loops += 1
        name = f"held{self.loops}"
        self.put(depth, f"{self.structs.c(value.kind)} {name} = {value.c};")
        return KernelValue(value.kind, name)

    def _assign_to(self, target: ast.expr, source: ast.expr, depth: int) -> None:
        if isinstance(target, ast.Tuple):
            self._unpack(target, source, depth)
            return
        value = self.scope.value(source)
        if isinstance(target, ast.Subscript) and isinstance(value.kind, ArrayKind):
            with self.scope.twice(source):
                self.scope.value(source)
        self._store(target, value, depth)

    def make(self, source: ast.Call) -> KernelValue:
        """An array of this call of the function, as np.empty makes it."""
        function = self.scope.static(source.func)
        assert function is not None
        if hasattr(function.value, "record"):
            return self._record(self.scope.value(source.args[0]), function.value)
        if function.value is np.empty:
            kind = self._empty(source)
        else:
            kind = ArrayKind(np.dtype(np.float64), (function.value.elements,))
        name = f"made_{source.lineno}_{source.col_offset}"
        self.local[name] = kind
        return KernelValue(kind, name)

    def _record(self, vector: KernelValue, function: Any) -> KernelValue:  # noqa: ANN401
        """The record that begins a vector of float64 numbers."""
        dtype: np.dtype[Any] = function.record
        name = self.structs.name(dtype, function.__module__.rpartition(".")[2])
        return KernelValue(RecordKind(dtype), f"(({name} *){vector.c})")

    def _empty(self, source: ast.Call) -> ArrayKind:
        sizes = source.args[0].elts if isinstance(source.args[0], ast.Tuple) else [source.args[0]]
        shape = []
        for size in sizes:
            number = self.scope.static(size)
            if number is None:
                raise self.scope.refuse(size, "the size of an array must be known")
            shape.append(int(number.value))
        kind = self.scope.static(source.args[1]) if len(source.args) > 1 else Static(np.float64)
        assert kind is not None
        return ArrayKind(np.dtype(kind.value), tuple(shape))

    def _store(self, target: ast.expr, value: KernelValue, depth: int) -> None:
        if isinstance(target, ast.Name):
            self._define(target.id, value.kind)
            self.put(depth, f"{target.id}_ = {value.c};")
            return
        if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            self._store_slice(target, value, depth)
            return
        place = self._place(target)
        if not isinstance(place.kind, NumberKind):
            raise self.scope.refuse(target, "a number is stored in what is none")
        self.put(depth, f"{place.c} = {value.c};")

    def _place(self, target: ast.expr) -> KernelValue:
        if isinstance(target, ast.Subscript):
            return self.scope.place(target)
        if isinstance(target, ast.Attribute):
            return self.scope.value(target)
        raise self.scope.refuse(target, "nothing that can be assigned to")

    def _store_slice(self, target: ast.Subscript, value: KernelValue, depth: int) -> None:
        with self.scope.twice(target):
            part, owner = self.scope.place(target), self.scope.value(target.value)
            assert isinstance(part.kind, ArrayKind)
            assert isinstance(owner.kind, ArrayKind) and isinstance(target.slice, ast.Slice)
            low = self.scope.number(target.slice.lower).c if target.slice.lower else "0"
            high = str(owner.kind.shape[0])
            if target.slice.upper is not None:
                high = self.scope.number(target.slice.upper).c
            elif owner.kind.shape[0] is None:
                raise self.scope.refuse(target, "the length is not known")
        self.put(depth, "{")
        self.loops += 1
        if isinstance(value.kind, NumberKind):
            value = self._held(value, depth + 1)
        index = f"k{self.loops}"
        item = f"{value.c}[{index}]" if isinstance(value.kind, ArrayKind) else value.c
        head = f"for (int64_t {index} = 0; {index} < ({high}) - ({low}); {index}++)"
        self.put(depth + 1, f"{head} {part.c}[{index}] = {item};")
        self.put(depth, "}")

    def _unpack(self, target: ast.Tuple, source: ast.expr, depth: int) -> None:
        self.loops += 1
        prefix = f"t{self.loops}"
        self.put(depth, "{")
        if isinstance(source, ast.IfExp):
            source = self._split(source)
        if isinstance(source, ast.Tuple):
            values = [self.scope.value(its) for its in source.elts]
            held = []
            for k, value in enumerate(values):
                self.put(depth + 1, f"{self.structs.c(value.kind)} {prefix}_{k} = {value.c};")
                held.append(KernelValue(value.kind, f"{prefix}_{k}"))
        else:
            value = self.scope.value(source)
            assert isinstance(value.kind, Several)
            self.put(depth + 1, f"{self.structs.c(value.kind)} {prefix} = {value.c};")
            held = [KernelValue(kind, f"{prefix}.v{k}") for k, kind in enumerate(value.kind.items)]
        for its, value in zip(target.elts, held, strict=True):
            self._store(its, value, depth + 1)
        self.put(depth, "}")

    def _split(self, source: ast.IfExp) -> ast.Tuple:
        """A choice between two tuples as a tuple of choices."""
        yes, no = source.body, source.orelse
        if not (isinstance(yes, ast.Tuple) and isinstance(no, ast.Tuple)):
            raise self.scope.refuse(source, "no choice between tuples")
        with self.scope.twice(source.test):
            self.scope.number(source.test)
        choices: list[ast.expr] = [
            ast.copy_location(ast.IfExp(test=source.test, body=a, orelse=b), source)
            for a, b in zip(yes.elts, no.elts, strict=True)
        ]
        return ast.copy_location(ast.Tuple(elts=choices, ctx=ast.Load()), source)

    def _augassign(self, node: ast.AugAssign, depth: int) -> None:
        load: ast.expr = ast.parse(ast.unparse(node.target), mode="eval").body
        with self.scope.twice(node.target):
            self.scope.value(load)
        whole = ast.copy_location(ast.BinOp(left=load, op=node.op, right=node.value), node)
        self._store(node.target, self.scope.value(whole), depth)

    def _if(self, node: ast.If, depth: int) -> None:
        self.put(depth, f"if ({self.scope.number(node.test).c}) {{")
        self.block(node.body, depth + 1)
        if node.orelse:
            self.put(depth, "} else {")
            self.block(node.orelse, depth + 1)
        self.put(depth, "}")

    def _while(self, node: ast.While, depth: int) -> None:
        self.put(depth, f"while ({self.scope.number(node.test).c}) {{")
        self.block(node.body, depth + 1)
        self.put(depth, "}")

    def _for(self, node: ast.For, depth: int) -> None:
        assert isinstance(node.target, ast.Name)
        self.loops += 1
        index, last = f"k{self.loops}", f"n{self.loops}"
        self._define(node.target.id, INT)
        if isinstance(node.iter, ast.Tuple):
            items = ", ".join(self.scope.number(its).c for its in node.iter.elts)
            count = len(node.iter.elts)
            self.put(depth, f"const int64_t items{self.loops}[] = {{ {items} }};")
            self.put(depth, f"for (int64_t {index} = 0; {index} < {count}; {index}++) {{")
            self.put(depth + 1, f"{node.target.id}_ = items{self.loops}[{index}];")
        else:
            self._range(node, index, last, depth)
        self.block(node.body, depth + 1)
        self.put(depth, "}")

    def _range(self, node: ast.For, index: str, last: str, depth: int) -> None:
        its = node.iter
        if not (isinstance(its, ast.Call) and isinstance(its.func, ast.Name)):
            raise self.scope.refuse(node.iter, "no range")
        if its.func.id != "range":
            raise self.scope.refuse(node.iter, "no range")
        bounds = [self.scope.number(argument).c for argument in its.args]
        first = bounds[0] if len(bounds) > 1 else "0"
        end = bounds[1] if len(bounds) > 1 else bounds[0]
        step = self.scope.static(its.args[2]) if len(its.args) > 2 else Static(1)
        if step is None or not isinstance(step.value, int):
            raise self.scope.refuse(node.iter, "a step that is not known")
        sign = "<" if step.value > 0 else ">"
        head = f"for (int64_t {index} = {first}, {last} = {end}; {index} {sign} {last}; "
        self.put(depth, f"{head}{index} += {step.value}) {{")
        assert isinstance(node.target, ast.Name)
        self.put(depth + 1, f"{node.target.id}_ = {index};")
