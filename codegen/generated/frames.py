"""firmware/com/frames.py from a DBC and its map: number and length of frames, widest counter.

    python -m canroll.codegen.generated.frames [--check]

writes (or compares) the checked-in module for ``dbc/roll_control.dbc``. A bus of classic frames has
mailboxes of eight bytes; one of CAN FD frames as many as its longest frame of the map. Counters are
held in a byte each unless one of them is wider.
"""

import sys
from pathlib import Path

from canroll.codegen.generated.bus_map import load
from canroll.codegen.generated.mailbox import room
from canroll.codegen.generated.signals import DBC, MAP, ROOT, write_or_check
from canroll.dbc.reader import Files

FRAMES = ROOT / "firmware" / "com" / "frames.py"

TEXT = '''\
"""Frames received, bytes of a mailbox, counter values; by canroll.codegen.generated.frames.

Not to be edited.
"""

# the first frame of each message, then its further ones
N_FRAMES = {frames}
RX_BYTES = {received}
TX_BYTES = {transmitted}
# all bits of the widest counter
COUNTER_MAX = {counter}
'''
BYTE_MAX = 255


def generate(files: Files = DBC, map_file: Path = MAP) -> str:
    """Return the subset source of the module for ``files`` and ``map_file``."""
    bus = load(files, map_file)
    widths = [
        box.protection.counter.held.width
        for box in bus.frames
        if box.protection is not None and box.protection.counter is not None
    ]
    return TEXT.format(
        frames=len(bus.received),
        received=room(bus.received),
        transmitted=room(bus.transmitted),
        counter=max([BYTE_MAX, *((1 << width) - 1 for width in widths)]),
    )


if __name__ == "__main__":
    sys.exit(write_or_check(FRAMES, generate(), __doc__))
