"""asammdf imported for an .mf4 alone.

python-can imports it wherever it is installed, and with it pandas: half a second of every command
and 100 MB of every run.
"""

import sys
from importlib import import_module, reload
from importlib.util import find_spec


def put_off() -> None:
    """Import python-can without asammdf; nothing where either is imported or it is missing."""
    if "can" in sys.modules or "asammdf" in sys.modules or find_spec("asammdf") is None:
        return
    sys.modules["asammdf"] = None  # type: ignore[assignment]
    try:
        import_module("can")
    finally:
        del sys.modules["asammdf"]


def load() -> None:
    """Give python-can's reader and writer of .mf4 the asammdf that was put off, if it is there."""
    mf4 = import_module("can.io.mf4")
    if mf4.asammdf is None:
        reload(mf4)
