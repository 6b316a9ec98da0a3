"""Times as integers: a millisecond and the plant's step in ns, and a time that never comes."""

from typing import Final

MS: Final = 1_000_000
STEP_NS: Final = MS
"""Time between two calls of the driver and two steps of the plant, ns."""
NEVER: Final = 2**62
