"""Damage inside a document or an archive, which stays one: beyond the parser, in what it found."""

import copy
import io
import json
import random
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from math import inf, nan
from typing import Any

import tomli_w

from canroll.errors import UNREADABLE

VALUES: tuple[Any, ...] = (
    *(nan, inf, -inf, 0, -1, 1.5, 1e308, 2**31, 2**63, 10**20, True, "", "x", "\n", "\0"),
    *([], {}, [[]], [0, 1], {"x": 1}),
)
"""What is put in the place of a value."""
Damage = Callable[[bytes], bytes]


def damaged_inside(suffix: str, content: bytes, source: random.Random, plainly: Damage) -> bytes:
    """Return ``content`` with an entry changed, or a member of an archive.

    Args:
        suffix: that of the file, which says what it is.
        content: a good or a damaged file.
        source: draws the change.
        plainly: damages the bytes of a member, or of a file that is none of these or no longer.
    """
    try:
        if suffix == ".toml":
            return tomli_w.dumps(_changed(tomllib.loads(content.decode()), source)).encode()
        if suffix == ".json":
            return json.dumps(_changed(json.loads(content), source)).encode()
        if zipfile.is_zipfile(io.BytesIO(content)):
            return _repacked(content, source, plainly)
    except UNREADABLE:  # or what cannot be written in this format
        pass
    return plainly(content)


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:  # noqa: ANN401
    """Every entry below ``tree``: what holds it, and its key or number."""
    keys = list(tree) if isinstance(tree, dict) else range(len(tree))
    for key in keys:
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from _places(tree[key])


def _changed(tree: Any, source: random.Random) -> Any:  # noqa: ANN401
    """Return a document with one to three entries changed, removed, copied or renamed."""
    for _ in range(source.randint(1, 3)):
        places = list(_places(tree))
        if not places:
            break
        holder, key = source.choice(places)
        other, its = source.choice(places)
        kind = source.randrange(5)
        if kind == 0:
            holder[key] = copy.deepcopy(source.choice(VALUES))
        elif kind == 1:
            del holder[key]
        elif kind == 2:
            holder[key] = copy.deepcopy(other[its])
        elif kind == 3 and isinstance(holder, dict):
            holder[str(its)] = holder.pop(key)
        elif isinstance(holder, list):
            holder.insert(key, copy.deepcopy(other[its]))
        else:
            number = holder[key]
            if isinstance(number, int | float):
                holder[key] = number * source.choice((-1, 0.5, 2, 10, 1e6, 1e-6))
    return tree


def _repacked(content: bytes, source: random.Random, plainly: Damage) -> bytes:
    """Return an archive with one member damaged, whose sums fit."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    found = io.BytesIO()
    chosen = source.randrange(len(members))
    with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, (name, data) in enumerate(members):
            archive.writestr(zipfile.ZipInfo(name), plainly(data) if number == chosen else data)
    return found.getvalue()
