"""What the shown outputs depend on: a digest of each folder of sources and of each file of data.

``docs/digests.json`` has, for each block that no test reruns, the digests of the parts of the
project that the page, when it was made, had read when it came to its end, and not before the last
such block. A part is a file of data, a script, or all files of a folder of sources: Python counts
without comments, blank lines and docstrings.
"""

import ast
import json
import os
import re
from hashlib import sha256
from pathlib import Path

DATA = ("vehicles", "dbc", "examples", "benchmarks")
LEFT_OUT = {"recorder", "tests", "docs", "build", "out", "__pycache__"}
Parts = dict[str, str]
"""Digests by part."""


def stripped(source: str) -> str:
    """Return Python source without comments, blank lines and docstrings of their own lines."""
    lines = source.splitlines()
    tree = ast.parse(source)
    dropped: set[int] = set()
    inside: set[int] = set()  # of strings of several lines, where nothing is a comment
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            before = lines[node.lineno - 1][: node.col_offset]
            after = lines[(node.end_lineno or 0) - 1].encode()[node.end_col_offset :].strip()
            if isinstance(node.value.value, str) and not before.strip() and after[:1] in b"#":
                dropped.update(range(node.lineno, (node.end_lineno or 0) + 1))
        elif isinstance(node, ast.JoinedStr) or (
            isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
        ):
            inside.update(range(node.lineno + 1, (node.end_lineno or 0) + 1))
    return "\n".join(
        line
        for number, line in enumerate(lines, 1)
        if number not in dropped and (number in inside or line.strip()[:1] not in ("", "#"))
    )


def part_of(path: str) -> str:
    """Return the part of the project that a file, relative to its root, belongs to."""
    alone = path.startswith(tuple(f"{folder}/" for folder in (*DATA, "scripts")))
    return path if alone and not path.endswith(".py") else os.path.dirname(path) or "."


def state(root: Path) -> Parts:
    """Return the digests of all parts of a project."""
    made: dict[str, list[str]] = {}
    for folder, folders, names in os.walk(root):
        folders[:] = sorted(f for f in folders if f not in LEFT_OUT and not f.startswith("."))
        for name in sorted(names):
            content = Path(folder, name).read_bytes()
            if name.endswith(".py"):
                content = stripped(content.decode()).encode()
            part = part_of(os.path.relpath(os.path.join(folder, name), root))
            made.setdefault(part, []).append(f"{name} {sha256(content).hexdigest()}")
    return {part: sha256("\n".join(made[part]).encode()).hexdigest()[:6] for part in made}


def read_by(record: Path, commands: str, folder: Path, root: Path) -> set[str]:
    """Return the parts that commands read: as recorded, and files that they name themselves."""
    paths = set(record.read_text().splitlines()) if record.is_file() else set()
    for word in re.split(r"[\s=|;&()'\"]+", commands):
        named = (os.path.join(start, word) for start in (folder, root / "scripts"))
        paths.update(os.path.realpath(path) for path in named if os.path.isfile(path))
    return {part_of(os.path.relpath(p, root)) for p in paths if Path(p).is_relative_to(root)}


def load(path: Path) -> dict[str, Parts]:
    """Return the kept digests of each block; none if there is no such file."""
    if not path.is_file():
        return {}
    kept = json.loads(path.read_text(encoding="utf-8"))
    return {
        block: dict(each.rsplit(" ", 1) for each in text.split(", ") if each)
        for block, text in kept.items()
    }


def save(path: Path, kept: dict[str, Parts]) -> None:
    """Write the digests of each block, a line a block."""
    lines = {
        block: ", ".join(f"{part} {parts[part]}" for part in sorted(parts))
        for block, parts in kept.items()
    }
    path.write_text(json.dumps(lines, indent=0, sort_keys=True) + "\n", encoding="utf-8")
