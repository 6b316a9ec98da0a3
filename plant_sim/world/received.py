"""The frames of a bus log that reached the ECU."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from canroll.codegen.generated.mailbox import EXTENDED
from canroll.plant_sim.can_bus import DELIVERED, ECU
from canroll.plant_sim.world.spool import Table, blocks


def received_by_ecu(frames: Table, ident: int) -> NDArray[np.void]:
    """Return the frames with an identifier that were delivered on the ECU's segment."""
    return received_on(frames, segment_of_ecu(frames), ident)


def segment_of_ecu(frames: Table) -> int:
    """Return the segment that the ECU sends on, or the first if it has sent nothing."""
    for block in blocks(frames):
        own = block["segment"][block["sender"] == ECU]
        if len(own):
            return int(own[0])
    return 0


def received_on(frames: Table, segment: int, ident: int) -> NDArray[np.void]:
    """Return the frames with an identifier that were delivered on a segment."""
    return np.concatenate([np.zeros(0, frames.dtype), *received_blocks(frames, segment, ident)])


def received_blocks(frames: Table, segment: int, ident: int) -> Iterator[NDArray[np.void]]:
    """Yield the frames of :func:`received_on` by the blocks of the log."""
    for block in blocks(frames):
        delivered = (block["ident"] == ident & ~EXTENDED) & (block["outcome"] == DELIVERED)
        yield block[delivered & (block["segment"] == segment)]
