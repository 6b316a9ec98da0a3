"""A pytest plugin: python-can's interface ``virtual`` is ``simbus`` while its own tests run.

What those tests know of the inside of ``virtual`` is given to them here: a queue with a length, the
table of open channels, and a bus on which a lone node finds its frames acknowledged.
"""

import contextlib
import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from canroll.plant_sim.can_bus.servers.hub import HubPort


class Waiting:
    """The received frames of a bus, as a queue."""

    def __init__(self, port: "HubPort") -> None:
        self.port = port

    def qsize(self) -> int:
        return len(self.port.entries)

    def empty(self) -> bool:
        return not self.port.entries


def pytest_sessionstart() -> None:
    # can.Printer writes to the standard output of this moment, and closes it
    with contextlib.redirect_stdout(io.StringIO()):
        import can
    from can.interfaces import virtual

    from canroll.plant_sim.can_bus.servers import simbus

    class Virtual(simbus.SimBus):
        def __init__(self, channel: Any = None, **options: Any) -> None:
            super().__init__(channel, acknowledge=True, **options)
            self.queue = Waiting(self.port)

        @staticmethod
        def _detect_available_configs() -> list[Any]:
            found = simbus.SimBus._detect_available_configs()
            return [{**config, "interface": "virtual"} for config in found]

    vars(virtual).update(VirtualBus=Virtual, channels=simbus._HUBS, channels_lock=simbus._LOCK)
    # compile the kernels before the first test counts its tenths of a second
    with Virtual("warm", fd=True) as one, Virtual("warm", fd=True) as two:
        one.send(can.Message(arbitration_id=1, is_fd=True))
        assert two.recv(60.0) is not None
