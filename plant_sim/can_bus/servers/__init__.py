"""The simulated bus for other programs: python-can and socketcand."""

from typing import Final

SOCKETCAND_PORT: Final = 29536
"""Default port of the server."""
