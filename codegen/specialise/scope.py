"""What one specialised function knows of its names while it is written."""

import ast
from dataclasses import dataclass, field

from codegen.subset.program import Function


@dataclass(slots=True)
class Scope:
    """The names of the function that is read, in the function that is written.

    Attributes:
        function: is read.
        values: what a parameter or local stands for: a literal, a place, or its name.
        constants: locals whose value is known here, and that value.
        taken: names that the written function has already.
    """

    function: Function
    values: dict[str, ast.expr]
    constants: dict[str, int] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    def declare(self, name: str) -> str:
        """A name for a local that the written function does not have yet."""
        fresh, n = name, 2
        while fresh in self.taken:
            fresh, n = f"{name}_{n}", n + 1
        self.taken.add(fresh)
        self.values[name] = ast.Name(fresh)
        self.constants.pop(name, None)
        return fresh

    def trial(self) -> "Scope":
        """Another scope that knows the same, to be adopted or thrown away."""
        return Scope(self.function, dict(self.values), dict(self.constants), set(self.taken))

    def adopt(self, trial: "Scope") -> None:
        """Know what a trial knows."""
        self.values, self.constants, self.taken = trial.values, trial.constants, trial.taken

    def forget(self, names: set[str]) -> None:
        """Know no longer what ``names`` are."""
        for name in names:
            self.constants.pop(name, None)


def agreed(a: dict[str, int] | None, b: dict[str, int] | None) -> dict[str, int]:
    """What two ways of getting here know alike; None is a way that does not get here."""
    if a is None or b is None:
        return dict(a if a is not None else b or {})
    return {name: value for name, value in a.items() if b.get(name) == value}
