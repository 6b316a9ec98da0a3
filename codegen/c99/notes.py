"""Comments in emitted C beside those of its source."""

import ast

from canroll.codegen.subset.program import Function


class Notes:
    """No further comments; a subclass has them. They never change the code."""

    def of_function(self, function: Function) -> str:
        """Return the comment above a function, one line; "": none."""
        return ""

    def of_statement(self, function: Function, node: ast.stmt) -> str:
        """Return the comment above a statement of a function, one line; "": none."""
        return ""
