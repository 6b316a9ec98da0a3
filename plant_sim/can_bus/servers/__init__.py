"""The simulated bus for other programs: python-can and socketcand."""

from typing import Final

SHARED_PORT: Final = 29600
SOCKETCAND_PORT: Final = 29536
"""Default ports: in lock step, and by socketcand."""
