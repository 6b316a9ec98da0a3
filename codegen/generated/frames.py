"""firmware/com/frames.py from a DBC and its map: the longest frame in each direction.

    python -m codegen.generated.frames [--check]

writes (or compares) the checked-in module for ``dbc/roll_control.dbc``. A bus of classic frames has
mailboxes of eight bytes; one of CAN FD frames as many as its longest frame of the map.
"""

import sys
from pathlib import Path

from codegen.generated.bus_map import load
from codegen.generated.signals import DBC, MAP, ROOT, room, write_or_check

FRAMES = ROOT / "firmware" / "com" / "frames.py"

TEXT = '''\
"""Bytes of a mailbox each way; made by codegen.generated.frames, not to be edited."""

RX_BYTES = {received}
TX_BYTES = {transmitted}
'''


def generate(dbc: Path = DBC, map_file: Path = MAP) -> str:
    """Return the subset source of the module for ``dbc`` and ``map_file``."""
    bus = load(dbc, map_file)
    return TEXT.format(received=room(bus.received), transmitted=room(bus.transmitted))


if __name__ == "__main__":
    sys.exit(write_or_check(FRAMES, generate(), __doc__))
