"""Locals and statements that nothing needs any more, taken out."""

import ast
from collections.abc import Callable

from canroll.errors import CanrollError
from codegen.specialise import fold
from codegen.subset.program import names
from codegen.subset.walk import walk


def tidied(body: list[ast.stmt]) -> list[ast.stmt]:
    """``body`` without values that nobody reads, as often as that leaves another unread."""
    while True:
        shorter, _ = _live(_declared_late(body), frozenset())
        if _size(shorter) == _size(body):
            return shorter
        body = shorter


def rebuilt(node: ast.stmt, change: Callable[[list[ast.stmt]], list[ast.stmt]]) -> ast.stmt:
    """An ``if`` or a loop with its blocks changed; any other statement as it is."""
    if isinstance(node, ast.If):
        return ast.If(node.test, change(node.body), change(node.orelse))
    if isinstance(node, ast.For):
        return ast.For(node.target, node.iter, change(node.body), [], lineno=0)
    return node


def _live(body: list[ast.stmt], after: frozenset[str]) -> tuple[list[ast.stmt], frozenset[str]]:
    """The statements that count where ``after`` are read later; the names read from here on."""
    kept: list[ast.stmt] = []
    for node in reversed(body):
        if isinstance(node, ast.Return):
            after = frozenset(names([node]))
            kept = [node]
        elif isinstance(node, ast.If):
            yes, in_yes = _live(node.body, after)
            no, in_no = _live(node.orelse, after)
            its = _condition(node.test, yes, no)
            after = frozenset(names([node.test])) | in_yes | in_no if its else after
            kept = [*its, *kept]
        elif isinstance(node, ast.For):
            inner, first = _turn(node.body, after)
            if inner:
                kept.insert(0, ast.For(node.target, node.iter, inner, [], lineno=0))
                after |= first | names([node.iter])
        elif isinstance(node, ast.AnnAssign) or _local(node) is not None:
            name, value = _local(node) or "", node.value  # type: ignore[attr-defined]
            needed = name in after or (isinstance(node, ast.AnnAssign) and name in names(kept))
            if needed:
                kept.insert(0, node)
                after = after - {name} | names([value])
            elif not fold.pure(value):
                kept = [*(ast.Expr(call) for call in _outermost(value)), *kept]
                after |= names([value])
        else:
            kept.insert(0, node)
            after |= names([node])
    return kept, after


def _turn(body: list[ast.stmt], after: frozenset[str]) -> tuple[list[ast.stmt], frozenset[str]]:
    """The same for a loop's body, whose end is followed by its beginning."""
    while True:
        kept, first = _live(body, after)
        if first <= after:
            return kept, first
        after |= first


def _local(node: ast.stmt) -> str | None:
    """The local that a statement gives a value, or None."""
    target = None
    if isinstance(node, ast.AnnAssign):
        target = node.target
    elif isinstance(node, ast.Assign):
        target = node.targets[0]  # type: ignore[assignment]
    return target.id if isinstance(target, ast.Name) else None


def _declared_late(body: list[ast.stmt]) -> list[ast.stmt]:
    """Declare a local where it gets the first value that is read, in the branch that needs it."""
    body = list(body)
    for i, node in enumerate(body):
        body[i] = rebuilt(node, _declared_late)
        if isinstance(node, ast.AnnAssign) and node.value is not None and fold.pure(node.value):
            name = _local(node) or ""
            later = next((k for k in range(i + 1, len(body)) if name in names([body[k]])), None)
            if later is None:
                continue
            if isinstance(node.value, ast.Constant) and _in_one_branch(body[later:], name):
                body[later] = _begun(body[later], name, node)
                return _declared_late([*body[:i], *body[i + 1 :]])
            if _local(body[later]) != name:
                continue
            following = body[later]
            assert isinstance(following, ast.Assign | ast.AnnAssign) and following.value
            if name not in names([following.value]):
                body[later] = ast.AnnAssign(node.target, node.annotation, following.value, 1)
                return _declared_late([*body[:i], *body[i + 1 :]])
    return body


def _in_one_branch(body: list[ast.stmt], name: str) -> bool:
    """Whether ``body`` begins with an ``if`` of which one branch alone has ``name``."""
    first, *rest = body
    if not isinstance(first, ast.If) or name in names([first.test, *rest]):
        return False
    return (name in names(first.body)) != (name in names(first.orelse))


def _begun(node: ast.stmt, name: str, first: ast.stmt) -> ast.stmt:
    """The ``if`` with ``first`` at the beginning of the branch that has ``name``."""
    return rebuilt(node, lambda branch: [first, *branch] if name in names(branch) else branch)


def _condition(test: ast.expr, yes: list[ast.stmt], no: list[ast.stmt]) -> list[ast.stmt]:
    if not yes and not no:
        if fold.pure(test):
            return []
        if isinstance(test, ast.BoolOp):
            raise CanrollError(
                f"cannot specialise 'if {ast.unparse(test)}': nothing depends on it, but it calls "
                "a function that writes: write the call as a statement"
            )
        return [ast.Expr(call) for call in _outermost(test)]
    if not yes:
        return [ast.If(fold.inverse(test), no, [])]
    return [ast.If(test, yes, no)]


def _outermost(node: ast.AST) -> list[ast.expr]:
    """The calls in ``node`` that have effects, without those inside their arguments."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) not in fold.READERS:
        return [node]
    return [call for inner in ast.iter_child_nodes(node) for call in _outermost(inner)]


def _size(body: list[ast.stmt]) -> int:
    return sum(1 for statement in body for _ in walk(statement))
