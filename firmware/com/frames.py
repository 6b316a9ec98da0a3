"""Frames received, bytes of a mailbox, counter values; by canroll.codegen.generated.frames.

Not to be edited.
"""

# the first frame of each message, then its further ones
N_FRAMES = 5
RX_BYTES = 8
TX_BYTES = 8
# all bits of the widest counter
COUNTER_MAX = 255
