"""Who may import whom: what keeps firmware and plant apart, and the drawing in docs true."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "dbc": set(),
    "vehicles": set(),
    "firmware": set(),
    "codegen": {"dbc", "firmware"},
    "gain_gen": {"firmware", "codegen", "vehicles"},
    "plant_sim": {"dbc", "vehicles"},
}
"""Packages of ours beside itself; ``canroll.errors`` is everybody's, ``hil`` may import all."""


def imported(path):
    """Yield the modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_a_package_imports_only_what_it_may(package):
    ours = {*MAY_IMPORT, "hil", "canroll"}
    allowed = {*MAY_IMPORT[package], package}
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    wrong = [
        f"{path.relative_to(ROOT)}: {module}"
        for path in files
        for module in imported(path)
        if module.split(".")[0] in ours - allowed and module != "canroll.errors"
    ]
    assert not wrong
