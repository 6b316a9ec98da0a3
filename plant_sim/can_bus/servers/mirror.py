"""What happens on a simulated bus, shown on a bus of python-can, such as vcan."""

import can

from canroll.errors import CanrollError
from plant_sim.can_bus.servers.frames import message_of
from plant_sim.can_bus.servers.hub import Received

_NOBODY = -1


class Mirror:
    """Sends every frame on to a python-can bus as soon as it is called.

    Attributes:
        failed: frames that bus did not take.

    Args:
        where: "interface:channel".

    Raises:
        CanrollError: it cannot be opened.
    """

    def __init__(self, where: str) -> None:
        interface, _, channel = where.partition(":")
        if not interface or not channel:
            raise CanrollError(f"mirror '{where}': expected INTERFACE:CHANNEL")
        self.failed = 0
        try:
            self._bus = can.Bus(channel, interface=interface, fd=True)
        except (can.CanError, OSError, ValueError, ImportError) as error:
            raise CanrollError(f"mirror '{where}': {error}") from error

    def __call__(self, frame: Received) -> None:
        """Send a frame on; one that an error has destroyed is not shown."""
        if frame.error:
            return
        try:
            self._bus.send(message_of(frame, None, _NOBODY))
        except (can.CanError, OSError):
            self.failed += 1

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()
