"""Text files of users: bounded in size and in depth, with or without a byte order mark."""

import json
import tomllib
from pathlib import Path
from typing import Any

MOST_BYTES = 16 << 20
"""Size of a text file; a larger one is not what it is taken for."""


def text(path: Path) -> str:
    """Return the content of a UTF-8 file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is not UTF-8, or larger than :data:`MOST_BYTES`.
    """
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(f"larger than {MOST_BYTES >> 20} MB")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 (byte {error.start})") from error


def parse_toml(content: str) -> dict[str, Any]:
    """Return the table of a TOML document.

    Raises:
        ValueError: it is not TOML, or nested too deeply.
    """
    try:
        return tomllib.loads(content)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file.

    Raises:
        OSError: it cannot be read.
        ValueError: see :func:`text` and :func:`parse_toml`.
    """
    return parse_toml(text(path))


def parse_json(content: str) -> Any:  # noqa: ANN401 - whatever stands there
    """Return the value of a JSON document.

    Raises:
        ValueError: it is not JSON, or nested too deeply.
    """
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
