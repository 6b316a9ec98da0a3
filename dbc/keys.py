"""The key of a bus with authenticated frames: AES, 128 bits, in a separate file.

The file has 32 hexadecimal digits, or is TOML with ``key = "…"``. Nobody but its owner may read it.
"""

import stat
import string
from pathlib import Path

from canroll import documents
from canroll.errors import CanrollError, reason

KEY_BYTES = 16
DEVELOPMENT_KEY = b"canroll dev key!"
"""The key where none is given: public, for simulation and development only."""


def read_key(path: Path) -> bytes:
    """Return the key in a file.

    Raises:
        CanrollError: it cannot be read, others may read it, or it holds no key.
    """
    try:
        mode = path.stat().st_mode
        text = documents.text(path).strip()
    except (OSError, ValueError) as error:
        raise CanrollError(f"{path}: no readable key: {reason(error)}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise CanrollError(f"{path}: others than its owner may use this key: chmod 600 {path}")
    if "=" in text:
        text = _of_toml(path, text)
    # the message says nothing of what is in the file
    if len(text) != 2 * KEY_BYTES or not set(text) <= set(string.hexdigits):
        raise CanrollError(f"{path}: a key has {2 * KEY_BYTES} hexadecimal digits")
    key = bytes.fromhex(text)
    if key == DEVELOPMENT_KEY:
        raise CanrollError(f"{path}: holds the public development key: make another, or omit --key")
    return key


def _of_toml(path: Path, text: str) -> str:
    try:
        table = documents.parse_toml(text)
    except ValueError:
        raise CanrollError(f"{path}: neither a key nor TOML") from None
    if set(table) != {"key"} or not isinstance(table["key"], str):
        raise CanrollError(f'{path}: must have one entry, key = "32 hexadecimal digits"')
    return table["key"]
