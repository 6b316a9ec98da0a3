"""asammdf imported for an .mf4 alone.

python-can imports it wherever it is installed, and with it pandas: half a second of every command
and 100 MB of every run.
"""

import sys
from importlib import import_module, reload

READER = "can.io.mf4"


class PutOff:
    """A finder of modules that has no asammdf while python-can's reader of .mf4 is imported."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        """Raise for asammdf then; leave all else to the other finders."""
        if name == "asammdf":
            importing = sys.modules.get(READER)
            if importing is not None and not hasattr(importing, "MF4Reader"):
                raise ModuleNotFoundError("asammdf is put off", name=name)


def put_off() -> None:
    """Make python-can importable without asammdf."""
    if PutOff not in sys.meta_path:
        sys.meta_path.insert(0, PutOff)


def load() -> None:
    """Give python-can's reader and writer of .mf4 the asammdf that was put off, if it is there."""
    mf4 = import_module(READER)
    if mf4.asammdf is None:
        reload(mf4)
