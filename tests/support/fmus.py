"""The importer of examples/fmi as a module, and bus operations for it."""

import importlib.util
import struct
from pathlib import Path
from types import ModuleType

CLASSIC, FD = 0x10, 0x11
EXTENDED = 1 << 30


def importer() -> ModuleType:
    """Return examples/fmi/closed_loop.py as a module."""
    path = Path(__file__).parents[2] / "examples" / "fmi" / "closed_loop.py"
    spec = importlib.util.spec_from_file_location("closed_loop", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def transmit(ident: int, data: bytes, *, fd: bool = False, switched: bool = False) -> bytes:
    """Return a transmit operation; bit 30 of ``ident`` marks one of 29 bits."""
    head = struct.pack("<IB", ident & (EXTENDED - 1), int(ident & EXTENDED != 0))
    head += bytes([switched, 0]) if fd else bytes([0])
    body = head + struct.pack("<H", len(data)) + data
    return struct.pack("<II", FD if fd else CLASSIC, 8 + len(body)) + body
